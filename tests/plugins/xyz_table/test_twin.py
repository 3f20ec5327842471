"""The table's twin moves like a table."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from itouch.plugin import Record, TwinInputs
from itouch.plugin.record import Field
from itouch_xyz_table import XyzTable, XyzTableParams, XyzTableTwin


class Bench:
    """A table's twin by itself."""

    def __init__(self, **params: Any) -> None:
        self.params = XyzTableParams(**params)
        self.twin = XyzTableTwin(self.params)
        self.state = Record.of(self.twin.fields())
        self.twin.reset(self.state, np.random.default_rng(0))
        reads, commands = XyzTable.channels(self.params)
        self.command = Record.of(Field.of(c) for c in commands)
        self.reading = Record.of(Field.of(c) for c in reads)
        self.touch = TwinInputs()

    def run(self, *goal: float, steps: int = 1000) -> np.ndarray:
        path = []
        for _ in range(steps):
            self.command["pose_target"][:3] = goal
            self.twin.step(self.state, self.command, self.touch, 1e-3)
            path.append(self.state["axes"][0].copy())
        self.twin.read(self.state, self.reading)
        return np.array(path)


def test_it_arrives_within_speed_and_acceleration() -> None:
    bench = Bench(speed=0.2, acceleration=5.0)
    path = bench.run(0.05, -0.03, 0.02)
    assert path[-1] == pytest.approx([0.05, -0.03, 0.02], abs=1e-5)
    speed = np.diff(path, axis=0) / 1e-3
    assert np.abs(speed).max() <= 0.2 * (1 + 1e-9)
    assert np.abs(np.diff(speed, axis=0)).max() / 1e-3 < 5.0 + 0.8 / 0.6  # friction helps to brake


def test_it_follows_a_hand_within_a_tenth_of_a_millimetre() -> None:
    bench = Bench()
    worst = 0.0
    for k in range(4000):
        goal = 0.05 * np.sin(2 * np.pi * 0.45 * k * 1e-3)  # 0.14 m/s at most
        position = bench.run(goal, 0.0, 0.02, steps=1)[-1]
        if k > 500:
            worst = max(worst, abs(position[0] - goal))
    assert worst < 2.5e-4


def test_end_stops_hold() -> None:
    bench = Bench(travel=(0.1, 0.1, 0.03))
    path = bench.run(1.0, -1.0, 1.0)
    assert path[-1] == pytest.approx([0.05, -0.05, 0.03])
    assert bench.run(0.0, 0.0, -1.0)[-1][2] == 0.0


def test_a_load_is_felt_and_hardly_moves_it() -> None:
    bench = Bench()
    bench.run(0.0, 0.0, 0.02)
    bench.touch.wrench[2] = -2.0
    path = bench.run(0.0, 0.0, 0.02)
    assert abs(path[-1][2] - 0.02) < 1e-4
    assert bench.reading["wrench"][2] == pytest.approx(-2.0, abs=0.05)


def test_rotations_are_locked() -> None:
    bench = Bench()
    bench.run(0.01, 0.0, 0.0)
    assert list(bench.reading["pose"][3:]) == [1.0, 0.0, 0.0, 0.0]
    reads, commands = XyzTable.channels(bench.params)
    assert all(channel.locked == (3, 4, 5) for channel in (*reads, *commands))


def test_noise_has_the_stated_size_and_comes_from_state() -> None:
    bench = Bench(force_noise=0.02)
    values = []
    for _ in range(4000):
        bench.run(0.0, 0.0, 0.0, steps=1)
        values.append(float(bench.reading["wrench"][2]))
    assert np.mean(values) == pytest.approx(0.0, abs=0.002)
    assert np.std(values) == pytest.approx(0.02, rel=0.05)
    before = bench.state.copy()
    first = bench.run(0.0, 0.0, 0.0, steps=1), float(bench.reading["wrench"][2])
    bench.state.raw[:] = before.raw
    second = bench.run(0.0, 0.0, 0.0, steps=1), float(bench.reading["wrench"][2])
    assert first[1] == second[1]
