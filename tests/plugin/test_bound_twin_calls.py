"""A twin that Python steps again and again does the same by calls that are bound once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from itouch.plugin import Bound, Field, Record, Twin, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch.plugin.kernels import kernel


@kernel
def _moved(x: Any, target: Any, ambient: float, period: float) -> int:
    """Move ``x`` (1,) [m] towards ``target`` (1,) [m]; both are float64.  Past 2 m Python answers."""
    if target[0] > 2.0:
        return 1
    x[0] += (target[0] - x[0]) * period + 1e-9 * ambient
    return 0


@kernel
def _sensed(x: Any, reading: Any) -> int:
    """Copy ``x`` (1,) [m] to ``reading`` (1,) [m]; both are float64.  Where it is negative Python answers."""
    if x[0] < 0.0:
        return 1
    reading[0] = x[0]
    return 0


class _Counted(Twin):
    """Follows its target, and counts what is bound and what Python has to do."""

    def __init__(self) -> None:
        super().__init__(None)
        self.bound = self.alone = 0

    def fields(self) -> tuple[Field, ...]:
        return (Field("x", "f8", 1, unit="m"),)

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        state["x"] = 0.0

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound | None:
        self.bound += 1
        return Bound(_moved, state["x"], command["target"], float(touch.ambient), period)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        self.alone += 1
        state["x"] += (command["target"] - state["x"]) * period + 1e-9 * touch.ambient

    def bound_read(self, state: Record, reading: Record) -> Bound | None:
        self.bound += 1
        return Bound(_sensed, state["x"], reading["x"])

    def read(self, state: Record, reading: Record) -> bool | None:
        self.alone += 1
        reading["x"] = state["x"]
        return state["x"].item() >= 0.0


class _InPython(_Counted):
    """Steps and reads in a way of its own, of which the calls that it inherits know nothing."""

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        super().step(state, command, touch, period)

    def read(self, state: Record, reading: Record) -> bool | None:
        return super().read(state, reading)


class _Unbound(_Counted):
    """Offers no call until it is asked for the third time."""

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound | None:
        found = super().bound_step(state, command, touch, period)
        return found if self.bound > 2 else None


def _records() -> tuple[Record, Record, Record]:
    return Record.of([Field("x", "f8", 1)]), Record.of([Field("target", "f8", 1)]), Record.of([Field("x", "f8", 1)])


def _run(twin: Twin, steps: int, *, bound: bool) -> list[float]:
    state, command, reading = _records()
    touch, by = TwinInputs(), BoundTwin(twin) if bound else twin
    found = []
    for i in range(steps):
        command["target"] = 0.1 * i
        by.step(state, command, touch, 1e-3)
        assert by.read(state, reading) in (None, True)
        found.append(reading["x"].item())
    return found


def test_calls_are_bound_once_and_do_the_same() -> None:
    twin = _Counted()
    assert _run(twin, 20, bound=True) == _run(_InPython(), 20, bound=False)
    assert (twin.bound, twin.alone) == (2, 0)


def test_what_a_call_hands_over_is_done_in_python() -> None:
    twin = _Counted()
    assert _run(twin, 30, bound=True) == _run(_InPython(), 30, bound=False)
    assert (twin.bound, twin.alone) == (2, 9)  # targets past 2 m
    state, _, reading = _records()
    state["x"] = -1.0
    assert BoundTwin(twin).read(state, reading) is False


def test_a_twin_that_overrides_only_what_python_does_is_stepped_in_python() -> None:
    twin = _InPython()
    _run(twin, 5, bound=True)
    assert (twin.bound, twin.alone) == (0, 10)


def test_a_call_may_be_offered_later() -> None:
    twin = _Unbound()
    assert _run(twin, 20, bound=True) == _run(_InPython(), 20, bound=False)
    assert twin.alone == 1  # the first step; reading was offered at once


@pytest.mark.parametrize("other", ["state", "command", "touch", "period", "ambient"])
def test_what_is_bound_anew_is_what_has_changed(other: str) -> None:
    twin, plain = _Counted(), _InPython()
    by = BoundTwin(twin)
    (state, command, _), touch, period = _records(), TwinInputs(), 1e-3
    command["target"] = 1.0
    for _ in range(3):
        by.step(state, command, touch, period)
    if other == "state":
        state = _records()[0]
    elif other == "command":
        command = command.copy()
        command["target"] = -1.0
    elif other == "touch":
        touch = TwinInputs(ambient=250.0)
    elif other == "period":
        period = 1e-2
    else:
        touch.ambient = 250.0  # as a twin in another process is told with every command
    wanted = state.copy()
    plain.step(wanted, command, touch, period)
    by.step(state, command, touch, period)
    assert state["x"].item() == wanted["x"].item()
    assert twin.bound == 2
