"""A twin that fails as planned: it is between the supervisor and a device's twin, and falsifies readings and commands.

Everything that it remembers is State, including the plan: a restored session fails as it would have, and a test can
write another plan to State.  The simulated device has a watchdog of its own, as every device that moves or heats must
have: cut off from its commands, it keeps the last one for as long as W1 allows a reading to age, then makes itself
safe.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from itouch.faults.kinds import AMOUNTS, DROPPED, LATE, SPIKES, UNITS, Injection, Kind
from itouch.plugin import RETRACT, Channel, DeviceError, Field, Record, Role, Twin, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch.plugin.device import is_new
from itouch.plugin.noise import random_word, uniform
from itouch.plugin.timestamps import Timestamped

Floats = NDArray[np.float64]
#: The State field with the word of the random generator.
_WORD = "fault.word"
#: Speed [m/s] at which a surface that is cut off retracts by itself; how near to its goal a saturated one stops [m].
RETRACTION, ARRIVED = 0.25, 2e-4


class FaultyTwin(Twin, Timestamped):
    """Wraps the twin of a device; ``plan`` has a slot for each fault; ``period`` and ``watchdog`` [s]."""

    def __init__(
        self, twin: Twin, reads: Sequence[Channel], commands: Sequence[Channel], plan: Sequence[Injection], *,
        period: float, watchdog: float,
    ) -> None:  # fmt: skip
        super().__init__(twin.params)
        self.twin, self.plan, self._period, self._patience = twin, tuple(plan), period, round(watchdog / period)
        self.reads, self.commands = tuple(reads), tuple(commands)
        self.channels = (*self.reads, *self.commands)
        self._units = [_unit(channel, index) for channel in reads for index in range(channel.size)]
        self._width = len(self._units)
        self._received = Record.of([Field.of(channel) for channel in commands])
        self._size = self._received.nbytes // 8
        self._bound = BoundTwin(twin)

    def fields(self) -> tuple[Field, ...]:
        """Return the State of the twin, the plan, and what the faults remember."""
        slots = len(self.plan)
        return (
            *self.twin.fields(),
            Field("fault.kind", "i8", slots, unit="1", doc="which fault each slot of the plan has, 0: none"),
            Field("fault.begin", "i8", slots, unit="tick", doc="when each fault begins"),
            Field("fault.end", "i8", slots, unit="tick", doc="when each fault ends"),
            Field("fault.channel", "i8", slots, unit="1", doc="number of the component that each fault bends"),
            Field(
                "fault.amount", "f8", slots, unit="mixed", doc="how much each fault bends it, in the unit of its kind"
            ),
            Field("fault.started", "i8", slots, unit="1", doc="1 once a fault has been applied"),
            Field("fault.tick", "i8", unit="tick", doc="ticks since the twin was reset"),
            Field("fault.taken", "i8", unit="1", doc="how many readings have been taken"),
            Field(
                "fault.cut_off", "i8", unit="1", doc="1 while the device has made itself safe because no command came"
            ),
            Field("fault.word", "u8", unit="1", doc="word of the generator of the faults' noise"),
            Field(
                "fault.held",
                "f8",
                (slots, max(1, self._width)),
                unit="mixed",
                doc="readings that a fault holds, one row a slot",
            ),
            Field(
                "fault.origin", "f8", (slots, 7), unit="mixed", doc="where a fault that wanders began, one row a slot"
            ),
            Field(
                "fault.reads",
                "f8",
                (LATE, max(1, self._width)),
                unit="mixed",
                doc="the last readings, of which a late one is taken",
            ),
            Field(
                "fault.commands",
                "f8",
                (LATE, max(1, self._size)),
                unit="mixed",
                doc="the last commands, of which a late one is taken",
            ),
            Field(
                "fault.received", "f8", max(1, self._size), unit="mixed", doc="the command that the device has received"
            ),
        )

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Reset the twin, and write the plan."""
        self.twin.reset(state, rng)
        state["fault.word"] = rng.integers(0, 1 << 63)
        for slot, injection in enumerate(self.plan):
            self.write_plan(state, slot, injection)

    def write_plan(self, state: Record, slot: int, injection: Injection) -> None:
        """Write a fault to a slot of the plan.

        Raises
        ------
        ValueError
            If the device has no such channel.
        """
        names = [channel.name for channel in self.channels]
        if injection.channel and injection.channel not in names:
            raise ValueError(f"channel = {injection.channel!r} is not one of {', '.join(names)}")
        state["fault.kind"][slot], state["fault.begin"][slot] = injection.kind, injection.begin
        state["fault.end"][slot], state["fault.amount"][slot] = injection.end, injection.amount
        state["fault.channel"][slot] = names.index(injection.channel) if injection.channel else -1
        state["fault.started"][slot] = 0

    def planned(self, state: Record, slot: int) -> tuple[Kind, int, int]:
        """Return kind, begin and end [ticks] of a slot of the plan."""
        kind, begin, end = (int(state[f"fault.{field}"][slot]) for field in ("kind", "begin", "end"))
        return Kind(kind), begin, end

    def position(self, state: Record) -> Floats | None:
        """Return the true position [m] of what the device carries, or None."""
        return self.twin.position(state)

    def _active(self, state: Record) -> list[tuple[int, Kind]]:
        tick, begins = state["fault.tick"].item(), state["fault.begin"].tolist()
        if min(begins, default=tick) > tick:
            return []
        kinds, ends = state["fault.kind"].tolist(), state["fault.end"].tolist()
        rows = enumerate(zip(kinds, begins, ends, strict=True))
        return [(slot, Kind(kind)) for slot, (kind, begin, end) in rows if kind and begin <= tick < end]

    # --- readings -------------------------------------------------------------------------------------------------

    def read(self, state: Record, reading: Record) -> bool | None:
        """Read the twin, and falsify its reading by the active faults.

        Raises
        ------
        DeviceError
            While it is disconnected.
        """
        active = self._active(state)
        if any(kind is Kind.DISCONNECT for _, kind in active):
            raise DeviceError("disconnected (an injected fault)")
        values = reading.numbers
        before = values.copy() if active else values
        new = self._bound.read(state, reading)
        for slot, _ in active:
            if not state["fault.started"][slot]:
                self._start(state, slot, values)
        if not is_new(new):  # what has not come over the wire can't be wrong, nor late
            return new
        state["fault.taken"][...] = state["fault.taken"].item() + 1
        for slot, kind in active:
            chosen = self._chosen(state, slot)
            if kind is Kind.DROP and uniform(state, _WORD) < DROPPED:
                values[:] = before
                return False
            self._bend(state, slot, kind, values, chosen)
        return new

    def measured(self, state: Record, tick: int, ticks: NDArray[np.int64]) -> None:
        """Do what the twin does.

        ``ticks`` (channels,), written: the number of a tick for each reading.
        """
        if isinstance(self.twin, Timestamped):
            self.twin.measured(state, tick, ticks)
        else:
            ticks[...] = tick

    def departed(self, state: Record, tick: int, command: Record) -> int | None:
        """Do what the twin does."""
        return self.twin.departed(state, tick, command) if isinstance(self.twin, Timestamped) else None

    def _start(self, state: Record, slot: int, values: Floats) -> None:
        state["fault.started"][slot] = 1
        state["fault.held"][slot] = values
        state["fault.reads"][:] = values
        state["fault.commands"][:] = state["fault.received"]
        at = 0
        for channel in self.reads:
            if channel.role is Role.TRACKED_POSE:
                state["fault.origin"][slot] = values[at : at + 7]
                place = self.twin.position(state)
                if place is not None:  # its reading may be falsified by another fault
                    state["fault.origin"][slot][:3] = place
            at += channel.size

    def _chosen(self, state: Record, slot: int) -> list[int]:
        """Return the components of the reading that a fault affects."""
        chosen: list[int] = []
        wanted, at = int(state["fault.channel"][slot]), 0
        for index, channel in enumerate(self.reads):
            if wanted in (-1, index):
                chosen += range(at, at + channel.size)
            at += channel.size
        return chosen

    def _bend(self, state: Record, slot: int, kind: Kind, values: Floats, chosen: list[int]) -> None:
        if kind is Kind.FREEZE:
            values[chosen] = state["fault.held"][slot][chosen]
        elif kind is Kind.NAN:
            values[chosen] = math.nan
        elif kind is Kind.GARBAGE:
            for index in chosen:
                values[index] = np.array([random_word(state, _WORD)], np.uint64).view(np.float64)[0]
        elif kind is Kind.DELAY:
            line, place = state["fault.reads"], state["fault.taken"].item() % LATE
            late = line[place].copy()
            line[place] = values
            values[chosen] = late[chosen]
        elif kind is Kind.WRONG_UNITS:
            for index in chosen:
                factor, offset = UNITS.get(self._units[index], (1.0, 0.0))
                values[index] = values[index] * factor + offset
        elif kind in (Kind.BIAS, Kind.DRIFT, Kind.SPIKE):
            self._shift(state, slot, kind, values, chosen)
        elif kind is Kind.REVERSED_SIGN and (not self.commands or state["fault.channel"][slot] >= 0):
            held = state["fault.held"][slot]
            for index in chosen:
                turned = 2.0 * held[index] if self._units[index] in ("m", "K") else 0.0
                values[index] = turned - values[index]

    def _shift(self, state: Record, slot: int, kind: Kind, values: Floats, chosen: list[int]) -> None:
        factor = 1.0
        if kind is Kind.DRIFT:
            factor = (state["fault.tick"].item() - state["fault.begin"][slot].item()) * self._period
        elif kind is Kind.SPIKE:
            if uniform(state, _WORD) >= SPIKES:
                return
            factor = 1.0 if uniform(state, _WORD) < 0.5 else -1.0
        asked = float(state["fault.amount"][slot])
        for index in chosen:
            usual = AMOUNTS.get(self._units[index], (0.0, 0.0, 0.0))[kind - Kind.BIAS]
            values[index] += factor * (usual if math.isnan(asked) else asked)

    # --- commands -------------------------------------------------------------------------------------------------

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Falsify the command by the active faults, and advance the twin under the result."""
        received, wanted = self._received.numbers, command.numbers
        last = state["fault.received"][: self._size]
        received[:] = wanted
        active = self._active(state)
        cut_off = False
        for slot, kind in active:
            if kind is Kind.DISCONNECT:
                cut_off = True
            elif kind is Kind.DROP and uniform(state, _WORD) < DROPPED:
                received[:] = last
            elif kind is Kind.DELAY and state["fault.started"][slot]:
                line, place = state["fault.commands"][:, : self._size], state["fault.tick"].item() % LATE
                late = line[place].copy()
                line[place] = wanted
                received[:] = late
            elif kind in (Kind.REVERSED_SIGN, Kind.SATURATED):
                self._misdrive(state, slot, kind)
        if cut_off:
            self._alone(state, received, last, period)
        else:
            state["fault.cut_off"][...] = 0
        last[:] = received
        self._bound.step(state, self._received, touch, period)
        state["fault.tick"][...] = state["fault.tick"].item() + 1

    def _alone(self, state: Record, received: Floats, last: Floats, period: float) -> None:
        """Do what a device without commands does: keep the last command, then become safe by its own watchdog."""
        passed = state["fault.cut_off"].item() + 1
        state["fault.cut_off"] = passed
        received[:] = last
        if passed <= self._patience:
            return
        for channel in self.commands:
            view = self._received[channel.name]
            if isinstance(channel.safe, tuple):
                view[:] = channel.safe
            elif channel.safe is RETRACT and channel.low:
                view[2] = max(channel.low[2], view[2] - RETRACTION * period)

    def _misdrive(self, state: Record, slot: int, kind: Kind) -> None:
        wanted = int(state["fault.channel"][slot])
        for index, channel in enumerate(self.commands):
            if wanted not in (-1, len(self.reads) + index):
                continue
            view = self._received[channel.name]
            if kind is Kind.REVERSED_SIGN:
                self._reverse(state, slot, channel, view)
            else:
                self._saturate(state, channel, view)

    def _reverse(self, state: Record, slot: int, channel: Channel, view: Floats) -> None:
        if channel.role is not Role.SURFACE_POSE:
            view[:] = -view
        elif state["fault.started"][slot]:  # an axis wired backwards moves the other way from where it was
            view[:3] = 2.0 * state["fault.origin"][slot][:3] - view[:3]
            if channel.low:
                view[:3] = np.clip(view[:3], channel.low[:3], channel.high[:3])

    def _saturate(self, state: Record, channel: Channel, view: Floats) -> None:
        """Drive the actuator to its limit, however little is commanded; a zero command stays zero."""
        if channel.role is Role.SURFACE_POSE:
            place = self.twin.position(state)
            if place is None or not channel.low:
                return
            for axis in range(3):
                away = view[axis] - place[axis]
                if abs(away) > ARRIVED:
                    view[axis] = channel.high[axis] if away > 0.0 else channel.low[axis]
            return
        size = float(np.linalg.norm(view))
        most = channel.magnitude or (max(channel.high) if channel.high else size)
        if size > 0.0:
            view *= most / size


def _unit(channel: Channel, index: int) -> str:
    """Return the unit of one component; a quaternion has none."""
    return "" if channel.role is Role.TRACKED_POSE and index >= 3 else channel.unit
