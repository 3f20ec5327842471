"""Flux control in a scene at all its rates, by current and by temperature, touch after touch: no instability."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from display_scenes import CONTROL, Display

import itouch
from itouch_thermal.flux import joined
from itouch_thermal.flux.modality import FluxControl

HOLDS_TEMPERATURE = {
    "hardware": '<thermal:hardware command="temperature"/>',
    "limits": '<limits temperature="15 40 degC"/>',
}


#: One of the two materials plays a curve.
PLAYED = {
    "control": '<thermal:flux-control display="peltier" desired-from="heat" target="file">'
    '<thermal:curve material="pyrex" file="curve.csv"/></thermal:flux-control>',
    "files": {"curve.csv": "t,j\n0,1200\n0.3,900\n0.7,800\n"},
}


def rate(text: str) -> str:
    return f' flux-control="{text}"' if text else ""


@pytest.mark.parametrize("hertz", ["", "500 Hz", "250 Hz", "50 Hz"])
def test_every_touch_is_followed_at_every_rate(scenes: Path, hertz: str) -> None:
    path = Display(left="pyrex", right="aluminium", rates=rate(hertz)).write(scenes)
    engine = itouch.build(path, seed=4)
    band = []
    while not engine.done:
        engine.tick()
        band.append(float(engine.state["peltier.twin.true_plate"]))
    report = engine.report()
    assert [entry["object"] for entry in report["contacts"]] == ["left", "right"]
    for entry in report["contacts"]:
        assert entry["plate_ready"]
        assert entry["flux_error_rms"] < 0.02, (hertz, entry["object"])
    assert report["faults"] == []
    assert min(band) > 288.15
    assert max(band) < 313.15


def test_a_slower_model_finger_prepares_and_leads_a_touch_as_well(scenes: Path) -> None:
    """The controller looks ahead in steps of the servo loop, from the states of a model finger with longer ones."""
    shipped = (scenes / "thermal_display.xml").read_text(encoding="utf-8")
    path = scenes / "slower.xml"
    path.write_text(shipped.replace('flux-control="50 Hz"', 'heat="100 Hz"'), encoding="utf-8")
    engine = itouch.build(path, seed=1)
    engine.run(9.0)
    assert engine.report()["contacts"][0]["flux_error_rms"] < 0.02


@pytest.mark.parametrize("hertz", ["250 Hz", "100 Hz"])
def test_the_rate_of_the_model_finger_hardly_changes_what_is_obtained(scenes: Path, hertz: str) -> None:
    means = []
    for rates in ("", f' heat="{hertz}"'):
        engine = itouch.build(Display(left="pyrex", right="aluminium", rates=rates).write(scenes), seed=4)
        engine.run()
        means.append([entry["mean_flux_W_m2"] for entry in engine.report()["contacts"]])
    assert len(means[0]) == 2
    assert means[1] == pytest.approx(means[0], rel=0.01)


@pytest.mark.parametrize(("servo", "heat"), [("4 kHz", ""), ("1 kHz", "50 Hz"), ("250 Hz", "")])
def test_the_flux_error_counts_until_the_finger_lifts_at_every_rate(scenes: Path, servo: str, heat: str) -> None:
    """Not after it, and all of it before, also where a slow loop lets the finger bounce on the plate.

    Whether it came back in the last two ticks of the touch is known too late: a flux is read a tick after it flows, and
    counts in the tick after that.
    """
    display = Display(left="pyrex", servo=servo, rates=heat and f' heat="{heat}"', near="0.1 s", hold="0.6 s")
    engine = itouch.build(display.write(scenes), seed=4)
    found, begun = [], False
    while not begun or engine.state["heat.in_contact"].item():
        engine.tick()
        begun |= bool(engine.state["heat.in_contact"].item())
        found.append((engine.state["heat.desired"].item(), engine.state["peltier.twin.true_flux"].item()))
    (desired, obtained), entry = np.array(found).T, engine.report()["contacts"][0]
    times = np.arange(1, len(found) + 1) * engine.model.period - entry["begin_s"]
    counts = np.flatnonzero((times > 0.1) & (desired != 0.0))
    known = np.flatnonzero(obtained[: np.flatnonzero(desired)[-1] - 1])
    counts = counts[counts <= known[-1]]
    error = (obtained - desired)[counts] / np.maximum(np.abs(desired[counts]), 50.0)
    assert entry["flux_error_rms"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.1)


@pytest.mark.parametrize("hertz", ["", "50 Hz"])
def test_a_driver_that_holds_a_temperature_does_as_well(scenes: Path, hertz: str) -> None:
    path = Display(left="pyrex", right="wood", rates=rate(hertz), **HOLDS_TEMPERATURE).write(scenes)
    engine = itouch.build(path, seed=4)
    targets, currents = [], []
    while not engine.done:
        engine.tick()
        targets.append(float(engine.state["peltier.sent.temperature_target"][0]))
        currents.append(abs(float(engine.state["peltier.actual_current"][0])))
    assert "peltier.command.current" not in engine.state
    assert all(entry["flux_error_rms"] < 0.04 for entry in engine.report()["contacts"])
    assert min(targets) >= 288.15
    assert max(targets) <= 313.15
    assert 1.0 < max(currents) <= 6.4 * 1.01
    assert engine.state["peltier.sent.output"][0] == 1.0


@pytest.mark.parametrize("hertz", ["", "500 Hz", "50 Hz"])
@pytest.mark.parametrize("what", [{}, HOLDS_TEMPERATURE, PLAYED])
def test_compiled_updates_do_at_each_rate_what_python_does(
    scenes: Path, hertz: str, what: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the driver holds a temperature, and where a curve is played."""
    path = Display(left="pyrex", right="aluminium", rates=rate(hertz), **what).write(scenes)
    compiled = itouch.build(path, seed=4)
    step = next(step for step in compiled.plan.steps if step.name == "flux-control")
    assert len(step.bounds) > 2
    monkeypatch.setattr(joined, "joins", lambda model, state: False)
    python = itouch.build(path, seed=4)
    while not compiled.done:
        compiled.tick()
        python.tick()
        assert compiled.state.tobytes() == python.state.tobytes(), compiled.ticks


@pytest.mark.parametrize("what", [HOLDS_TEMPERATURE, PLAYED])
def test_no_update_of_these_is_left_to_python(
    scenes: Path, what: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    left: list[int] = []
    update = FluxControl.update

    def counted(self: FluxControl, model: Any, state: Any, period: float) -> None:
        left.append(1)
        update(self, model, state, period)

    monkeypatch.setattr(FluxControl, "update", counted)
    engine = itouch.build(Display(left="pyrex", **what).write(scenes), seed=4)
    assert left  # what came before the first tick was Python
    left.clear()
    while not engine.done:
        engine.tick()
    assert [entry["plate_ready"] for entry in engine.report()["contacts"]] == [True, True]
    assert not left


def test_between_two_updates_a_modality_in_python_does_not_stop_the_plan(scenes: Path) -> None:
    paper = CONTROL.replace("/>", ' controller="paper"/>')
    engine = itouch.build(Display(rates=rate("50 Hz"), control=paper).write(scenes))
    step = next(step for step in engine.plan.steps if step.name == "flux-control")
    assert (step.code, step.every) == ("Python", 20)
    assert engine.plan.whole is not None


def test_what_a_driver_of_temperature_does_is_safe_when_it_stops(scenes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, broken = Display(**HOLDS_TEMPERATURE).write(scenes), False
    control = type(next(m.instance for m in itouch.build(path).model.modalities if m.commands))
    sound = control.update

    def update(self, model, state, period) -> None:
        sound(self, model, state, period)
        if broken:
            state["peltier.command.temperature_target"] = np.nan

    monkeypatch.setattr(control, "update", update)
    monkeypatch.setattr(control, "bound_update", lambda *_: ())
    engine = itouch.build(path)
    engine.run(6.0)
    assert engine.state["peltier.sent.output"][0] == 1.0
    broken = True
    with pytest.raises(itouch.ItouchError):
        engine.run(0.1)
    assert engine.state["peltier.sent.output"][0] == 0.0
    assert engine.report()["faults"][0]["device"] == "peltier"


def test_a_scene_at_half_the_servo_rate_runs_too(scenes: Path) -> None:
    engine = itouch.build(Display(left="wood", servo="500 Hz").write(scenes), seed=2)
    engine.run()
    assert all(entry["flux_error_rms"] < 0.03 for entry in engine.report()["contacts"])
