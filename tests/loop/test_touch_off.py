"""A touch-off at the end of the travel, and one that is interrupted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import itouch
from itouch.loop import DeviceFaultError
from itouch.loop.touchoff import TouchOffPhase
from itouch_evidence.surface.draw import Wire
from itouch_evidence.surface.scenes import Slope

#: A finger that presses a block whose top is 5 mm high while the plate is looked for.
MOTION = '<to pos="0 0 11 mm" in="0.1 s" hold="9 s"/><to pos="0 0 40 mm" in="0.4 s"/>'


def test_a_plate_that_can_drop_no_further_between_points_is_felt_at_all_of_them(scenes: Path) -> None:
    """The finger is met so low that less than the usual drop is left; waiting for the rest would never end."""
    path = scenes / "rigs" / "twin.xml"
    written = '<mount pos="0 0 -8 mm" mount-error="2 -1.5 3 mm"/>'
    assert written in path.read_text()
    path.write_text(path.read_text().replace(written, '<mount pos="0 0 40 mm" mount-error="0 0 3 mm"/>'))
    with itouch.build(scenes / "four_materials.xml", seed=1) as session:
        session.run(until=lambda: bool(session.state["ready"]) or session.ticks >= 6000)
        assert session.state["ready"].item() == 1
        assert session.state["table.touch_off.target"].item() == 0.0
        assert session.state["table.calibration"][2] == pytest.approx(-3e-3, abs=2e-4)


def test_a_touch_off_that_was_stopped_near_the_finger_rises_as_slowly_as_before(scenes: Path) -> None:
    """Not from where the stop has brought the plate straight to where it was, which is felt later than it should be."""
    path = scenes / "four_materials.xml"
    fault = '<fault device="table" kind="disconnect" at="2 s" for="0.2 s"/>'
    path.write_text(path.read_text().replace("<safety ", f"{fault}<safety "))
    greatest = 0.0

    def ready() -> bool:
        nonlocal greatest
        greatest = max(greatest, abs(session.state["table.wrench"][2].item()))
        return bool(session.state["ready"]) or session.ticks >= 9000

    with itouch.build(path, seed=1) as session:
        with pytest.raises(DeviceFaultError, match="disconnected"):
            session.run(until=ready)
        assert session.state["table.touch_off.stage"].item() == TouchOffPhase.RISE
        session.rearm()
        session.run(until=ready)
        assert session.state["ready"].item() == 1
        assert session.state["table.touch_off.offsets"] == pytest.approx(3e-3, abs=2e-5)
        assert greatest < 0.35


@pytest.mark.parametrize("high", [80, 300])
def test_a_finger_that_is_led_down_to_the_plate_meets_one_that_rises_as_slowly_as_to_any_other(
    scenes: Path, high: int
) -> None:
    """It was led onto a plate at the end of its travel, which it struck with a newton; the height was 0.1 mm wrong."""
    path = scenes / "four_materials.xml"
    begins = '<to pos="66 0 50 mm"  in="0.5 s" hold="2 s"/>'
    assert begins in path.read_text()
    path.write_text(path.read_text().replace(begins, begins.replace("66 0 50 mm", f"66 0 {high} mm")))
    greatest = 0.0
    with itouch.build(path, seed=1) as session:
        while not session.state["ready"] and session.ticks < 12_000:
            session.tick()
            greatest = max(greatest, session.state["finger.plate_force"].item())
        assert session.state["ready"].item() == 1
        assert session.state["table.touch_off.offsets"] == pytest.approx(3e-3, abs=5e-6)
        assert greatest < 0.35


@pytest.mark.parametrize("compiled", [True, False])
def test_a_plate_that_is_felt_where_it_can_go_no_lower_says_so(
    scenes: Path, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its force sensor was not tared, or a finger rests on it: it waited for ever, and said nothing."""
    if not compiled:
        monkeypatch.setattr("itouch.loop.plan.can_join", lambda: False)
    path = scenes / "four_materials.xml"
    fault = '<fault device="table" kind="bias" channel="wrench" amount="0.2 N" at="0 s"/>'
    path.write_text(path.read_text().replace("<safety ", f"{fault}<safety "))
    with itouch.build(path, seed=1) as session:
        with pytest.raises(DeviceFaultError, match="feels 0.2 N though it can go no lower") as caught:
            session.run(until=lambda: bool(session.state["ready"]) or session.ticks >= 12_000)
        assert caught.value.trip.label == "calibration"
        assert session.state["table.touch_off.stage"].item() == TouchOffPhase.PLACE
        assert 5.0 < session.seconds < 8.0


@pytest.mark.parametrize(("noise", "rate"), [(15, 4000), (20, 1000), (40, 1000), (40, 4000)])
def test_the_noise_of_a_force_sensor_is_not_taken_for_a_touch(scenes: Path, noise: int, rate: int) -> None:
    """It gave a height that was wrong by up to 2 mm, or a plate that was stopped because it slid past the finger (K5)."""
    path, world = scenes / "loud.xml", '<box name="b" pos="0 0 0 mm" size="80 60 10 mm" material="stuff"/>'
    motion = '<to pos="0 0 30 mm" in="0.1 s" hold="9 s"/><to pos="0 0 40 mm" in="0.4 s"/>'
    path.write_text(Slope(world, motion, error=2.5, touch_off=True, noise=noise, rate=rate).text(), encoding="utf-8")
    greatest = 0.0
    with itouch.build(path, seed=1) as session:
        while not session.state["ready"] and session.seconds < 9.0:
            session.tick()
            greatest = max(greatest, session.state["finger.plate_force"].item())
        assert session.state["ready"].item() == 1
        assert session.state["table.calibration"][2] == pytest.approx(-2.5e-3, abs=2e-5)
        assert greatest < 0.4


def test_the_noise_of_a_force_sensor_does_not_choose_what_counts(scenes: Path) -> None:
    """Of what it read near the first touch only what its noise made greater counted: the plate was 10 um too high."""
    path, world = scenes / "even.xml", '<box name="b" pos="0 0 0 mm" size="80 60 10 mm" material="stuff"/>'
    motion, found = '<to pos="0 0 30 mm" in="0.1 s" hold="9 s"/><to pos="0 0 40 mm" in="0.4 s"/>', []
    path.write_text(Slope(world, motion, error=1.0, touch_off=True, noise=36, rate=4000).text(), encoding="utf-8")
    for seed in range(8):
        with itouch.build(path, seed=seed) as session:
            while not session.state["ready"]:
                session.tick()
            found.append(session.state["table.calibration"][2].item())
    assert np.mean(found) == pytest.approx(-1e-3, abs=7e-6)
    assert np.std(found) < 4e-6


@pytest.mark.parametrize("error", [0.4, 1.2])
def test_a_finger_that_presses_is_not_handed_over_to_a_plate_that_is_looked_for(scenes: Path, error: float) -> None:
    """It sank towards the plate, by whose height nothing was known: the pad's damping made that wrong by 30 um more."""
    path, world = scenes / "pressed.xml", '<box name="b" pos="0 0 0 mm" size="80 60 10 mm" material="stuff"/>'
    path.write_text(Slope(world, MOTION, error=error, touch_off=True, rate=4000).text(), encoding="utf-8")
    lowest = np.inf
    with itouch.build(path, seed=1) as session:
        while not session.state["ready"] and session.seconds < 9.0:
            session.tick()
            if session.seconds > 1.0:
                lowest = min(lowest, session.state["finger.hand.position"][2].item())
        assert session.state["ready"].item() == 1
        assert session.state["table.calibration"][2] == pytest.approx(-1e-3 * error, abs=1.5e-5)
        assert lowest > session.state["finger.hand.position"][2].item() - 2e-4


@pytest.mark.parametrize("error", [-2.5, 2.5])
def test_an_arm_does_not_let_go_as_the_height_of_the_plate_is_found(scenes: Path, error: float) -> None:
    """The correction was taken for a plate that rises by 2.5 mm in a tick, for which the arm made room at once."""
    path, world = scenes / "pressed.xml", '<box name="b" pos="0 0 0 mm" size="80 60 10 mm" material="stuff"/>'
    slope = Slope(world, MOTION.replace("11 mm", "10 mm"), error=error, touch_off=True)
    path.write_text(slope.text(), encoding="utf-8")
    with itouch.build(path, seed=1) as session:
        session.run(until=lambda: bool(session.state["ready"]) or session.ticks >= 9000)
        assert session.state["ready"].item() == 1
        assert session.state["finger.normal_force"].item() > 0.5
        forces = [np.linalg.norm(session.state["arm.sent.wrench"][:3])]
        for _ in range(20):
            session.tick()
            forces.append(np.linalg.norm(session.state["arm.sent.wrench"][:3]))
    assert np.abs(np.diff(forces)).max() < 0.1


@pytest.mark.parametrize("noise", [None, 20.0])
@pytest.mark.parametrize("error", [-2.0, 2.0])
@pytest.mark.parametrize(("period", "delay"), [(3e-3, 1e-3), (9e-3, 5e-3)])
def test_behind_a_wire_the_height_is_found_where_finger_and_plate_were_when_it_was_measured(
    scenes: Path, period: float, delay: float, error: float, noise: float | None
) -> None:
    """A finger in the air gives way to a plate that rises: against where it was later, that seemed 0.04 mm too high."""
    motion = '<to pos="0 0 40 mm" in="0.1 s" hold="9 s"/>'
    scene = Slope("", motion, touch_off=True, error=error, noise=noise)
    with scene.build(scenes, catalog=Wire(period, delay).catalog()) as session:
        session.run(until=lambda: bool(session.state["ready"]) or session.ticks >= 9000)
        assert session.state["ready"].item() == 1
        assert session.state["table.calibration"][2] == pytest.approx(-error * 1e-3, abs=1.2e-5)
