"""The operator's hand: the pieces of its target's path, and its finger, which forces move.

The law by which the target goes along a piece (minimum jerk) is `itouch.twin.mechanics.aim`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Bound, Record
from itouch.scene.elements import Operator
from itouch.schema.hold_until import Until
from itouch.twin.mechanics import AlongPath, follow_path, lower
from itouch.twin.waits import Waits
from itouch.world.recorded_motion import RecordedMotion
from itouch.world.skin_source import SkinSource

Vector = tuple[float, float, float]
#: Speed at which the hand is moved away from its path for a calibration, and back [m/s].
LEAD_SPEED = 0.08
#: Greatest speed of a hand that a person steers [m/s].
STEER_SPEED = 0.3
#: Whether the hand follows its path, is steered by a person, or returns to its path.
STILL, LED, HOMING = 0, 1, 2


class Path:
    """The motion of the hand's target: pieces of minimum jerk, each followed by a rest; see ``mechanics.aim``."""

    def __init__(self, operator: Operator, start: Vector = (0.0, 0.0, 0.0)) -> None:
        targets = operator.motion.targets
        self.start: Vector = targets[0].pos if targets else start
        rows, here, time = [], self.start, 0.0
        for target in targets:
            rows.append((time, target.in_, *here, *target.pos))
            time += target.in_ + (target.hold if isinstance(target.hold, float | int) else 0.0)
            here = target.pos
        self.duration = time
        self.pieces = np.array(rows or [(0.0, 1.0, *self.start, *self.start)], np.float64)


def first_rest(operator: Operator) -> float:
    """Return how long [s] a hand rests where its path begins; inf: for good, or for as long as a skin decides."""
    rest, targets = 0.0, operator.motion.targets
    for target in targets:
        if target.pos != targets[0].pos:
            return rest
        if isinstance(target.hold, Until):
            break
        rest += target.in_ + target.hold
    return math.inf


class RecordedPath:
    """The motion of the hand's target along recorded positions: a single piece, which is set anew for every step.

    In the middle of its time, a minimum-jerk piece is half-way between its ends, with 1.875 times its mean velocity; so
    it is set around each moment such that it passes the recorded position with the recorded velocity.
    """

    def __init__(self, recorded: RecordedMotion) -> None:
        self._places, self._step = recorded.positions, recorded.period
        self._last = len(self._places) - 1
        self.start: Vector = (self._places[0, 0].item(), self._places[0, 1].item(), self._places[0, 2].item())
        self.duration = self._last * self._step
        self._row = np.array([(-1.0, 2.0, *self.start, *self.start)], np.float64)
        self.pieces = self._row[:]

    def lay(self, time: float) -> None:
        """Set the piece around a time [s]; before the start and after the end the hand rests."""
        at = min(max(time / self._step, 0.0), float(self._last))
        index = min(int(at), max(self._last - 1, 0))
        here, there = self._places[index], self._places[min(index + 1, self._last)]
        place = here + (at - index) * (there - here)
        half = (there - here) / (2.0 * self._step) if 0.0 < time < self.duration else np.zeros(3)
        self._row[0, 0], self._row[0, 1] = time - 0.9375, 1.875
        self._row[0, 2:5], self._row[0, 5:8] = place - half, place + half


class Hand:
    """The target of one probe's hand, and the finger's motion, as views of State."""

    def __init__(
        self, operator: Operator, name: str, state: Record, period: float, *, recorded: RecordedMotion | None = None,
        start: Vector = (0.0, 0.0, 0.0), skin: SkinSource | None = None,
    ) -> None:  # fmt: skip
        self.operator, self._period = operator, period
        self._recorded = RecordedPath(recorded) if recorded is not None else None
        self.path: Path | RecordedPath = self._recorded or Path(operator, start)
        self._end = math.ceil(self.path.duration / period - 1e-9)
        self.ticks, self.offset = state[f"{name}.hand.ticks"], state[f"{name}.hand.offset"]
        self._steered, self._target_offset = state[f"{name}.hand.steered"], state[f"{name}.hand.target_offset"]
        #: The hand's time on its path [s], shape (1,); computed anew in every step.
        self.time = np.zeros(1)
        lower(np.zeros(3), 0.0, 0.0)  # load it now, so that no tick has to
        self.motion: NDArray[np.float64] = state.flat(f"{name}.hand.position", f"{name}.hand.target")
        #: Its waits for the skin, if its path has any.
        self.waits = Waits(operator, name, state, period, skin) if skin is not None else None

    def reset(self) -> None:
        """Rest at the first target."""
        self.motion[:] = (*self.path.start, 0.0, 0.0, 0.0, *self.path.start)
        self.offset[:] = self._target_offset[:] = 0.0
        self.ticks[...] = self._steered[...] = 0
        if self.waits is not None:
            self.waits.reset()

    @property
    def done(self) -> bool:
        """Whether the scripted motion has ended."""
        ticks = self.ticks.item()
        return bool(ticks >= self._end) and (self.waits is None or not self.waits.pending(ticks))

    @property
    def left(self) -> int:
        """In how many ticks, at the earliest, the scripted motion ends."""
        return self._end - int(self.ticks.item())

    def lower(self, offset: float) -> None:
        """Move the hand's target towards a height above or below its path [m], at ``LEAD_SPEED``."""
        lower(self.offset, offset, LEAD_SPEED * self._period)

    @property
    def home(self) -> bool:
        """Whether the hand's target is on its path."""
        return not self.offset.any()

    def steer(self, step: Vector | None) -> None:
        """Move the target by a step [m] off its path, which is paused from then on; None leads it back to its path.

        Raises
        ------
        ValueError
            If the step is not finite.
        """
        if step is not None and not all(math.isfinite(part) for part in step):
            raise ValueError(f"step = {step!r} must be three finite numbers of metres")
        self._steered[...] = LED if step is not None else STILL if self.home else HOMING
        self._target_offset[:] = 0.0 if step is None else self._target_offset + np.asarray(step)

    def _follow(self) -> bool:
        """Move the target towards where it is steered, no faster than a hand may; return whether the path is paused."""
        if not self._steered.item():
            return False
        away = self._target_offset - self.offset
        distance = math.sqrt(float(away @ away))
        reach = STEER_SPEED * self._period
        self.offset[:] = self._target_offset if distance <= reach else self.offset + away * (reach / distance)
        if distance <= reach and self._steered.item() == HOMING:
            self._steered[...] = STILL
        return True

    def bound(self, moving: NDArray[np.int64], stage: NDArray[np.int64], done: int) -> Bound | None:
        """Return the usual step along the path as one compiled call, which returns 1 if ``advance`` is needed instead.

        ``moving`` (1,), 0 or 1: whether scripts run; ``stage`` (1,), a touch-off's stage as a code, ``done`` its last.
        """
        if self._recorded is not None:
            return None
        back = LEAD_SPEED * self._period
        path = AlongPath(moving, self._steered, self.ticks, self.time, self._period, self.offset, back, stage, done)
        return Bound(follow_path, path) if self.waits is None else self.waits.bound(path)

    def advance(self, moving: bool) -> None:
        """Compute the time on the path for the next step; it advances if ``moving`` and nothing holds it."""
        ticks: int = self.ticks.item()
        if self.waits is not None:
            self.waits.look()
        if moving and not self._follow() and (self.waits is None or not self.waits.stay()):
            ticks += 1
            self.ticks[...] = ticks
        if self._recorded is not None:
            self._recorded.lay(ticks * self._period)
        self.time[0] = ticks * self._period
