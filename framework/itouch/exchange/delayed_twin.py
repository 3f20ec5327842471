"""The twin of a blocking device: readings arrive late and commands act late, as over a wire; all of it is State."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Channel, Device, Field, Record, Twin, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch.plugin.timestamps import Timestamped


class LateTwin(Twin, Timestamped):
    """Puts a wire between the loop and another twin.

    An exchange begins every ``period`` of the device, or when `course` says: it takes the command of that moment and
    measures.  After ``delay`` the command acts and the reading has arrived.  Until the first command acts, the device
    does what is safe.
    """

    def __init__(self, twin: Twin, device: type[Device], servo_period: float) -> None:
        super().__init__(twin.params)
        self.twin = twin
        self._reads, self._commands = device.channels(twin.params)
        self._delay = math.ceil(device.delay / servo_period - 1e-9)
        self._every = max(1, round(device.period / servo_period), self._delay)
        self._names = [field.name for field in twin.fields()]
        self._bound = BoundTwin(twin)
        self._seen: Record | None = None

    def fields(self) -> tuple[Field, ...]:
        """Return the State of the inner twin and of the wire."""
        reads, commands = _size(self._reads), _size(self._commands)
        return (
            *self.twin.fields(),
            Field(
                "line.measured", "f8", reads, unit="mixed", doc="readings that the device has measured and not yet sent"
            ),
            Field("line.reading", "f8", reads, unit="mixed", doc="readings on their way from the device"),
            Field("line.taken", "f8", commands, unit="mixed", doc="commands on their way to the device"),
            Field("line.acting", "f8", commands, unit="mixed", doc="commands that the device obeys"),
            Field("line.left", "i8", unit="tick", doc="ticks until the command that is on its way acts, -1: none is"),
            Field("line.due", "i8", unit="tick", doc="ticks until the next exchange may begin"),
            Field("line.fresh", "i8", unit="1", doc="1 if a reading has come that was not given on"),
            Field("line.begun", "i8", unit="1", doc="1 once a command has come"),
            Field("line.took", "i8", unit="tick", doc="how long the exchange took whose reading has come"),
            Field("line.told", "i8", unit="1", doc="1 if an exchange has begun and its command was not told of"),
            Field("line.gone", "i8", unit="tick", doc="for how long the command has been on its way or acted"),
            Field("line.takes", "i8", unit="tick", doc="how long the exchange takes that has begun last"),
            Field("line.since", "i8", unit="tick", doc="for how long the last exchange has been over"),
        )

    def set_environment(self, ambient: float, skin_temperature: float | None) -> None:
        """Pass the temperatures [K] on to the inner twin."""
        self.twin.set_environment(ambient, skin_temperature)

    def _look(self, state: Record) -> Record:
        """Return the inner twin's part of a State; make scratch records when the State is a new one."""
        if state is not self._seen:
            self._seen = state
            self._inner = state.part("", self._names) if self._names else Record(np.dtype([]))
            self._reading, self._acting = _record(self._reads), _record(self._commands)
        return self._inner

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Reset the inner twin; nothing is on the wire."""
        self.twin.reset(self._look(state), rng)
        for name in ("due", "fresh", "begun", "told", "took", "since", "gone", "takes"):
            state[f"line.{name}"] = 0
        state["line.left"] = -1

    def position(self, state: Record) -> NDArray[np.float64] | None:
        """Return the true position [m] of what the device carries, which no wire delays; or None."""
        return self.twin.position(self._look(state))

    def settle(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Step the inner twin directly, before anything goes over the wire."""
        self.twin.step(self._look(state), command, touch, period)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Begin or end an exchange if it is due, and advance the inner twin."""
        inner = self._look(state)
        if not state["line.begun"].item():
            state["line.begun"] = 1
            self._rest(state["line.acting"], command)
        left, due = state["line.left"].item(), state["line.due"].item()
        state["line.since"] = state["line.since"].item() + 1
        state["line.gone"] = state["line.gone"].item() + 1
        if left == 0:
            self._end(state)
            left = -1
        begins = due <= 0
        if begins:
            left, due = self.course(state)
            state["line.takes"], state["line.gone"], state["line.told"] = left, 0, 1
            _put(state["line.taken"], command)
            if left == 0:
                state["line.acting"] = state["line.taken"]
        _take(self._acting, state["line.acting"])
        self._bound.step(inner, self._acting, touch, period)
        if begins:
            self._bound.read(inner, self._reading)
            _put(state["line.measured"], self._reading)
            if left == 0:
                self._end(state)
                left = -1
        state["line.left"] = left - 1 if left > 0 else left
        state["line.due"] = due - 1

    def _rest(self, acting: NDArray[np.float64], command: Record) -> None:
        """Fill in what the device does before its first command: the safe value, or else the present command."""
        _put(acting, command)
        at = 0
        for channel in self._commands:
            if isinstance(channel.safe, tuple):
                acting[at : at + channel.size] = channel.safe
            at += channel.size

    @staticmethod
    def _end(state: Record) -> None:
        state["line.acting"] = state["line.taken"]
        state["line.reading"] = state["line.measured"]
        state["line.fresh"] = 1
        state["line.took"], state["line.since"] = state["line.takes"], 0

    def course(self, state: Record) -> tuple[int, int]:
        """Return how many ticks the exchange that begins now takes, and after how many ticks the next one begins."""
        return self._delay, self._every

    def measured(self, state: Record, tick: int, ticks: NDArray[np.int64]) -> None:
        """Fill in the tick in which the exchange began whose reading has arrived.

        ``ticks`` (channels,), written: the number of a tick for each reading.
        """
        ticks[...] = (
            tick - state["line.took"].item() - (state["line.since"].item() if state["line.begun"].item() else 0)
        )

    def departed(self, state: Record, tick: int, command: Record) -> int | None:
        """Fill in the command that has left, once, and return the tick from which on it acts; None: none has left."""
        if not state["line.told"].item():
            return None
        state["line.told"] = 0
        _take(command, state["line.taken"])
        return tick - 1 - int(state["line.gone"].item()) + int(state["line.takes"].item())

    def read(self, state: Record, reading: Record) -> bool | None:
        """Return the reading of the last exchange that has ended, once; before the first one, read the inner twin."""
        if not state["line.begun"].item():
            return self.twin.read(self._look(state), reading)
        if not state["line.fresh"].item():
            return False
        state["line.fresh"] = 0
        _take(reading, state["line.reading"])
        return True


def _size(channels: tuple[Channel, ...]) -> int:
    return max(1, sum(channel.size for channel in channels))


def _record(channels: tuple[Channel, ...]) -> Record:
    return Record.of(Field.of(channel) for channel in channels)


def _put(field: NDArray[np.float64], record: Record) -> None:
    """Copy a record to a field of State; without channels the field has one number, which is not used."""
    field[: record.nbytes // 8] = record.raw.view(np.float64)


def _take(record: Record, field: NDArray[np.float64]) -> None:
    record.raw.view(np.float64)[:] = field[: record.nbytes // 8]
