"""Before the touch: the plate's start temperature, readiness, equal times for all materials, switching times."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from display_scenes import CONTROL, Display

import itouch
from itouch_thermal import cli
from itouch_thermal.display import DisplayParams
from itouch_thermal.display.switching import least_time, strongest
from itouch_tools.report.screen import Screen

EQUAL = '<thermal:flux-control display="peltier" desired-from="heat" equalise="yes"/>'
PAPER = '<thermal:flux-control display="peltier" desired-from="heat" controller="paper"/>'


def until_touch(engine: itouch.Session, index: int) -> list[tuple[int, int, float, float]]:
    """Run until an object is touched; return tick, object near, readiness and plate [K] of every tick."""
    rows = []
    state = engine.state
    while int(state["finger.contact.object"]) != index:
        engine.tick()
        rows.append((
            int(state["tick"]), int(state["finger.near_object"]), float(state["flux-control.readiness"]),
            float(state["peltier.twin.true_plate"]),
        ))  # fmt: skip
    return rows


def status(engine: itouch.Session) -> str:
    """Return what the live line shows of the flux control."""
    (control,) = [m for m in engine.model.modalities if m.name == "flux-control"]
    return str(control.instance.status(control.model, engine.state))


@pytest.mark.parametrize("control", [CONTROL, PAPER])
def test_the_plate_goes_to_the_start_temperature_of_what_is_near(scenes: Path, control: str) -> None:
    engine = itouch.build(Display(right="polystyrene", control=control, near="1.2 s").write(scenes))
    until_touch(engine, 0)
    first = float(engine.state["flux-control.start_temperature"])
    assert float(engine.state["peltier.twin.true_plate"]) == pytest.approx(first, abs=0.4)
    rows = until_touch(engine, 1)
    second = float(engine.state["flux-control.start_temperature"])
    assert second > first + 3.0
    assert rows[-2][3] == pytest.approx(second, abs=0.2)
    near = [row for row in rows if row[1] == 1]
    assert near[20][2] < 1.0  # not ready while it goes there
    assert near[-1][2] == 1.0
    entries = engine.report()["contacts"]
    assert [entry["plate_ready"] for entry in entries] == [True, True]
    assert "desired" in status(engine)
    engine.run(1.9)
    assert status(engine).endswith("%") or status(engine).endswith("ready")


def test_a_touch_before_readiness_is_marked_and_counted(scenes: Path) -> None:
    path = Display(right="polystyrene", near="0 s").write(scenes)
    text = path.read_text(encoding="utf-8")
    hurry = '<to pos="30 0 48 mm"  in="0.8 s" hold="0 s"/>\n        <to pos="30 0 22 mm"  in="0.7 s"'
    assert hurry in text
    path.write_text(text.replace(hurry, '<to pos="30 0 30 mm" in="0.45 s"/>\n<to pos="30 0 22 mm" in="0.1 s"'))
    engine = itouch.build(path)
    engine.run()
    report = engine.report()
    late = [entry["plate_ready"] for entry in report["contacts"]]
    assert late == [True, False]
    stream = io.StringIO()
    Screen(engine, stream).finish(report)
    assert "right at" in stream.getvalue()
    assert "before the plate was ready" in stream.getvalue()
    assert report["modalities"]["flux-control"]["contacts_before_ready"] == late.count(False)


@pytest.mark.parametrize("right", ["polystyrene", "aluminium"])
def test_equalised_readiness_takes_the_same_time_for_every_material(scenes: Path, right: str) -> None:
    path = Display(left="aluminium", right=right, control=EQUAL, near="1.6 s").write(scenes)
    text = path.read_text(encoding="utf-8")  # both scenes hold all four materials, so that the longest switch is one
    extra = '<box name="far" pos="0 500 0 mm" size="10 10 10 mm" material="polystyrene"/>'
    path.write_text(text.replace("</world>", extra + "</world>"), encoding="utf-8")
    engine = itouch.build(path)
    until_touch(engine, 0)
    rows = until_touch(engine, 1)
    aimed = next(row[0] for row in rows if row[1] == 1)
    ready = next(row[0] for row in rows if row[0] > aimed + 1 and row[2] >= 1.0)
    preset = engine.report()["modalities"]["flux-control"]["preset_s"]
    assert preset > 0.8
    assert (ready - aimed) * 1e-3 == pytest.approx(preset, abs=2e-3)


def test_the_table_does_not_tell_the_material(scenes: Path) -> None:
    """Up to the touch the table's command is the same to the bit, whatever material is there."""
    moves = []
    for material in ("aluminium", "polystyrene"):
        engine = itouch.build(Display(left=material, control=EQUAL).write(scenes), seed=8)
        goals = []
        while int(engine.state["finger.contact.object"]) < 0:
            engine.tick()
            goals.append(engine.state["table.sent.pose_target"].copy())
        moves.append(np.array(goals))
    np.testing.assert_array_equal(moves[0], moves[1])


def test_a_preset_time_must_be_long_enough(scenes: Path) -> None:
    short = EQUAL.replace("/>", ' preset-time="0.1 s"/>')
    with pytest.raises(itouch.SceneError, match="too short"):
        itouch.build(Display(right="polystyrene", control=short).write(scenes))


def test_switching_times_are_reported_and_printed(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = Display(right="polystyrene").write(scenes)
    engine = itouch.build(path)
    rows = engine.report()["modalities"]["flux-control"]["switching"]
    assert {(row["from"], row["to"]) for row in rows} == {("aluminium", "polystyrene"), ("polystyrene", "aluminium")}
    assert rows[0]["seconds"] == rows[1]["seconds"]
    assert 0.4 < rows[0]["seconds"] < 1.0
    file = scenes / "times.json"
    assert cli.main(["switching", str(path), "--json", str(file)]) == 0
    assert [row["seconds"] for row in json.loads(file.read_text())] == [row["seconds"] for row in rows]
    assert "polystyrene" in capsys.readouterr().out
    assert cli.main(["switching", str(scenes / "none.xml")]) == 2


def test_the_least_time_is_what_the_heat_needs_and_a_little_more() -> None:
    display = DisplayParams()
    times = [least_time(display, 296.15, 296.15 + change) for change in (0.0, 0.04, 1.0, 4.0, 8.4)]
    assert times[0] == times[1] == 0.0
    assert times == sorted(times)
    for change, time in ((1.0, times[2]), (4.0, times[3]), (8.4, times[4])):
        heat = (change - 0.05) * 2.804e3 / display.flux_limit
        assert heat < time < heat + 0.05
    assert least_time(display, 296.15, 300.15, limit=strongest(display, 1.0)) > 2.0 * times[3]


def test_an_object_out_of_the_plates_band_is_clipped_and_marked(scenes: Path) -> None:
    path = Display().write(scenes)
    text = path.read_text(encoding="utf-8")
    path.write_text(
        text.replace('material="aluminium"/>', 'material="aluminium" temperature="2 degC"/>'), encoding="utf-8"
    )
    engine = itouch.build(path)
    coldest = 400.0
    while not engine.done:
        engine.tick()
        coldest = min(coldest, float(engine.state["peltier.twin.true_plate"]))
    left, right = engine.report()["contacts"]
    assert left["plate_limited"] is True
    assert right["plate_limited"] is False
    assert coldest > 288.15 - 0.3


def test_a_weak_or_slow_module_takes_as_long_as_its_heat() -> None:
    weak = DisplayParams(flux_limit=100.0)
    assert least_time(weak, 288.15, 313.15) == pytest.approx(24.95 * 2.804e3 / 100.0, rel=0.01)
    assert strongest(DisplayParams(resistance=100.0), 6.4) < 2e3


def test_a_clipped_start_temperature_is_of_the_touch_that_it_was_for(scenes: Path) -> None:
    """The next aim is another object's: what stands in the report was so when the plate met the finger."""
    path = Display(right="wood", near="1.5 s").write(scenes)
    text = path.read_text()
    cold = text.replace('material="aluminium"', 'material="aluminium" temperature="4 degC"', 1)
    assert cold != text
    path.write_text(cold)
    engine = itouch.build(path)
    engine.run()
    first, second = engine.report()["contacts"][:2]
    assert (first["plate_limited"], second["plate_limited"]) == (True, False)
