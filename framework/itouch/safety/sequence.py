"""The safe sequence: what happens, in order, when anything stops, and whether it has happened.

1. Forces go to zero and carried surfaces retract, at once.
2. A plate that is carried keeps its drive until the finger has left it (under 0.1 N) or 300 ms have passed: a plate
   whose drive is cut under a finger takes on the temperature of its heat sink.
3. Its drive is cut.
4. Verified: what the devices measure, or their twins truly do, says that each is safe.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import RETRACT, Record
from itouch.safety.supervisor import Supervisor
from itouch.safety.trips import DeviceFaultError

#: Force [N] under which a finger has left the plate, and how long [s] that is waited for.
LEFT, LEAVE_TIME = 0.1, 0.3
#: How long [s] the whole sequence may take before what is not safe is told.
SAFE_TIME = 0.5
#: How far [m] a surface must have gone back, or how near the end of its travel it must be.
RETREAT, AT_END = 0.003, 0.001


class Outcome(NamedTuple):
    """How a safe sequence ended: whether all is safe, after what time [s], and what was seen of each device."""

    safe: bool
    seconds: float
    devices: dict[str, str]


class SafeSequence:
    """Carries out the sequence for the devices of one session."""

    def __init__(
        self, supervisors: Sequence[Supervisor], state: Record, period: float, move: Callable[[], None]
    ) -> None:
        self._supervisors, self._period, self._move = tuple(supervisors), period, move
        self._tick = state["tick"]
        self._retracting = [s for s in supervisors if _retracts(s)]
        self._mute: set[str] = set()
        names = {s.model.name for s in self._retracting}
        self._carried = [s for s in supervisors if s.model.carrier in names and not _retracts(s)]

    def carry_out(self, fault: DeviceFaultError, after_tick: Callable[[], None]) -> Outcome:
        """Make every device safe; ``after_tick`` is called at the end of each tick that this takes."""
        for supervisor in self._supervisors:
            if supervisor.model.name == fault.device:
                supervisor.fault(fault.trip, fault.tick)
            else:
                supervisor.disable()
        heights = {s.model.name: _height(s) for s in self._retracting}
        for supervisor in self._carried:
            supervisor.keeping = supervisor.model.name != fault.device
        leaving, passed = round(LEAVE_TIME / self._period), 0
        try:
            for passed in range(1, round(SAFE_TIME / self._period) + 1):
                self._step()
                after_tick()
                if passed >= leaving or all(self._load(s) < LEFT for s in self._retracting):
                    self._release()
                if not any(s.keeping for s in self._carried) and self._safe(heights):
                    break
        finally:
            self._release()
        seen = {s.model.name: self._seen(s, heights) for s in self._supervisors}
        told = {name: text for name, (text, _) in seen.items()}
        return Outcome(not any(bad for _, bad in seen.values()), passed * self._period, told)

    def _release(self) -> None:
        for supervisor in self._carried:
            supervisor.keeping = False

    def _step(self) -> None:
        tick = self._tick.item()
        for supervisor in self._supervisors:
            try:
                supervisor.write(tick)
            except DeviceFaultError as second:  # one fault is told; a second one must not stop the rest
                supervisor.fault(second.trip, tick)
        self._move()
        self._tick[...] = tick + 1
        self._mute = {s.model.name for s in self._supervisors if not s.glance()}

    def _safe(self, heights: dict[str, float]) -> bool:
        return not any(self._seen(s, heights)[1] for s in self._supervisors)

    def _load(self, supervisor: Supervisor) -> float:
        """Return the force [N] on a surface by its sensor; 0 without one, or if it does not answer."""
        if supervisor.model.name in self._mute or "wrench" not in supervisor.reading:
            return 0.0
        return abs(float(supervisor.reading["wrench"][2]))

    def _seen(self, supervisor: Supervisor, heights: dict[str, float]) -> tuple[str, bool]:
        """Say what is seen of a device, and whether it is not safe."""
        name = supervisor.model.name
        if name in self._mute and supervisor.twin is None:
            return "does not answer: its own watchdog must stop it", True
        if name in heights:
            return self._seen_surface(supervisor, heights[name])
        acting = [n for n, guard in supervisor.guards if isinstance(guard.channel.safe, tuple)]
        left_on = [n for n, guard in supervisor.guards if _differs(supervisor.sent[n], guard.channel.safe)]
        if left_on:
            return f"{', '.join(left_on)} is not off", True
        if supervisor.heat is not None and supervisor.heat.beyond():
            return f"off, but the plate is {supervisor.heat.shown}", True
        plate = f", plate {supervisor.heat.shown}" if supervisor.heat is not None else ""
        return (f"{', '.join(acting)} off{plate}" if acting else "nothing to switch off"), False

    def _seen_surface(self, supervisor: Supervisor, before: float) -> tuple[str, bool]:
        channel = supervisor.model.command("pose_target")
        height, load = _height(supervisor), self._load(supervisor)
        bottom = channel.low[2] if channel is not None and channel.low else -math.inf
        gone = before - height
        if (gone >= RETREAT or height <= bottom + AT_END) and load < LEFT:
            return f"retracted {max(0.0, gone) * 1e3:.1f} mm", False
        return f"retracted only {gone * 1e3:.1f} mm, feels {load:.2f} N", True


def _retracts(supervisor: Supervisor) -> bool:
    return any(channel.safe is RETRACT for channel in supervisor.model.commands)


def _height(supervisor: Supervisor) -> float:
    """Return where a surface is [m]: the twin's true place, else what the device measures."""
    true = supervisor.twin.position(supervisor.twin_state) if supervisor.twin is not None else None
    return float(true[2]) if true is not None else float(supervisor.reading["pose"][2])


def _differs(sent: NDArray[np.float64], safe: object) -> bool:
    return isinstance(safe, tuple) and tuple(sent.tolist()) != safe
