"""A surface keeps its laws at any rate of the servo loop: an arm reads in steps, which last as long at every rate."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from kernels_in_python import kernel_of
from shipped import SCENES

from itouch.loop import render
from itouch.loop.surface import plate, surface_memory
from itouch.plugin.carried_surfaces import AHEAD
from itouch.session import Session, build
from itouch_encountered import feed_forward, surface_fields
from itouch_evidence.surface.course import Floats, follow
from itouch_evidence.surface.scenes import Slope, ball

_smooth, _bend = kernel_of(plate._smooth), kernel_of(feed_forward.bend)

#: In what steps an arm reads [m].
STEP = 30e-6


class Numbers(NamedTuple):
    """What of the surface's constants its feed-forward needs: period of a tick [s], and ticks of looking ahead."""

    period: float
    ahead: int


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rates") / "scenes"
    shutil.copytree(SCENES, path)
    return path


def at_rate(folder: Path, rate: int, slope: Slope, *changes: tuple[str, str]) -> Session:
    """Build the scene of a slope at a rate [Hz]; ``changes``: what in its text is replaced by what."""
    text, path = slope.text(), folder / "rate.xml"
    for before, after in (*changes, ("  <safety", f'  <rates servo="{rate} Hz"/>\n  <safety')):
        assert before in text
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")
    return build(path, seed=0)


def readings(rate: int, speed: float, seconds: float = 0.5) -> Floats:
    """Return where a finger that goes at this speed [m/s] is read to be, at a rate [Hz]."""
    read: Floats = np.rint(speed * np.arange(int(rate * seconds)) / rate / STEP) * STEP
    return read


def foreseen(rate: int) -> float:
    """Return by how much the height to which a sinking finger is foreseen to come is off [m], as an rms."""
    c, memory, speed = np.zeros(render.CONSTANTS), np.zeros(surface_memory.MEMORY), -0.013
    c[render.PERIOD] = 1.0 / rate
    off = []
    for tick, read in enumerate(readings(rate, speed)):
        _smooth(c, memory, read)
        soon = memory[surface_memory.LEVEL] + AHEAD * memory[surface_memory.SINK]
        off.append(soon - speed * (tick / rate + AHEAD))
    return float(np.std(off[rate // 10 :]))


def wrongly_shifted(rate: int) -> float:
    """Return how much acceleration [m/s2] is taken to bend a slope by a finger that does not accelerate, as an rms."""
    numbers, state = Numbers(1.0 / rate, round(3e-3 * rate)), np.zeros(100)
    state[surface_fields.INERTIA] = feed_forward.INERTIA_FIRST
    smooth, goes, bends = 0.0, 0.0, []
    for moved in np.diff(readings(rate, 0.02)) * rate:
        smooth += (1.0 - np.exp(-1.0 / (rate * 2e-3))) * (moved - smooth)
        change = (smooth - goes) / (1.0 + 5e-3 * rate)
        goes += change
        _bend(numbers, state, 0.0, change * rate, True)
        bends.append(state[surface_fields.HASTE])
    return float(np.std(bends[rate // 10 :]))


def followed(rate: int) -> float:
    """Return in what time half of a change of the finger's speed is followed [s]."""
    c, memory = np.zeros(render.CONSTANTS), np.zeros(surface_memory.MEMORY)
    c[render.PERIOD] = 1.0 / rate
    for tick in range(1, rate):
        _smooth(c, memory, 1e-2 * tick / rate)
        if memory[surface_memory.SINK] > 5e-3:
            return tick / rate
    return np.inf


@pytest.mark.parametrize("rate", [250, 500, 2000, 4000])
def test_a_finger_is_followed_in_the_same_time_as_at_1_khz(rate: int) -> None:
    assert followed(rate) == pytest.approx(followed(1000), abs=0.4 * followed(1000) + 1.0 / rate)


@pytest.mark.parametrize("rate", [2000, 4000])
@pytest.mark.parametrize("found", [foreseen, wrongly_shifted])
def test_the_steps_in_which_an_arm_reads_are_smoothed_as_well_as_at_1_khz(
    found: Callable[[int], float], rate: int
) -> None:
    assert found(rate) < 1.5 * found(1000)


def test_a_plate_that_presses_alone_stays_below_the_limit(folder: Path) -> None:
    """At 4 kHz it pressed in the rhythm in which the arm read: 0.02 N above the limit."""
    stroke = ball([23.74, 29.74, 23.74, 29.74], 0.65, 57.525, 1.94)
    course = follow(at_rate(folder, 4000, Slope(*stroke, stiffness=0.15, force=0.5)))
    assert course.pad.max() > 0.3
    assert np.linalg.norm(course.total, axis=1).max() <= 0.5 * (1.0 + 1e-9)


def test_a_plate_presses_a_stiff_pad_no_harder_than_the_limit(folder: Path) -> None:
    world = '<box name="block" pos="0 0 0 mm" size="60 60 10 mm" material="stuff"/>'
    motion = '<to pos="0 0 33 mm" in="0.1 s" hold="0.4 s"/><to pos="0 0 10.2 mm" in="0.5 s" hold="0.3 s"/>'
    stiff = ("skin-temp", 'pad-stiffness="1.5 N/mm" pad-damping="1 N*s/m" skin-temp')
    course = follow(at_rate(folder, 4000, Slope(world, motion, force=0.3), stiff))
    assert course.pad.max() > 0.1
    assert np.linalg.norm(course.total, axis=1).max() <= 0.3 * (1.0 + 1e-9)


@pytest.mark.parametrize("rate", [2000, 4000])
@pytest.mark.parametrize(
    ("stroke", "tilt", "hardware"),
    [
        pytest.param(ball([17.6, 30.0, 17.6, 30.0, 17.6], 0.754, 47.034, 4.3), 0.0, 'bandwidth="90 Hz"', id="quick"),
        pytest.param(ball([22.0, 28.0, 22.0, 28.0], 1.025, 33.61, 1.9), 12.0, "", id="tilted"),
    ],
)
def test_a_plate_presses_as_a_rigid_surface_would(
    folder: Path, stroke: tuple[str, str], tilt: float, hardware: str, rate: int
) -> None:
    """A drive that is told how fast its goal moves could not follow the arm's steps: 2 to 3 % too hard or too soft."""
    mount = ('mount pos="0 0 -30 mm"', f'mount pos="0 0 -30 mm" rpy="0 {tilt} 0 deg"')
    course = follow(at_rate(folder, rate, Slope(*stroke), mount, ('travel="200', f'{hardware} travel="200')))
    course.depth *= math.cos(math.radians(tilt))  # along the plate's normal
    rigid, pad, there = course.rigid()
    assert there.sum() > rate
    assert np.percentile((np.abs(pad - rigid) / np.maximum(rigid, 0.5))[there], 95) < 0.01


@pytest.mark.parametrize("hardware", ["", 'bandwidth="90 Hz"'])
def test_a_plate_that_comes_down_with_a_finger_is_not_late(folder: Path, hardware: str) -> None:
    """Below a finger it went down in the steps in which the arm reads, and was learned to be slower than it is."""
    motion = (
        '<to pos="0 0 33 mm" in="0.1 s" hold="0.2 s"/><to pos="0 0 14 mm" in="0.7 s"/><to pos="0 0 12 mm" in="1 s"/>'
    )
    world = '<box name="block" pos="0 0 0 mm" size="60 60 10 mm" material="stuff"/>'
    session = at_rate(folder, 4000, Slope(world, motion), ('travel="200', f'{hardware} travel="200'))
    behind = []
    while not session.done:
        session.tick()
        behind.append(session.state["table.sent.pose_target"][2].item() - session.state["table.pose"][2].item())
    down = behind[2000:3400]
    assert abs(np.mean(down)) < 2e-5
    assert abs(session.state["finger.surface.lag"].item() + 1.0 / 4000) < 2e-4
