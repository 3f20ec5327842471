"""The safe sequence: what happens, in order, when anything stops, and whether it has happened.

1. Forces go to zero and carried surfaces retract, at once; a surface whose position is not believed retracts in legs
   that are judged by what touches it (`blind_retreat`).
2. A plate that is carried keeps its drive until the finger has left it (under 0.1 N) or 300 ms have passed: a plate
   whose drive is cut under a finger takes on the temperature of its heat sink.
3. Its drive is cut.
4. It is verified, by what the devices measure or where their twins truly are, that each is safe.
5. Watching goes on: a surface that is safe already still moves to the end of its travel, and a drive may fail on the
   way; a slow surface takes long to be safe.  The sequence is over when each one stands still.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import DOUBTS, DeviceFaultError, Heat, Trip
from itouch.plugin import RETRACT, Record, Role
from itouch.safety.actuation import BACKWARDS, HELD
from itouch.safety.blind_retreat import BlindRetreat, TrackedFinger
from itouch.safety.gate import Gate
from itouch.safety.latch import Status

#: Force [N] under which a finger has left the plate, and how long [s] that is waited for.
LEFT, LEAVE_TIME = 0.1, 0.3
#: How long [s] the sequence may take before a device that is not safe, and stands still, is reported; how long [s]
#: surfaces are watched that still move, or retract in legs: a slow one moves for seconds.
SAFE_TIME, WATCH_TIME = 0.5, 5.0
#: How far [m] a surface must have gone back, or how near [m] the end of its travel it must be.
RETREAT, AT_END = 0.003, 0.001
#: How much nearer [m] than where it was furthest back a surface may come while it is told to retract.
WRONG_WAY = 0.0015
#: How long [s] a surface that came nearer is held before its force sensor counts.
SETTLE = 0.05
#: Greatest age [s] of a device's answer that is believed: a device behind a wire does not answer in every tick.
ANSWER = 0.1
#: How far [m] a surface that still presses then is driven back at least.
CLEAR = 0.008
#: Trips after which no reading of a device is believed.  A device that was only late tells the truth when it answers
#: again: if that were not believed, its surface could go the wrong way for as long as the sequence takes.
LIES = DOUBTS - {Trip.SILENT}
#: How often a surface is turned round at most; how long [s] after that readings may still show its way before.
TURNS, TURNING = 2, 0.025
#: How long [s] a surface that has not answered since all stopped retracts as if its position were believed.
UNHEARD = 0.03
#: A surface that is held this much nearer [m] than it was is not safe, whatever its force sensor reads.
NEARER = 0.003
#: A surface that has moved by no more than this [m] for this long [s], and got no new command, stands still.
STANDS, STOOD = 0.0003, 0.05


class Outcome(NamedTuple):
    """How a safe sequence ended: whether all is safe, after what time [s], what was seen of each device.

    ``also`` holds the trips of other devices that failed meanwhile; ``unsafe`` the devices that are not safe.  Left out
    of ``unsafe`` are devices whose only oddity is that their readings do not change, although none of these had to
    change, and surfaces that have gone back and still feel something: a finger that followed, or a sensor off zero.
    """

    safe: bool
    seconds: float
    devices: dict[str, str]
    also: dict[str, str]
    unsafe: tuple[str, ...] = ()


class SafeSequence:
    """Carries out the sequence for the devices of one session.

    ``move`` advances the simulated world by a period; ``fingers``: name of a surface's device -> the tracked fingers
    over it, for when its own position is not believed.
    """

    def __init__(
        self, gates: Sequence[Gate], state: Record, period: float, move: Callable[[], None],
        fingers: Mapping[str, Sequence[TrackedFinger]] | None = None,
    ) -> None:  # fmt: skip
        self._gates, self._period, self._move = tuple(gates), period, move
        self._tick, self._stopping = state["tick"], state["stopping"]
        self._ways = [(g, g.actuation.stopped) for g in gates if g.actuation.stopped is not None and _retracts(g)]
        self._retracting = [g for g, _ in self._ways]
        self._blind = {
            g.model.name: BlindRetreat(g, self._tick, period, (fingers or {}).get(g.model.name, ()))
            for g in self._retracting
        }
        self._mute: set[str] = set()
        self._answered: dict[str, int] = {}
        self._held_for: dict[str, int] = {}
        self._begun: dict[str, list[float]] = {}
        self._furthest: dict[str, float] = {}
        #: Surfaces without a reading that was measured since all stopped.
        self._late: set[str] = set()
        #: How often a surface was turned round, and the tick from which on its readings show its newest way.
        self._turns: dict[str, int] = {}
        self._turned: dict[str, int] = {}
        #: The tick in which it began, how many ticks it has run, and how many were left out because the loop was late.
        self._since = self._passed = self._skipped = 0
        #: When each surface last moved, or was told to: its height [m] then, where it was sent [m], and the tick.
        self._moved: dict[str, tuple[float, float, int]] = {}
        #: When all became safe: the time [s], what was seen of each device, how each surface retracted; None: not yet.
        self._safe: tuple[float, dict[str, tuple[str, bool]], list[int]] | None = None
        #: In how many ticks the sequence is over if not all becomes safe.
        self._rest = 0
        #: What was raised meanwhile, by ``after_tick`` or Ctrl-C; it is for the caller to raise it.
        self.interrupted: BaseException | None = None
        names = {g.model.name for g in self._retracting}
        self._carried = [g for g in gates if g.model.carrier in names and not _retracts(g)]

    def carry_out(self, fault: DeviceFaultError, after_tick: Callable[[], None]) -> Outcome:
        """Make every device safe; ``after_tick`` is called at the end of each tick that this takes.

        Nothing that is raised meanwhile ends the sequence; the first error, or Ctrl-C, is kept in ``interrupted``.
        """
        self._stopping[...] = 1
        for gate, stopped in self._ways:
            self._set_out(gate, stopped)
        for gate in self._gates:
            if gate.model.name == fault.device:
                gate.fault(fault.trip, fault.tick)
            else:
                gate.latch.disable()
        self._held_for.clear()
        self._begun.clear()
        self._answered.clear()
        self._turns.clear()
        self._turned.clear()
        heights = {g.model.name: _height(g) for g in self._retracting}
        self._furthest = dict(heights)
        self._late = {g.model.name for g in self._retracting if g.twin is None}
        self._since = self._tick.item()
        for gate in self._gates:
            gate.actuation.settle(over=False)
        for gate in self._carried:
            gate.actuation.keeping = gate.model.name != fault.device
        self._passed = self._skipped = 0
        self._moved = {name: (height, math.nan, self._since) for name, height in heights.items()}
        self._safe, self._rest, self.interrupted = None, round(SAFE_TIME / self._period), None
        try:
            for _ in range(round(WATCH_TIME / self._period)):
                try:
                    over = self._go_on(heights, after_tick)
                except BaseException as error:
                    self._interrupt(error)
                    continue
                if over:
                    break
        finally:
            self._release()
            self._hold_still()
        self._stopping[...] = 0
        if self._safe is None:
            self._safe = self._seconds, {g.model.name: self._seen(g, heights) for g in self._gates}, []
        seconds, seen, _ = self._safe  # as of when all was safe: later a finger may rest on a surface that stands
        told = {name: text for name, (text, _) in seen.items()}
        faulty = [g for g in self._gates if g.latch.status is Status.FAULT and g.model.name != fault.device]
        also = {g.model.name: g.latch.trip.label for g in faulty}
        odd = {g.model.name for g in self._gates if not self._believed(g) and self._stands(g, heights)}
        odd |= {g.model.name for g in self._retracting if self._back(g, heights[g.model.name])}
        unsafe = tuple(name for name, (_, bad) in seen.items() if bad and name not in odd)
        return Outcome(not any(bad for _, bad in seen.values()), seconds, told, also, unsafe)

    def _go_on(self, heights: dict[str, float], after_tick: Callable[[], None]) -> bool:
        """Run one tick of the sequence; return whether it is over."""
        for part in (self._step, after_tick):  # time goes on, and is paced, even if a step itself has failed
            try:
                part()
            except BaseException as error:
                self._interrupt(error)
        self._mind_direction(heights)
        if self._seconds >= LEAVE_TIME or all(self._left(g) for g in self._retracting):
            self._release()
        ways = [way.item() for _, way in self._ways]
        if self._safe is None or ways != self._safe[2]:
            seen = {g.model.name: self._seen(g, heights) for g in self._gates}
            ends = not self._busy() and not any(bad for _, bad in seen.values())
            self._safe = (self._seconds, seen, ways) if ends else None
        arrived = [self._arrived(g) for g in self._retracting]
        if self._safe is not None:
            self._rest = round(SAFE_TIME / self._period)  # for the case that something is no longer safe later
            return all(arrived)
        self._rest = max(self._rest - 1, int(self._going(arrived)))
        return self._rest == 0

    def _interrupt(self, error: BaseException) -> None:
        """Keep an error, or Ctrl-C, until all is safe: no finger is left pressed because of it."""
        if self.interrupted is None or not isinstance(error, Exception):
            self.interrupted = error

    def leave_out(self, ticks: int) -> None:
        """Count this many ticks that were not run as time that has passed, so that waiting does not get longer."""
        self._skipped += ticks

    @property
    def _seconds(self) -> float:
        """The time [s] that the sequence has taken so far."""
        return (self._passed + self._skipped) * self._period

    def _set_out(self, gate: Gate, stopped: NDArray[np.int8]) -> None:
        """Begin with one surface; drop what an earlier stop found about its direction if it was enabled since."""
        self._blind[gate.model.name].begin()
        way, target = gate.actuation.way, gate.model.command(Role.SURFACE_POSE)
        if gate.latch.enabled:
            stopped[...] = 0
        if way is not None and target is not None and (gate.latch.enabled or math.isnan(way[0].item())):
            way[:] = (gate.sent[target.name][2], math.nan, math.nan)

    def _release(self) -> None:
        for gate in self._carried:
            gate.actuation.keeping = False

    def _busy(self) -> bool:
        """Tell whether a drive is still kept, or a surface driven backwards."""
        return any(g.actuation.keeping for g in self._carried) or any(way.item() == BACKWARDS for _, way in self._ways)

    def _going(self, arrived: Sequence[bool]) -> bool:
        """Tell whether any surface has not ``arrived``, or has legs to go: it may be slow, or behind a slow wire."""
        for (gate, stopped), stands in zip(self._ways, arrived, strict=True):
            blind = self._blind[gate.model.name]
            if blind.under_way(stopped) if blind.active else not stands:
                return True
        return False

    def _hold_still(self) -> None:
        """Hold surfaces that are driven backwards or not believed: nobody watches their direction from now on."""
        for gate, stopped in self._ways:
            if stopped.item() == BACKWARDS or self._blind[gate.model.name].active:
                stopped[...] = HELD
        for gate in self._gates:
            gate.actuation.settle()

    def _step(self) -> None:
        tick = self._tick.item()
        try:
            for gate in self._gates:
                try:
                    gate.write(tick)
                except DeviceFaultError as second:  # the first fault is told; another must not stop the rest
                    gate.trouble = second.cause
                    gate.fault(second.trip, tick)
            self._move()
        finally:  # Ctrl-C in the middle of it
            self._tick[...] = tick + 1
            self._passed += 1
        for gate in self._gates:
            if gate.verify(tick):
                self._answered[gate.model.name] = self._passed
        oldest = self._passed - ANSWER / self._period
        self._mute = {g.model.name for g in self._gates if self._answered.get(g.model.name, -1) <= max(0, oldest)}
        if not self._begun:
            self._begun.update({g.model.name: g.device_monitors.values for g in self._retracting})

    def _arrived(self, gate: Gate) -> bool:
        """Tell whether a surface that may still move has come to rest, at the end of its travel or elsewhere."""
        name, height = gate.model.name, _height(gate)
        sent, (before, asked, tick) = _sent_to(gate), self._moved[name]
        if sent != asked or not abs(height - before) <= STANDS:
            self._moved[name] = height, sent, self._tick.item()
            return height <= _end(gate) + AT_END
        stood = (self._tick.item() - tick) * self._period >= STOOD
        return stood or height <= _end(gate) + AT_END

    def _believed(self, gate: Gate) -> bool:
        """Tell whether a device's readings can be believed now."""
        name = gate.model.name
        if name in self._mute or gate.latch.trip in LIES:
            return False
        frozen = name in self._begun and gate.device_monitors.values == self._begun[name]
        return not frozen or self._passed * self._period < SETTLE

    def _stands(self, gate: Gate, heights: dict[str, float]) -> bool:
        """Tell whether a device answers and none of its readings had to change: a surface stood at its end before."""
        name = gate.model.name
        if name in self._mute or gate.latch.status is Status.FAULT:
            return False
        return name not in heights or heights[name] <= _end(gate) + AT_END

    def _back(self, gate: Gate, before: float) -> bool:
        """Tell whether a surface has gone back as it was told and its drives are off, whatever presses on it."""
        wrong = any(g is gate and stopped.item() for g, stopped in self._ways)
        if wrong or gate.latch.status is Status.FAULT or not self._believed(gate):
            return False
        known = gate.twin is not None or gate.acquisition.measured_at(Role.TRACKED_POSE) >= self._since
        off = not any(_differs(gate.sent[name], guard.channel.safe) for name, guard in gate.actuation.guards)
        height = _height(gate)
        return known and off and (before - height >= RETREAT or height <= _end(gate) + AT_END)

    def _left(self, gate: Gate) -> bool:
        """Tell whether the finger has left a surface, by its force sensor."""
        if not self._believed(gate):
            return False
        loads = [channel.name for channel in gate.model.reads if channel.role is Role.CONTACT_FORCE]
        return all(math.hypot(*gate.reading[name][:3].tolist()) < LEFT for name in loads)

    def _pressed(self, gate: Gate) -> bool:
        """Tell whether a surface still presses on the finger, by a force sensor that can be believed."""
        return self._believed(gate) and not self._left(gate)

    def _nearer(self, gate: Gate, gone: float) -> bool:
        """Tell whether a surface that is held is nearer than it may be: by anything at all, if it is not believed."""
        return gone < -NEARER or (gone < 0.0 and not self._believed(gate))

    def _mind_direction(self, heights: dict[str, float]) -> None:
        """Hold a surface that comes nearer when it is told to retract; if it then presses or is too near, reverse it.

        The true place of a twin is known, whatever it reads; if its readings are not believed, it may press.
        """
        for gate, stopped in self._ways:
            name = gate.model.name
            if gate.twin is None and not self._believed(gate):
                self._retreat_blind(gate, stopped)  # a position that is not believed tells no direction
                continue
            height = _height(gate)
            if self._blind[name].active and gate.actuation.way is not None:
                self._blind[name].drop(stopped, gate.actuation.way)
                self._furthest[name] = height
                self._change(name)
            if name in self._late:
                if gate.acquisition.measured_at(Role.TRACKED_POSE) < self._since:
                    continue  # the first readings over a late wire still show where the surface went before
                self._late.discard(name)
                heights[name] = self._furthest[name] = height
            if self._measured(gate) < self._turned.get(name, 0):
                self._furthest[name] = height  # for a moment it still goes on as it went before
            furthest = self._furthest[name] = min(self._furthest[name], height)
            gone = heights[name] - height
            if stopped.item() == 0 and height - furthest > WRONG_WAY:
                stopped[...], self._held_for[name] = HELD, 0
                self._change(name)
            elif stopped.item() == HELD and name in self._held_for:
                self._held_for[name] += 1
                nearer = self._nearer(gate, gone)
                if self._held_for[name] * self._period > SETTLE and (nearer or self._pressed(gate)):
                    stopped[...], self._furthest[name] = BACKWARDS, height
            elif stopped.item() == BACKWARDS and height - furthest > WRONG_WAY:  # this is the wrong way, too
                self._turn(name, stopped)
            elif stopped.item() == BACKWARDS and gone >= CLEAR and not self._pressed(gate):
                stopped[...] = HELD
                self._held_for.pop(name, None)

    def _retreat_blind(self, gate: Gate, stopped: NDArray[np.int8]) -> None:
        """Withdraw a surface by what touches it; but first give one that has merely not answered yet time to do so."""
        lies = gate.latch.trip in LIES or gate.model.name not in self._mute
        if gate.actuation.way is not None and (lies or self._passed * self._period >= UNHEARD):
            self._blind[gate.model.name].mind(stopped, gate.actuation.way)

    def _change(self, name: str) -> None:
        """Note that a surface changes its direction now."""
        self._turned[name] = self._tick.item() + round(TURNING / self._period)

    def _measured(self, gate: Gate) -> int:
        """Return the tick to which the known height of a surface belongs."""
        return self._tick.item() if gate.twin is not None else gate.acquisition.measured_at(Role.TRACKED_POSE)

    def _turn(self, name: str, stopped: NDArray[np.int8]) -> None:
        """Send a surface that was driven backwards down again; hold one that was turned too often: no way is right."""
        self._held_for.pop(name, None)
        self._change(name)
        self._turns[name] = self._turns.get(name, 0) + 1
        stopped[...] = HELD if self._turns[name] > TURNS else 0

    def _seen(self, gate: Gate, heights: dict[str, float]) -> tuple[str, bool]:
        """Return what is seen of a device in words, and whether it is not safe."""
        name = gate.model.name
        if gate.twin is None and not self._believed(gate):
            blind = self._blind.get(name)
            done = blind.said(gate.actuation.way) if blind is not None and gate.actuation.way is not None else ""
            return f"can't be verified: its sensors are not believed, or it does not answer{done}", True
        surface = self._seen_surface(gate, heights[name]) if name in heights else None
        if surface is not None and surface[1]:
            return surface
        acting = [n for n, guard in gate.actuation.guards if isinstance(guard.channel.safe, tuple)]
        left_on = [n for n, guard in gate.actuation.guards if _differs(gate.sent[n], guard.channel.safe)]
        if left_on:
            return f"{', '.join(left_on)} is not off", True
        heats = gate.heats if self._believed(gate) else []
        plates = [post.monitor for post in heats if isinstance(post.monitor, Heat)]
        for one in plates:
            if one.beyond(gate.reading):
                return f"off, but the plate is {one.shown(gate.reading)}", True
        plate = "".join(f", plate {one.shown(gate.reading)}" for one in plates)
        if surface is not None:
            return f"{surface[0]}{plate}", False
        if gate.model.command(Role.SURFACE_POSE) is not None:
            pressed = self._pressed(gate)
            return f"held where it is{', still touched' if pressed else ''}{plate}", pressed
        return (f"{', '.join(acting)} off{plate}" if acting else "nothing to switch off"), False

    def _seen_surface(self, gate: Gate, before: float) -> tuple[str, bool]:
        bottom = _end(gate)
        if gate.twin is None and gate.acquisition.measured_at(Role.TRACKED_POSE) < self._since:
            return "not measured since it was told to retract", True
        height = _height(gate)
        gone = before - height
        pressed = self._pressed(gate)
        if any(g is gate and stopped.item() for g, stopped in self._ways):
            since = self._turned.get(gate.model.name, 0)
            going_on = gate.twin is None and self._measured(gate) < since
            unsafe = pressed or going_on or self._nearer(gate, gone)
            return f"goes the wrong way: held {gone * 1e3:.1f} mm further back", unsafe
        if (gone >= RETREAT or height <= bottom + AT_END) and not pressed:
            return f"retracted {max(0.0, gone) * 1e3:.1f} mm", False
        return f"retracted only {gone * 1e3:.1f} mm{', still touched' if pressed else ''}", True


def _end(gate: Gate) -> float:
    """Return the height [m] at which the travel of a surface ends."""
    channel = next((c for c in gate.model.commands if c.role is Role.SURFACE_POSE), None)
    return channel.low[2] if channel is not None and channel.low else -math.inf


def _retracts(gate: Gate) -> bool:
    return any(channel.safe is RETRACT for channel in gate.model.commands)


def _height(gate: Gate) -> float:
    """Return the height of a surface [m]: the twin's true place, else what the device measures."""
    true = gate.twin.position(gate.twin_state) if gate.twin is not None else None
    return float(true[2]) if true is not None else _read_height(gate)


def _sent_to(gate: Gate) -> float:
    """Return the height to which a surface that can retract was sent [m]."""
    channel = next(channel for channel in gate.model.commands if channel.safe is RETRACT)
    return float(gate.sent[channel.name][2])


def _differs(sent: NDArray[np.float64], safe: object) -> bool:
    return isinstance(safe, tuple) and tuple(sent.tolist()) != safe


def _read_height(gate: Gate) -> float:
    pose = next((c.name for c in gate.model.reads if c.role is Role.TRACKED_POSE), None)
    return float(gate.reading[pose][2]) if pose is not None else math.nan
