"""What is legal in a scene but odd is noted with its line; one cause is one problem; includes name shipped rigs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from program import program as run
from shipped import SCENES

import itouch
from itouch.scene.elements import Box, Operator
from itouch_tools.authoring import lint
from itouch_tools.cli.check import examined

HEAD = '<itouch version="1.0">\n  <include file="itouch:materials.xml"/>\n  <include file="itouch:rigs/twin.xml"/>\n'
FINGER = '<probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>'


def scene(folder: Path, world: str, *, motion: str = "", probe: str = FINGER) -> str:
    """Write a scene of its own on the shipped twin, and return its path."""
    operator = f'\n    <operator probe="finger"><motion>{motion}</motion></operator>' if motion else ""
    path = folder / "own.xml"
    path.write_text(f"{HEAD}  <world>\n    {world}\n  </world>\n  <interaction>\n    {probe}{operator}\n"
                    "  </interaction>\n</itouch>\n")  # fmt: skip
    return str(path)


def codes(path: str) -> list[tuple[str, int]]:
    model, problems = examined(path, None, None)
    assert model is not None, problems
    return [(problem.code, problem.place.line if problem.place else 0) for problem in problems]


def to(*points: str) -> str:
    return "".join(f'<to pos="{point}" in="0.5 s"/>' for point in points)


BLOCK = '<box name="block" size="20 20 20 mm" pos="0 0 10 mm" material="wood"/>'
DOWN = to("0 0 50 mm", "0 0 26 mm")


@pytest.mark.parametrize(
    ("world", "motion", "expected"),
    [
        (BLOCK, DOWN, []),
        (BLOCK.replace('20 20 20 mm"', '20 20 20"'), "", ["metres"]),
        (BLOCK.replace('20 20 20 mm"', '20 20 20 m"'), "", []),  # somebody who writes metres means them
        (BLOCK.replace('20 20 20 mm"', '0.02 0.02 0.02"'), DOWN, []),
        (BLOCK.replace('"0 0 10 mm"', '"0 0 -10"'), "", ["metres"]),
        ('<sphere name="b" radius="2e1" material="wood"/>', "", ["metres"]),
        (BLOCK + BLOCK.replace("block", "other").replace('"wood"', '"pyrex"').replace('"0 0', '"9 0'), "", ["overlap"]),
        (BLOCK.replace('material="wood"', 'material="wood" temperature="5 degC"'), "", ["out-of-band"]),
        (BLOCK.replace('material="wood"', 'material="wood" temperature="39 degC"'), "", []),
        (BLOCK, to("0 0 60 mm", "0 0 30 mm"), ["untouched"]),
        (BLOCK, to("-60 0 24 mm", "60 0 24 mm"), []),  # it passes through on its way
        (
            BLOCK.replace('"0 0', '"-11 0')
            + BLOCK.replace("block", "high").replace("20 20 20", "20 20 24").replace('"0 0 10', '"11 0 12'),
            to("0 0 50 mm", "0 0 30 mm"),
            ["two-heights"],
        ),
    ],
)
def test_what_is_odd_is_noted(tmp_path: Path, world: str, motion: str, expected: list[str]) -> None:
    found = [code for code, line in codes(scene(tmp_path, world, motion=motion)) if code != "out-of-reach"]
    assert found == expected
    assert all(line in (5, 9) for code, line in codes(str(tmp_path / "own.xml")) if code != "out-of-reach")


@pytest.mark.parametrize(("rate", "noted"), [("250 Hz", True), ("500 Hz", True), ("1 kHz", False), ("4 kHz", False)])
def test_a_loop_that_is_slow_for_a_plate_is_noted_at_its_rate(tmp_path: Path, rate: str, noted: bool) -> None:
    path = Path(scene(tmp_path, BLOCK, motion=DOWN))
    path.write_text(path.read_text().replace("  <world>", f'  <rates servo="{rate}"/>\n  <world>'))
    assert [place for place in codes(str(path)) if place[0] == "slow-servo"] == [("slow-servo", 4)] * noted
    alone = path.read_text().replace(' surface-to="table"', "")
    path.write_text(alone)
    assert not [code for code, _ in codes(str(path)) if code == "slow-servo"], "an arm alone has nobody to change with"


@pytest.mark.parametrize(
    ("room", "safety", "stops"),
    [
        ("23 degC", "", False), ("13 degC", "", False), ("10 degC", "", True), ("43 degC", "", True),
        ("12 degC", "", True), ("12.005 degC", "", True), ("42 degC", "", True), ("12.2 degC", "", False),
        ("27 degC", '<safety temperature="30 35 degC"/>', True),
        ("23 degC", '<safety temperature="30 35 degC"/>', True),
        ("28 degC", '<safety temperature="30 35 degC"/>', False),
    ],
)  # fmt: skip
def test_a_plate_that_would_trip_in_the_room_where_it_begins_is_told(
    tmp_path: Path, room: str, safety: str, stops: bool
) -> None:
    path = Path(scene(tmp_path, BLOCK.replace("/>", ' temperature="32 degC"/>'), motion=DOWN))
    path.write_text(path.read_text().replace("<world>", f'{safety}<world temperature="{room}">'))
    found = [one for one in examined(str(path), None, None)[1] if one.code == "out-of-band"]
    assert [(one.severity, one.place and one.place.line) for one in found] == [("warning", 4)] * stops
    assert all(one.place and one.place.text[one.place.column - 1 :].startswith("temperature=") for one in found)
    engine = itouch.build(path)
    if not stops:
        engine.run(0.1)
    else:
        with pytest.raises((itouch.DeviceError, itouch.DeviceFaultError), match="past its trip"):
            engine.run(0.1)


def test_strict_counts_what_is_odd_as_wrong(tmp_path: Path) -> None:
    path = scene(tmp_path, BLOCK, motion=to("0 0 60 mm", "0 0 30 mm"))
    relaxed, strict = run("check", path), run("check", path, "--strict")
    assert (relaxed.returncode, strict.returncode) == (0, 2)
    assert "note[untouched]" in relaxed.stderr and "within 2 mm of 'block'" in strict.stderr
    assert ": ok (" in relaxed.stdout and ": ok (" not in strict.stdout


def test_a_clipped_stiffness_is_told_once_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "own.xml").write_text(
        HEAD + '  <materials>\n    <material name="steel"><contact stiffness="600 N/mm"/></material>\n  </materials>\n'
        f"  <world>\n    {BLOCK.replace('wood', 'steel')}\n  </world>\n  <interaction>{FINGER}</interaction>\n</itouch>"
    )
    done = run("check", str(tmp_path / "own.xml"))
    assert done.stderr.count("600 N/mm;") == 1 and "own.xml:5:" in done.stderr
    assert "'steel' with stiffness" not in done.stderr + done.stdout


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(SCENES.glob("*.xml")) if "<interaction>" in path.read_text()],
    ids=lambda path: path.stem,
)
def test_no_shipped_scene_has_lengths_overlaps_or_motions_that_are_odd(path: Path) -> None:
    found = {code for code, _ in codes(str(path))}
    assert not found & {"metres", "overlap", "untouched", "two-heights"}


@pytest.mark.parametrize("name", ["rigs/none.xml", "itouch:rigs/none.xml", "itouch:../pyproject.toml", "/etc/passwd"])
def test_a_failed_include_is_one_problem(tmp_path: Path, name: str) -> None:
    path = scene(tmp_path, BLOCK, motion=DOWN)
    text = Path(path).read_text().replace("itouch:rigs/twin.xml", name)
    Path(path).write_text(text)
    done = run("check", path)
    assert done.returncode == 2 and "1 problem; nothing was started." in done.stderr
    assert ":3:12" in done.stderr


def test_other_faults_are_told_beside_a_failed_include(tmp_path: Path) -> None:
    path = scene(tmp_path, BLOCK.replace("size", "sze"))
    Path(path).write_text(Path(path).read_text().replace("itouch:rigs/twin.xml", "twin.xml"))
    said = run("check", path).stderr
    assert "no-such-file" in said and "unknown-attribute" in said and "unknown-name" not in said


def test_a_missing_copy_of_a_shipped_rig_is_told_where_it_is(tmp_path: Path) -> None:
    path = scene(tmp_path, BLOCK)
    Path(path).write_text(Path(path).read_text().replace("itouch:rigs/twin.xml", "rigs/twin.xml"))
    assert 'file="itouch:rigs/twin.xml"' in run("check", path).stderr


def test_a_scene_on_a_shipped_rig_runs_is_saved_and_restored(tmp_path: Path) -> None:
    session = itouch.build(scene(tmp_path, BLOCK, motion=DOWN))
    session.run(0.05)
    session.save(tmp_path / "s.itouch")
    again = itouch.restore(tmp_path / "s.itouch")
    assert again.state.tobytes() == session.state.tobytes()


def test_of_an_operator_that_goes_nowhere_nothing_is_said() -> None:
    """Recorded motions and hands that a person leads have no targets."""
    block = Box(name="block", size=(0.02, 0.02, 0.02), pos=(0.0, 0.0, 0.01), material="wood")
    places = SimpleNamespace(of=lambda *_: None)
    model: Any = SimpleNamespace(objects=("block",), scene=SimpleNamespace(objects=(block,), places=places))
    around = SimpleNamespace(radius=0.008, surface_to="")
    for operator, recorded in ((None, None), (Operator(probe="finger"), None), (Operator(probe="finger"), object())):
        probe: Any = SimpleNamespace(name="finger", operator=operator, recorded=recorded, scene=around)
        assert list(lint._touches(model, probe, {})) == []


def _scene(**more: Any) -> Any:
    block = Box(name="block", size=(0.02, 0.02, 0.02), pos=(0.0, 0.0, 0.01), material="wood")
    hot = replace(block, name="pot", temperature=333.15)
    return SimpleNamespace(
        objects=(block, hot), places=SimpleNamespace(of=lambda *_: None), world=SimpleNamespace(temperature=295.15), **more
    )  # fmt: skip


def test_an_object_that_no_plate_can_be_as_warm_as_is_told_in_degrees() -> None:
    plate: Any = SimpleNamespace(
        name="peltier", limits=SimpleNamespace(temperature=(288.15, 313.15)), reading=lambda role: "plate_temperature"
    )  # fmt: skip
    arm: Any = SimpleNamespace(name="arm", limits=SimpleNamespace(temperature=None), reading=lambda role: None)
    (note,) = lint._outside_band(SimpleNamespace(devices={"arm": arm, "peltier": plate}, scene=_scene()))  # type: ignore[arg-type]
    assert note.code == "out-of-band"
    assert note.sentence.startswith("object 'pot' is at 60 degC, but 'peltier' stays within 15 to 40 degC")


def test_a_material_that_is_rendered_softer_is_told_as_stiff_as_it_is_felt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lint, "contact_of", lambda scene, element, problems: SimpleNamespace(stiffness=5000.0))
    couplings = (SimpleNamespace(stiffness=1235.6), SimpleNamespace(stiffness=1235.6))
    probe = SimpleNamespace(name="finger", coupling=couplings, scene=SimpleNamespace(force_to="arm"))
    (note,) = lint._clipped(SimpleNamespace(probes=(probe,), scene=_scene()))  # type: ignore[arg-type]
    assert "stiffness of 5 N/mm; 'finger' feels 1.24 N/mm, the most that 'arm' renders stably" in note.sentence
    assert note.advice == 'write stiffness="1.23 N/mm", or lower the damping'
