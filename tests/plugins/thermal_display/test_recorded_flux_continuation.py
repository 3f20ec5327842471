"""A finger that has felt a recorded curve goes on as one that has given off that flux."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from display_scenes import Display

import itouch
from contact_heat import live, packing
from itouch_thermal.curve_playback import CurvePlayback, flux_step
from itouch_thermal.heat import FINGER, finger_side, object_side

CONTROL = '<thermal:flux-control display="peltier" desired-from="heat"{}>{}</thermal:flux-control>'


@pytest.fixture(scope="module")
def finger() -> np.ndarray:
    return finger_side(FINGER, 310.15, 306.15, 296.15)


def test_the_flux_that_a_touch_takes_leaves_the_finger_as_the_touch_does(finger: np.ndarray) -> None:
    from itouch_thermal.heat import ThermalMaterial

    wood = ThermalMaterial(conductivity=0.2, specific_heat=1700.0, density=600.0)
    side = object_side(wood, 296.15, 0.02)
    assert side is not None
    model, body = live.side_model(finger, 1e-3, finger=True), live.side_model(side, 1e-3, finger=False)
    one, other = live.initial_state(finger, 1e-3, finger=True), live.initial_state(finger, 1e-3, finger=True)
    below = live.initial_state(side, 1e-3, finger=False)
    before = 0.0
    for step in range(400):
        flux = live.contact_step(model, one, body, below, 2e-3)
        flux_step(model, other, before if step else flux, flux)
        before = flux
    fall = 306.15 - live.surface_temperature(model, one)
    assert fall > 1.0
    assert live.surface_temperature(model, other) == pytest.approx(
        live.surface_temperature(model, one), abs=2e-3 * fall
    )
    tail = int(model[packing.TAIL])
    assert other[tail + packing.HEAT] == pytest.approx(one[tail + packing.HEAT], rel=1e-3)
    for _ in range(300):  # and both recover alike
        live.air_step(model, one)
        live.air_step(model, other)
    assert live.surface_temperature(model, other) == pytest.approx(
        live.surface_temperature(model, one), abs=2e-3 * fall
    )


def test_a_constant_flux_warms_nothing_that_it_should_not(finger: np.ndarray) -> None:
    model = live.side_model(finger, 1e-3, finger=True)
    state, start = (live.initial_state(finger, 1e-3, finger=True) for _ in range(2))
    for _ in range(100):
        flux_step(model, state, 500.0, 500.0)
    fallen = live.surface_temperature(model, start) - live.surface_temperature(model, state)
    effusivity = (0.34 * 1200.0 * 3340.0) ** 0.5  # of the epidermis: the flux comes on top of what the air takes
    assert fallen == pytest.approx(2.0 * (500.0 - _loss(finger)) * (0.1 / np.pi) ** 0.5 / effusivity, rel=0.02)


def _loss(finger: np.ndarray) -> float:
    """Return the flux into the air before [W/m2]."""
    assert finger.air is not None
    return float(finger.air.coefficient * (306.15 - finger.air.ambient))


def test_no_curve_is_no_step() -> None:
    playing = CurvePlayback((None,), 1e-3)
    assert not playing.plays(0) and not playing.plays(-1)
    with pytest.raises(ValueError, match="object 0"):
        playing.step(np.zeros(1), np.zeros(1), 0, 1)


def _run(path: Path) -> tuple[list[float], list[float]]:
    """Return the model finger's surface [K] and the flux desired [W/m2], every tick."""
    engine, surface, desired = itouch.build(path, seed=3), [], []

    def look() -> None:
        surface.append(engine.state["heat.skin_temperature"].item())
        desired.append(engine.state["flux-control.desired"].item())

    engine.run(each=look)
    return surface, desired


def test_the_touch_after_a_played_one_starts_from_the_finger_that_felt_it(scenes: Path) -> None:
    """The curve of aluminium, played on wood, leaves the finger of aluminium; the next touch is computed from it."""
    surface, desired = _run(Display(right="pyrex", hold="0.7 s").write(scenes))
    flux = np.array(desired)
    touches = np.flatnonzero(np.diff((flux != 0.0).astype(int)) == 1) + 1
    ends = np.flatnonzero(np.diff((flux != 0.0).astype(int)) == -1) + 1
    rows = [f"{(i + 1) * 1e-3:.6f},{value!r}" for i, value in enumerate(flux[touches[0] : ends[0]].tolist())]
    curve = "\n".join(["t,j", *rows, ""])
    control = CONTROL.format(' target="file"', '<thermal:curve material="wood" file="al.csv"/>')
    played = Display(left="wood", right="pyrex", hold="0.7 s", control=control, files={"al.csv": curve}).write(scenes)
    surface_played, desired_played = _run(played)
    first, end = touches[0], ends[0] - 5
    for at in (first + 300, end, first + 1200):  # in the touch, at its end, and in the air after it
        fall = surface[first] - surface[at]
        assert fall > 1.0
        assert surface_played[first] - surface_played[at] == pytest.approx(fall, rel=0.01)
    after = slice(touches[1] + 5, ends[1] - 40)
    np.testing.assert_allclose(desired_played[after], flux[after], rtol=0.01)
