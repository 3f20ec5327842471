"""A surface whose force sensor is noisy keeps its laws: noise is measured in the air, and decides nothing."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
from kernels_in_python import kernel_of
from shipped import SCENES

from itouch.loop import render
from itouch.loop.surface import force_estimate, surface_memory
from itouch_evidence.surface import run
from itouch_evidence.surface.course import Floats, follow
from itouch_evidence.surface.draw import draw, draw_wire
from itouch_evidence.surface.laws import broken, judge
from itouch_evidence.surface.scenes import RADIUS, Slope, ramp

_estimate, _late = kernel_of(force_estimate.estimate), kernel_of(force_estimate.estimate_late)
_believed = kernel_of(force_estimate.believed)

#: Stiffness of the finger's pad [N/m], and how far away a surface surely is [m].
PAD, AWAY = 1000.0, -5e-3


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("loud") / "scenes"
    shutil.copytree(SCENES, path)
    return path


class Sensor:
    """A sensor with this noise [N rms], the surface's memory, and what was estimated in each tick [N]."""

    def __init__(self, noise: float, rate: int = 1000) -> None:
        self.noise, self.period = noise, 1.0 / rate
        self.rng = np.random.default_rng(3)
        self.constants, self.memory = np.zeros(render.CONSTANTS), np.zeros(surface_memory.MEMORY)
        self.constants[render.PAD_STIFFNESS], self.constants[render.PERIOD] = PAD, self.period
        self.read: list[float] = []

    def borne(self, force: float, depth: float, ticks: int = 1) -> Floats:
        """Press with a force [N] for some ticks, where the finger seems this deep [m]; return the estimates (ticks,)."""
        found = []
        for _ in range(ticks):
            self.read.append(force + self.noise * self.rng.normal())
            _estimate(self.constants, self.memory, -self.read[-1], depth)
            found.append(-_believed(self.memory, -self.read[-1]))
        return np.array(found)

    def at(self, name: int) -> float:
        """Return a number of the surface's memory."""
        return float(self.memory[name])


@pytest.mark.parametrize("rate", [1000, 4000])
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_a_quiet_sensor_is_believed_as_it_reads(noise: float, rate: int) -> None:
    sensor = Sensor(noise, rate)
    found = [*sensor.borne(0.0, AWAY, 4 * rate), *sensor.borne(0.7, 7e-4, 100), *sensor.borne(0.0, AWAY, 4 * rate)]
    assert found == sensor.read
    assert sensor.at(surface_memory.LOUD) == sensor.at(surface_memory.UNSURE) == 0.0


@pytest.mark.parametrize("rate", [1000, 4000])
@pytest.mark.parametrize("noise", [0.012, 0.04])
def test_the_noise_of_a_loud_sensor_is_measured_in_the_air(noise: float, rate: int) -> None:
    sensor = Sensor(noise, rate)
    sensor.borne(0.3, AWAY, rate // 2)  # it need not be zeroed
    assert sensor.at(surface_memory.LOUD) == pytest.approx(noise, rel=0.2)
    before = sensor.at(surface_memory.LOUD)
    sensor.noise = 0.0
    sensor.borne(0.7, 7e-4, rate)
    assert sensor.at(surface_memory.LOUD) == before  # nothing is learned of it while a finger presses


def test_a_single_knock_does_not_count_as_noise() -> None:
    sensor = Sensor(0.005)
    sensor.borne(0.0, AWAY, 1000)
    sensor.borne(2.0, AWAY)
    sensor.borne(0.0, AWAY, 10)
    assert sensor.at(surface_memory.LOUD) == 0.0


@pytest.mark.parametrize("rate", [1000, 4000])
def test_noise_is_no_force_of_a_surface_that_is_away_and_little_of_one_that_presses(rate: int) -> None:
    sensor = Sensor(0.04, rate)
    sensor.borne(0.0, AWAY, rate // 2)
    assert sensor.borne(0.0, AWAY, 10 * rate).max() < 0.03  # what safety takes for a touch
    pressed = sensor.borne(0.7, 7e-4, 10 * rate)[rate // 10 :]
    assert pressed.mean() == pytest.approx(0.7, abs=0.005)
    assert np.abs(pressed - 0.7).max() < 1.4 * sensor.at(surface_memory.UNSURE) < 0.07
    assert np.abs(np.diff(pressed)).max() < 0.06


@pytest.mark.parametrize("rate", [1000, 4000])
def test_the_force_estimate_has_no_delay(rate: int) -> None:
    """It goes with the finger, a knock counts at once, and what lets go is let go of."""
    sensor = Sensor(0.03, rate)
    sensor.borne(0.0, AWAY, rate // 2)
    sensor.borne(0.1, 1e-4, rate // 50)
    for depth in np.arange(1e-4, 1.5e-3, 0.1 / rate):  # 0.1 m/s
        (found,) = sensor.borne(PAD * depth, depth)
        assert found == pytest.approx(PAD * depth, abs=1.4 * sensor.at(surface_memory.UNSURE))
    (found,) = sensor.borne(2.5, 1.5e-3)
    assert found == sensor.read[-1]
    (found,) = sensor.borne(0.0, AWAY)
    assert found < 0.1


def test_a_finger_that_goes_deeper_into_no_surface_presses_nothing() -> None:
    """What its depth explains is added only to what is surely felt: else a missing surface would seem to be felt."""
    sensor = Sensor(0.04)
    sensor.borne(0.0, AWAY, 500)
    found = [sensor.borne(0.0, depth)[0] for depth in np.arange(0.0, 2e-3, 5e-5)]
    assert max(found) < 0.05


@pytest.mark.parametrize(
    ("number", "laws"),
    [pytest.param(46, {"arm", "step"}, id="an arm at its limit makes no room for noise"),
     pytest.param(5, {"limit", "step"}, id="nor is it above its limit by that"),
     pytest.param(119, {"step"}, id="nor does the arm give what a sensor errs by")],
)  # fmt: skip
def test_a_loud_sensor_breaks_no_law_that_it_once_broke(folder: Path, number: int, laws: set[str]) -> None:
    figures = run(number, 301127, folder, kind="wide")["figures"]
    assert laws <= figures.keys()
    assert not broken(figures)


@pytest.mark.parametrize(("number", "noise"), [(0, 12.0), (12, 40.0)])
def test_other_scenes_with_a_loud_sensor_break_no_law(folder: Path, number: int, noise: float) -> None:
    _, scene = draw(number, 5150, folder)
    assert not broken(judge(follow(dataclasses.replace(scene, noise=noise).build(folder))))


@pytest.mark.parametrize(("rate", "noise"), [(1000, 40.0), (4000, 30.0)])
def test_a_plate_that_is_too_low_is_missed_as_soon_with_a_loud_sensor(folder: Path, rate: int, noise: float) -> None:
    """It read more than a touch again and again, so that a light touch of 0.5 N was never felt at all."""
    world, _ = ramp(0.0)
    motion = (
        f'<to pos="0 0 25 mm" in="0.1 s" hold="0.3 s"/><to pos="0 0 {5.0 + RADIUS - 0.65} mm" in="0.3 s" hold="0.5 s"/>'
        '<to pos="0 0 25 mm" in="0.3 s" hold="0.1 s"/>'
    )
    course = follow(Slope(world, motion, stiffness=0.8, error=3.0, noise=noise, rate=rate).build(folder))
    should = course.touching & course.renders & (np.linalg.norm(course.virtual, axis=1) > 0.8 * 0.4)
    assert 0 < should.sum() <= 0.08 * rate
    late = course.touching & (course.time > 0.95) & (course.time < 1.15)
    virtual, total = np.linalg.norm(course.virtual[late], axis=1), np.linalg.norm(course.total[late], axis=1)
    assert virtual.min() > 0.1
    assert total == pytest.approx(virtual, rel=0.02)
    assert len([notice for notice in course.report["notices"] if "should have been felt" in notice]) == 1


class LateSensor(Sensor):
    """A sensor that is read every ``every`` ticks, ``late`` ticks after it measures; what it says is moved on to now.

    Between two readings, and while one is on its way, the modality that carries the surface moves the newest on by how
    much deeper the finger is: ``stated`` [N] in each tick.
    """

    def __init__(self, noise: float, every: int, late: int = 2, *, rate: int = 1000) -> None:
        super().__init__(noise, rate)
        self.every, self.late, self.tick = every, late, late
        self.forces, self.stated = [0.0] * late, [0.0]
        self.measured, self.newest = 0, 0.0

    def borne(self, force: float, depth: float, ticks: int = 1) -> Floats:
        """Do what the sensor without a wire does; what is estimated is of the tick before."""
        found = []
        for _ in range(ticks):
            self.forces.append(force)
            if self.tick % self.every == 0:
                self.measured = self.tick - self.late
                self.newest = self.forces[self.measured] + self.noise * self.rng.normal()
                self.read.append(self.newest)
            _late(self.constants, self.memory, -self.newest, self.stated[-1], depth, float(self.measured))
            found.append(-_believed(self.memory, -self.stated[-1]))
            self.stated.append(max(0.0, self.newest + force - self.forces[self.measured]))
            self.tick += 1
        return np.array(found)


@pytest.mark.parametrize("every", [1, 7, 10])
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_behind_a_wire_a_quiet_sensor_is_believed_as_it_is_stated(noise: float, every: int) -> None:
    sensor = LateSensor(noise, every)
    found = [*sensor.borne(0.0, AWAY, 4000), *sensor.borne(0.7, 7e-4, 100), *sensor.borne(0.0, AWAY, 4000)]
    assert found == sensor.stated[:-1]
    assert sensor.at(surface_memory.LOUD) == sensor.at(surface_memory.UNSURE) == 0.0


@pytest.mark.parametrize("every", [1, 7, 10])
@pytest.mark.parametrize("noise", [0.012, 0.04])
def test_behind_a_wire_noise_is_measured_once_for_each_reading(noise: float, every: int) -> None:
    sensor = LateSensor(noise, every)
    sensor.borne(0.3, AWAY, 500 * every)
    assert sensor.at(surface_memory.LOUD) == pytest.approx(noise, rel=0.2)
    assert sensor.at(surface_memory.HEARD) == pytest.approx(500 * 1e-3, rel=0.01)  # by readings, not by ticks


@pytest.mark.parametrize("rate", [1000, 4000])
def test_the_fewer_the_readings_the_louder_a_sensor_must_be(rate: int) -> None:
    """One of 40 mN is known after a quarter of a second, at a reading every 10 ms; one of 5 mN never is."""
    every = rate // 100
    loud, quiet = LateSensor(0.04, every, rate=rate), LateSensor(0.005, every, rate=rate)
    loud.borne(0.0, AWAY, rate // 4)
    assert loud.at(surface_memory.LOUD) == pytest.approx(0.04, rel=0.5)
    for _ in range(400):
        quiet.borne(0.0, AWAY, every)
        assert quiet.at(surface_memory.LOUD) == 0.0


@pytest.mark.parametrize("every", [1, 4, 10])
def test_behind_a_wire_noise_is_averaged_out_and_the_estimate_is_not_late(every: int) -> None:
    sensor = LateSensor(0.04, every)
    sensor.borne(0.0, AWAY, 500 * every)
    pressed = sensor.borne(0.7, 7e-4, 4000 * every)[100 * every :]
    assert pressed.mean() == pytest.approx(0.7, abs=0.008)
    assert pressed.std() < 0.7 * 0.04
    assert np.abs(pressed - 0.7).max() < 1.6 * sensor.at(surface_memory.UNSURE)
    before = 0.7
    for depth in np.arange(7e-4, 2e-3, 1e-4):  # 0.1 m/s, told a tick late
        (found,) = sensor.borne(PAD * depth, depth)
        assert found == pytest.approx(before, abs=1.6 * sensor.at(surface_memory.UNSURE) + PAD * 1e-4)
        before = PAD * depth


@pytest.mark.parametrize("number", [9, 23, 28])  # a mesh, another, and a ramp
def test_a_loud_sensor_behind_a_wire_breaks_no_law_that_it_once_broke(folder: Path, number: int) -> None:
    """What a plate in the air reads of no touch was moved on with the finger: the arm gave way to up to 1 N of it."""
    _, scene = draw(number, 9001, folder)
    wire = draw_wire(number, 9001).catalog()
    figures = judge(follow(dataclasses.replace(scene, noise=30.0).build(folder, catalog=wire)), wired=True)
    assert {"arm", "step", "absent"} <= figures.keys()
    assert not broken(figures)
