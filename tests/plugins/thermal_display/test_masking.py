"""Before the touch the display's current is as noisy for every material, if a study asks for it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from display_scenes import CONTROL, Display
from numpy.typing import NDArray

import itouch
from itouch.plugin import Role
from itouch_thermal.flux import joined
from itouch_thermal.flux.masking import masked

EQUAL = CONTROL.replace("/>", ' equalise="yes" preset-noise="0.2 A"/>')
BARE = CONTROL.replace("/>", ' equalise="yes"/>')


def test_the_noise_is_white_even_and_of_the_tick_alone() -> None:
    drawn = np.array([masked(0.0, 0.2, 4.0, tick) for tick in range(20_000)])
    assert drawn.tolist() == [masked(0.0, 0.2, 4.0, tick) for tick in range(20_000)]
    assert np.abs(drawn).max() <= 0.2
    assert drawn.mean() == pytest.approx(0.0, abs=4 * 0.2 / math.sqrt(3 * 20_000))
    assert drawn.std() == pytest.approx(0.2 / math.sqrt(3), rel=0.02)
    for lag in (1, 2, 3, 7):
        assert abs(np.corrcoef(drawn[:-lag], drawn[lag:])[0, 1]) < 0.03


def test_what_may_flow_holds_for_current_and_noise_together() -> None:
    for current in (-9.0, -3.95, 0.0, 3.9, 9.0):
        assert max(abs(masked(current, 0.2, 4.0, tick)) for tick in range(500)) <= 4.0
    assert masked(3.3, 0.0, 4.0, 7) == 3.3  # nobody asked: nothing changes


def currents(engine: itouch.Session) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what was sent to the display in the last 1.5 s before the first touch, and in it [A]."""
    drive = engine.model.devices["peltier"].command(Role.DRIVE)
    assert drive is not None
    sent: tuple[list[float], list[float]] = ([], [])

    def note(tick: int) -> None:
        touched = int(engine.state["finger.contact.object"]) >= 0
        sent[touched].append(float(engine.state[f"peltier.sent.{drive.name}"].item()))

    engine.taps.append(note)
    engine.run(10.0, until=lambda: bool(sent[1]))
    engine.run(0.4)
    return np.array(sent[0][-1500:]), np.array(sent[1][200:])


def noise_of(sent: NDArray[np.float64]) -> float:
    """Return what the audit hears [dB]: the mean change of the change."""
    return 20.0 * math.log10(float(np.abs(np.diff(sent, 2)).mean()))


def test_no_material_is_noisier_than_another_before_the_touch(scenes: Path) -> None:
    heard: dict[str, list[float]] = {BARE: [], EQUAL: []}
    for control, found in heard.items():
        for material in ("aluminium", "polystyrene"):
            engine = itouch.build(Display(left=material, control=control, wait="1.2 s").write(scenes))
            before, after = currents(engine)
            found.append(noise_of(before))
            assert np.abs(before).max() <= 6.0
            assert noise_of(after) < -30.0  # in the touch nothing is added
    assert np.ptp(heard[BARE]) > 6.0
    assert np.ptp(heard[EQUAL]) < 1.0  # what is just heard


def test_noise_goes_with_equal_times() -> None:
    from itouch_thermal.flux.flux_control_params import FluxControlParams

    with pytest.raises(ValueError, match="preset-noise goes with"):
        FluxControlParams(display="peltier", desired_from="heat", preset_noise=0.1)


def test_compiled_and_python_ticks_add_the_same_noise(scenes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, states = Display(left="polystyrene", control=EQUAL).write(scenes), []
    for joins in (joined.joins, lambda model, state: False):
        monkeypatch.setattr(joined, "joins", joins)
        engine = itouch.build(path)
        engine.run(0.5)
        states.append(engine.state.tobytes())
    assert states[0] == states[1]
