"""The twin behind a wire: late by the device's delay, once a period, all of it in State."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from itouch.exchange import EveryNth, LateTwin
from itouch.plugin import Device, Field, Record, Role, Twin, TwinInputs, current, temperature


@dataclass(frozen=True)
class _Params:
    pass


class _Integrator(Twin):
    """Sums what it is commanded: its reading tells when a command acted."""

    def fields(self) -> tuple[Field, ...]:
        return (Field("sum"), Field("steps"))

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        state["sum"], state["steps"] = 0.0, 0.0

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        state["sum"] += command["current"][0]
        state["steps"] += 1

    def read(self, state: Record, reading: Record) -> bool | None:
        reading["temperature"] = state["steps"]
        return True


class _Wired(Device):
    Params = _Params
    reads = (temperature("temperature", Role.OTHER_TEMPERATURE),)
    commands = (current(limit=2.0),)
    Twin = _Integrator
    blocking: ClassVar[bool] = True

    def open(self) -> None: ...

    def close(self) -> None: ...

    def read(self, reading: Record) -> bool | None: ...


def _wired(period: float, delay: float) -> tuple[LateTwin, Record, Record, Record]:
    cls = type("_Made", (_Wired,), {"period": period, "delay": delay})
    twin = LateTwin(_Integrator(_Params()), cls, 1e-3)
    state = Record.of(twin.fields())
    twin.reset(state, np.random.default_rng(0))
    return twin, state, Record.of([Field("current", "f8", 1)]), Record.of([Field("temperature", "f8", 1)])


@pytest.mark.parametrize(("period", "delay"), [(0.0, 0.001), (0.007, 0.007), (0.01, 0.004), (0.005, 0.0)])
def test_commands_act_after_the_delay_and_readings_are_that_old(period: float, delay: float) -> None:
    twin, state, command, reading = _wired(period, delay)
    lag, every = round(delay / 1e-3), max(1, round(period / 1e-3), round(delay / 1e-3))
    acted, fresh = [], []
    for tick in range(60):
        new = twin.read(state, reading)
        if tick and new:
            fresh.append((tick, float(reading["temperature"][0])))
        before = float(state["sum"])
        command["current"] = tick + 1
        twin.step(state, command, TwinInputs(), 1e-3)
        acted.append(float(state["sum"]) - before)
    for tick in range(every + lag, 60):
        begun = (tick - lag) // every * every  # the exchange that has ended last began then
        assert acted[tick] == begun + 1
    assert [tick for tick, _ in fresh] == list(range(lag + 1, 60, every))
    for tick, steps in fresh:
        assert steps == tick - lag  # what was true when the exchange began


def test_a_state_can_be_copied_in_the_middle_of_an_exchange() -> None:
    twin, state, command, reading = _wired(0.007, 0.005)
    for tick in range(17):
        command["current"] = tick
        twin.step(state, command, TwinInputs(), 1e-3)
    other, copy = (
        LateTwin(_Integrator(_Params()), type("_M", (_Wired,), {"period": 0.007, "delay": 0.005}), 1e-3),
        state.copy(),
    )
    for tick in range(17, 40):
        command["current"] = tick
        for twin_of, record in ((twin, state), (other, copy)):
            twin_of.read(record, reading)
            twin_of.step(record, command, TwinInputs(), 1e-3)
    assert state.tobytes() == copy.tobytes()


@pytest.mark.parametrize("polled", [1, 3])
@pytest.mark.parametrize(("period", "delay"), [(0.0, 0.001), (0.007, 0.007), (0.01, 0.004), (0.005, 0.0)])
def test_readings_and_commands_carry_the_ticks_at_which_they_were(period: float, delay: float, polled: int) -> None:
    twin, state, command, reading = _wired(period, delay)
    measured, out = np.zeros(1, np.int64), command.copy()
    told: list[tuple[int, float]] = []
    acting = {}
    for tick in range(60):
        if tick % polled == 0 and twin.read(state, reading):  # the first one, too, before anything is on the wire
            twin.measured(state, tick, measured)
            assert measured[0] == reading["temperature"][0]  # the integrator reads in how many steps it stood
        left = twin.departed(state, tick, out) if tick % polled == 0 else None
        if left is not None:
            told.append((left, float(out["current"][0])))
        before = float(state["sum"])
        command["current"] = tick + 1
        twin.step(state, command, TwinInputs(), 1e-3)
        assert state["line.left"].item() >= -1  # none is on its way
        acting[tick] = float(state["sum"]) - before
    assert len(told) > 4
    for left, value in told:
        if left < 60:
            assert acting[left] == value
            assert acting.get(left - 1, 0.0) != value  # the first one, too: nothing acts that was not sent


def test_a_device_that_is_exchanged_with_in_step_has_the_loops_time_as_its_clock() -> None:
    device = EveryNth(_Wired(_Params()), 4, period=2e-3)
    device.open()
    reading, times = Record.of([Field("temperature", "f8", 1)]), []
    for _ in range(6):
        device.read(reading)
        times.append(device.device.clock())
    assert times == pytest.approx([0.002, 0.004, 0.006, 0.008, 0.010, 0.012])
