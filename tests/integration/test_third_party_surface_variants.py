"""Surfaces of strangers where a lab's differ from ours: without a force sensor, behind a wire, brought by what lies."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES
from test_third_party_surface import PLUGIN, SCENE
from test_third_party_surface_modality import ASKED, EXAMPLE
from third_party_plugins import install

import itouch
from itouch.plugin import Role
from itouch.testing import suites
from itouch_tools.cli import main

NUMBERS = itertools.count()
FORCELESS = PLUGIN.replace(
    '        Channel("strain", 6, "N", (-20.0,) * 6, (20.0,) * 6, role=Role.CONTACT_FORCE, doc="on the prop"),\n', ""
).replace('        reading["strain"][:3], reading["strain"][3:] = state["load"], 0\n', "")
WIRED = PLUGIN.replace(
    "    Params, Twin = Reach, Moves\n",
    "    Params, Twin = Reach, Moves\n    blocking, period, delay = True, 0.02, 0.02\n",
)
STUCK = WIRED.replace(
    'state["tip"] += (',
    'state["tip"] += (0.0 if command["prop_goal"][2] + 0.002 < state["tip"][2] > 0.005 else 1.0) * (',
)
ASIDE = WIRED.replace('state["tip"] += (', 'state["tip"] += (state["tip"][2] < 0.005, 1.0, 1.0) * (')
LIES = """
class Lies(Hover):
    def update(self, model, state, period):
        super().update(model, state, period)
        state[f"{model.name}.away"] = math.inf
        state[f"{model.robot}.command.{model.channel}"][2] = -0.05 if state["tick"].item() < 600 else 5.0
"""
PRESSES = """
class Presses(Hover):
    def update(self, model, state, period):
        super().update(model, state, period)
        if state[f"{model.name}.renders"]:
            state[f"{model.robot}.command.{model.channel}"][2] += 0.004
"""
WHOLE = """
class Whole(Hover):
    def fields(self, model):
        return tuple(Field(f.name, "i4" if f.name == "there" else "f8", unit=f.unit, doc=f.doc) for f in super().fields(model))
"""

Made = Callable[..., Path]


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Made:
    """Return what installs a robot, with a modality or without, and writes a scene of it."""

    def write(robot: str, *, brings: str = "", hold: float = 0.5, safety: str = "") -> Path:
        module = f"strangers_robo_{next(NUMBERS)}"
        code = robot + (EXAMPLE + brings if brings else "")
        entries = "[itouch.devices]\nrobo = {0}:Presenter\n"
        if brings:
            name = brings.split("class ")[1].split("(")[0]
            entries += f"[itouch.modalities]\nrobo.brings = {{0}}:{name}\n"
        site = install(tmp_path / module, module, entries.format(module), code=code)
        monkeypatch.syspath_prepend(str(site))
        text = SCENE.replace('in="0.5 s" hold="0.5 s"/>', f'in="0.5 s" hold="{hold} s"/>')
        text = text.replace("</interaction>", f"</interaction><safety {safety}/>" if safety else "</interaction>")
        if brings:
            text = text.replace("<operator", ASKED.format(""), 1)
            text = text.replace('xmlns:usb-arm="', 'xmlns:robo="urn:itouch:plugin:robo" xmlns:usb-arm="', 1)
        path = tmp_path / f"{module}.xml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def watched(session: itouch.Session, *fields: str) -> list[list[float]]:
    """Return what will hold these fields, tick by tick."""
    found: list[list[float]] = []
    state = session.state
    session.taps.append(
        lambda tick: found.append([float(np.asarray(state[field]).reshape(-1)[-1]) for field in fields])
    )
    return found


def test_the_time_in_contact_is_counted_without_a_force_sensor(made: Made) -> None:
    """T4: the finger rests for 4 s on a prop whose force nobody measures; it withdraws after 2 s."""
    session = itouch.build(made(FORCELESS, hold=4.0, safety='contact-time="2 s"'))
    rows = watched(session, "tip.plate_force", "presenter.surface.contact_time", "presenter.surface.withdrawn")
    session.run()
    truly = sum(force > 0.05 for force, _, _ in rows) * 1e-3
    assert max(row[2] for row in rows) == 1.0
    assert truly < 2.5
    withdrawn = next(index for index, row in enumerate(rows) if row[2])
    assert max(row[0] for row in rows[withdrawn + 300 : withdrawn + 800]) == 0.0


def test_a_surface_behind_a_wire_withdraws_without_a_fault(made: Made) -> None:
    """T4 sends it down at 0.25 m/s; what is read of it is 20 to 40 ms old, and it was not astray (K6)."""
    session = itouch.build(made(WIRED, hold=4.0, safety='contact-time="2 s"'))
    rows = watched(session, "presenter.surface.withdrawn", "tip.tracking")
    session.run()
    assert max(row[0] for row in rows) == 1.0
    assert max(row[1] for row in rows) > 0.005  # by the newest command it seemed to be
    assert session.report()["faults"] == []


@pytest.mark.parametrize("robot", [PLUGIN, WIRED], ids=["at once", "behind a wire"])
def test_a_modality_is_told_the_force_on_its_surface_as_it_is_read(made: Made, robot: str) -> None:
    """Behind a wire it was told of none, if it said nothing of the force by itself."""
    session = itouch.build(made(robot, brings="\nclass Plain(Hover):\n    pass\n"))
    name = session.model.devices["presenter"].field(Role.CONTACT_FORCE)
    rows: list[tuple[float, float]] = []
    session.taps.append(
        lambda tick: rows.append((session.state["tip.surface.borne"].item(), -session.state[name][2].item()))
    )
    session.run()
    assert max(read for _, read in rows) > 0.3
    assert [borne for borne, _ in rows] == [max(0.0, read) for _, read in rows]


def test_one_that_is_stuck_behind_a_wire_is_astray(made: Made) -> None:
    session = itouch.build(made(STUCK, hold=4.0, safety='contact-time="2 s"'))
    with pytest.raises(itouch.DeviceFaultError, match="from its command"):
        session.run()
    assert session.report()["faults"][0]["trip"] == "tracking"


def test_one_whose_drive_is_stuck_while_the_finger_goes_to_and_fro_is_astray_behind_a_wire(made: Made) -> None:
    """Its goal passes the place where it is stuck again and again."""
    path = made(ASIDE)
    ways = "".join(f'<to pos="{15 * (-1) ** n} 0 25 mm" in="0.15 s"/>' for n in range(16))
    text = path.read_text(encoding="utf-8").replace(
        '<to pos="0 0 40 mm" in="0.3 s"', ways + '<to pos="0 0 40 mm" in="0.3 s"'
    )
    path.write_text(text, encoding="utf-8")
    session = itouch.build(path)
    with pytest.raises(itouch.DeviceFaultError, match="from its command"):
        session.run()
    assert session.report()["faults"][0]["trip"] == "tracking"


def test_what_is_said_of_a_distance_loosens_no_speed(made: Made) -> None:
    """A modality says that the prop is out of reach, and sends it up: near the finger it goes no faster than it may."""
    session = itouch.build(made(PLUGIN, brings=LIES))
    rows = watched(session, "presenter.sent.prop_goal")
    heights: list[float] = []
    state = session.state
    session.taps.append(lambda tick: heights.append(state["presenter.sent.prop_goal"][2].item()))
    gaps: list[float] = []
    session.taps.append(lambda tick: gaps.append(float(state["tip.hip"][2] - 0.008 - state["presenter.prop"][2])))
    session.run()
    steps = np.diff(heights)
    near = steps[np.array(gaps[1:]) < 0.02]
    assert len(rows) == len(heights)
    assert near.max() <= 0.10e-3 + 1e-9
    assert steps.max() > 0.10e-3 + 1e-6  # further away it may


def test_a_surface_that_is_brought_yields_like_one_that_is_carried(made: Made) -> None:
    """K4: with 0.3 N at most the prop gives way, though who brings it pushes it 4 mm into the finger."""
    peaks = []
    for safety in ("", 'plate-force="0.3 N"'):
        session = itouch.build(made(PLUGIN, brings=PRESSES, hold=2.0, safety=safety))
        rows = watched(session, "tip.plate_force")
        session.run()
        assert session.report()["faults"] == []
        peaks.append(max(row[0] for row in rows[900:]))
    assert peaks[1] < 0.5 * peaks[0]
    assert peaks[1] < 0.75


def test_how_a_surface_stands_is_said_in_whole_numbers_or_real_ones_of_eight_bytes(made: Made) -> None:
    with pytest.raises(itouch.ItouchError, match=r"field 'there', which it does not declare as one number \(f8\)"):
        itouch.build(made(PLUGIN, brings=WHOLE))


ALONE = """
@dataclass(frozen=True, slots=True)
class Bare:
    probe: str = schema.ref("probe", doc="the finger")


class Alone(Hover):
    Params = Bare

    def compile(self, name, params, world):
        robot = world.surfaces[params.probe].device
        return super().compile(name, Brings(probe=params.probe, robot=robot), world)


class Nothing(Alone):
    def surface_fields(self, model):
        return None
"""


@pytest.fixture
def carried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Made:
    """Return what installs a robot and three ways to bring its surface, and writes a scene with these attributes."""

    def write(attributes: str, defaults: str = "") -> Path:
        module = f"strangers_carrier_{next(NUMBERS)}"
        ways = "hovering = {0}:Alone\nidle = {0}:Nothing\nasking = {0}:Hover\n"
        entries = f"[itouch.devices]\nrobo = {{0}}:Presenter\n[itouch.carriers]\n{ways}".format(module)
        site = install(tmp_path / module, module, entries, code=PLUGIN + EXAMPLE + ALONE)
        monkeypatch.syspath_prepend(str(site))
        text = SCENE.replace("<probe ", f"<probe {attributes} ", 1)
        text = text.replace("<materials>", f"<defaults>{defaults}</defaults><materials>", 1) if defaults else text
        path = tmp_path / f"{module}.xml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize(("attributes", "defaults"), [('carrier="hovering"', ""), ("", '<probe carrier="hovering"/>')])
def test_a_scene_says_once_who_brings_surfaces_to_its_probes(carried: Made, attributes: str, defaults: str) -> None:
    """Without an element of its own: the stranger's prop waits further away than the program's own way has it."""
    session = itouch.build(carried(attributes, defaults))
    rows = watched(session, "tip.carrier.away", "tip.carrier.renders")
    session.run()
    found = np.array(rows)
    assert found[found[:, 1] > 0, 1].size > 100  # it is felt
    modality = next(one for one in session.model.modalities if one.default_of == "tip")
    assert modality.plugin == "hovering" and modality.instance.__class__.__name__ == "Alone"


@pytest.mark.parametrize(
    ("attributes", "told"),
    [
        ('carrier="hoverin"', "nothing called 'hoverin' is installed that brings a surface"),
        ('carrier="idle"', "modality 'tip.carrier' of 'idle' carries no surface"),
        (
            'carrier="asking"',
            "'asking' can't bring a surface to probe 'tip' by the probe's name alone: it also needs 'robot'",
        ),
    ],
)
def test_what_can_t_bring_a_surface_by_itself_is_told_at_the_attribute(
    carried: Made, attributes: str, told: str
) -> None:
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(carried(attributes))
    (problem,) = caught.value.problems
    assert told in problem.sentence and problem.place is not None and problem.place.line > 1
    if "hoverin" in told:
        assert "did you mean 'hovering'?" in problem.advice


def test_a_carrier_without_a_surface_is_a_mistake(carried: Made) -> None:
    path = carried('carrier="hovering"')
    path.write_text(path.read_text(encoding="utf-8").replace('surface-to="presenter"', ""), encoding="utf-8")
    with pytest.raises(itouch.SceneError, match="with 'carrier' also needs 'surface-to'"):
        itouch.build(path)


def examined(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Let `test-plugin` make only these checks."""
    monkeypatch.setattr(suites, "MODALITY_CHECKS", [one for one in suites.MODALITY_CHECKS if one.name in names])


def test_what_brings_a_surface_by_its_name_alone_can_be_examined(
    carried: Made, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It has no element of which its parameters could be taken, and no name of a modality."""
    path = carried('carrier="hovering"')
    examined(monkeypatch, "parameters", "params-untouched")
    for given in ([], ["--scene", str(path)]):
        assert main(["test-plugin", "hovering", *given]) == 0
        assert "modality 'hovering' 1.0" in (said := capsys.readouterr().out) and "2 passed, 0 failed" in said
    assert main(["test-plugin", "hoverin"]) == 2
    assert "did you mean 'hovering'?" in capsys.readouterr().err
    assert main(["test-plugin", "idle", "--scene", str(path)]) == 2
    assert "does not use 'idle', so nothing could be taken from it" in (said := capsys.readouterr().err)
    assert "it uses hovering, robo" in said
    assert main(["test-plugin", "asking"]) == 2
    assert "it also needs 'robot'" in capsys.readouterr().err


@pytest.mark.long
def test_the_programs_own_way_is_examined_in_a_scene_that_names_none(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    examined(monkeypatch, "params-untouched")
    for given in ([], ["--scene", str(SCENES / "four_materials_hurried.xml")]):
        assert main(["test-plugin", "encountered", *given]) == 0
        assert "1 passed, 0 failed" in capsys.readouterr().out
