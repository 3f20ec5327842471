"""Withdrawing a surface whose place is not believed: in short legs, each judged by what touches the surface.

Its drive may be wired backwards as well, and then it comes up as it is told to go down.  Nothing that it says of its
place tells that; what does is independent of it: the devices that track the fingers over it, and its own force sensor,
as far as that one means anything.

* It is told to go down by a leg, which it has to have gone before anything is judged: for as long as wires may take,
  counted from when the last command of the leg is known to have left, where the wire says that.
* A finger that rose by about that leg *in* the leg, and went on no further after it, is pushed; if a force has grown as
  well, a part of the leg is enough: its hand may be stiff.  Once may be chance (a finger that is lifted and then held):
  that stops nothing, and calls nothing back.  Twice in a row, leg by leg, hardly is.
* It is then told to go up to where it stood when all stopped, no further.  A finger that comes down with it has been
  pushed; else it is told to go down for good.  If nothing is known of a finger any more then, it is held there.
* Only then is it driven on the other way, again by legs: the first in which a finger rises sends it down for good.
* A force that grows, twice in a row, on a finger that does not come down stops it: its sensor may lie, too.

However it ends, it is held, ``BLIND`` from where it stood at most: as long as nobody knows which way it goes, it goes
no further than it must to let go of a finger.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import DOUBTS
from itouch.plugin import RETRACT, Role
from itouch.safety.lifecycle import BACKWARDS, HELD
from itouch.safety.supervisor import Supervisor

#: How far [m] a leg leads, and all of them together, from where a surface was sent when all stopped.
LEG, BLIND = 0.002, 0.006
#: How long [s] a surface and a finger on it take to come to rest, and how long they are watched then.
SETTLING, WATCHED = 0.025, 0.015
#: Between which parts of a leg a finger moves that is pushed along, and what part it may go on, or swing back, then.
FITS, STILL, SWINGS = (0.6, 1.4), 0.1, 0.4
#: The least part of a leg by which a finger moves on a stiff hand, if a force has changed as well.
FIRM = 0.2
#: How old [s] what is known of a finger may be.
KNOWN = 0.1
#: A finger that moves by this part of a leg in its direction has followed, or is pushed on the other way.
FOLLOWS = 0.5
#: By how much [N] a force has grown.
HARDER = 0.3
#: After so many legs in a row that have pushed a surface is turned round, or stopped.
SURE = 2
#: How long [s] a command that has not left is waited for before the retreat is no longer said to be under way.
PATIENCE = 0.5
#: Shortest leg [m], and how near its goal a surface is there [m].
SHORTEST, _NEAR = 0.001, 1e-9


class TrackedFinger(NamedTuple):
    """What tracks a finger over a surface, and how high [m] that is in the direction in which the surface lifts."""

    tracker: Supervisor
    height: Callable[[], float]


class Observation(NamedTuple):
    """What is known of fingers and force at one time: heights [m] and force [N], NaN: not known."""

    heights: tuple[float, ...]
    force: float


class RetreatPhase(enum.IntEnum):
    """What a leg is for."""

    DOWN = 0
    #: Up again to where it stood.
    BACK = 1
    #: On the other way.
    OTHER = 2
    #: Down, whatever happens.
    AWAY = 3


def along(asked: float, before: float, middle: float, after: float, least: float = FITS[0]) -> bool:
    """Tell whether a finger moved as one is moved by a surface that goes the other way than it is told to.

    Parameters
    ----------
    asked
        By how much the surface was told to go up [m].
    before, middle, after
        How high the finger was [m] when the leg began, when it must have been over, and a while later; NaN: not known.
    least
        The part of the leg by which it must have moved.
    """
    moved, then = (before - middle) / asked, (middle - after) / asked
    return least <= moved <= FITS[1] and -SWINGS <= then <= STILL


def _tells(heights: tuple[float, ...]) -> bool:
    """Tell whether heights say anything of a finger that has been moved: not if unknown, nor if all are the same."""
    return not math.isnan(sum(heights)) and any(height != heights[0] for height in heights)


class BlindRetreat:
    """Withdraws one surface whose place is not believed; it must be able to retract.

    ``fingers``: those over it that something tracks.
    """

    def __init__(
        self, supervisor: Supervisor, tick: NDArray[np.int64], period: float, fingers: Sequence[TrackedFinger]
    ) -> None:
        model = supervisor.model
        channel = next(channel for channel in model.commands if channel.safe is RETRACT)
        self._supervisor, self._tick = supervisor, tick
        self._fingers = tuple(fingers)
        self._sent = supervisor.sent[channel.name]
        self._ends = (channel.low[2], channel.high[2]) if channel.low else (-math.inf, math.inf)
        self._loads = [one.name for one in model.reads if one.role is Role.CONTACT_FORCE]
        exchange = max(model.cls.takes(model.params), model.cls.period + model.cls.delay)
        #: How many ticks a leg takes after its last command was asked for, and after that one has left.
        self._acts, self._rests = (round((trips * exchange + SETTLING) / period) for trips in (2.0, 1.0))
        self._watched = round(WATCHED / period)
        self._known, self._patience = round(KNOWN / period), round(PATIENCE / period)
        self.begin()

    def begin(self) -> None:
        """Begin a safe sequence."""
        #: Whether its place is not believed now.
        self.active = False
        self._phase = RetreatPhase.DOWN
        #: The ticks in which a leg's last command was asked for, and was known to have left.
        self._reached: int | None = None
        self._left: int | None = None
        #: How many legs in a row have moved a finger, and how many were felt.
        self._pushed = self._harder = 0
        self._asked = self._goal = math.nan
        self._before = Observation((), math.nan)
        self._middle: Observation | None = None

    def said(self, way: NDArray[np.float64]) -> str:
        """Say what was done, for the report; ``way`` (3,) [m] as in ``mind``."""
        if not self.active:
            return ""
        gone = (way[0].item() - self._sent[2].item()) * 1e3
        if self._phase is RetreatPhase.BACK:
            return "; it pushed as it was told to go back, and was sent to where it stood"
        if self._phase is RetreatPhase.OTHER:
            return f"; it pushed as it was told to go back, and was sent {-gone:.1f} mm the other way"
        return f"; it was told to go back by {gone:.1f} mm"

    def mind(self, stopped: NDArray[np.int8], way: NDArray[np.float64]) -> None:
        """Judge a leg that is over, and lead the next one.

        Parameters
        ----------
        stopped, way
            As in ``Lifecycle``: how the surface retracts, and between which heights [m] it may be sent, shape (3,).
        """
        if not self.active:
            self.active = True
            if stopped.item() == BACKWARDS:  # so it was found to be right while its place was believed
                self._phase = RetreatPhase.OTHER
            if stopped.item() != HELD:
                self._go_on(stopped, way)
        if stopped.item() == HELD or abs(self._sent[2].item() - self._goal) > _NEAR:
            return
        if self._phase is RetreatPhase.AWAY:
            stopped[...] = HELD
            return
        if self._reached is None:
            self._reached = self._tick.item()
        if self._left is None and self._has_left():
            self._left = self._tick.item()
        if self._left is None:
            return
        over = max(self._reached + self._acts, self._left + self._rests)
        if self._middle is None and self._heard(over):
            self._middle = self._look()
        if self._middle is not None and self._heard(over + self._watched):
            self._judge(self._middle, self._look(), stopped, way)

    def under_way(self, stopped: NDArray[np.int8]) -> bool:
        """Tell whether one that is ``active`` has legs to go; ``stopped`` as in ``mind``, shape (), dimensionless.

        One whose wire takes no command any more, and says so, is not waited for.
        """
        waited = 0 if self._reached is None else self._tick.item() - self._reached
        return stopped.item() != HELD and waited <= self._patience

    def drop(self, stopped: NDArray[np.int8], way: NDArray[np.float64]) -> None:
        """Let the surface retract as others do: its place is believed again.

        ``stopped`` and ``way`` (3,) [m] as in ``mind``.
        """
        self.begin()
        stopped[...], way[1:] = 0, math.nan

    @property
    def _up(self) -> bool:
        """Whether the leg leads up: back to where it stood, or on the other way."""
        return self._phase in (RetreatPhase.BACK, RetreatPhase.OTHER)

    def _has_left(self) -> bool:
        """Tell whether a leg's last command has left, as far as the wire tells: a busy machine may be late with it."""
        goal = self._supervisor.gone_to
        return goal is None or abs(goal - self._goal) <= _NEAR

    def _heard(self, tick: int) -> bool:
        """Tell whether all that is known of fingers was measured since a tick."""
        times = [one.tracker.measured_at(Role.TRACKED_POSE) for one in self._fingers if self._knows(one.tracker)]
        return bool(self._tick.item() >= tick) and all(time >= tick for time in times)

    def _knows(self, tracker: Supervisor) -> bool:
        """Tell whether what a device says of a finger can be believed, and is new."""
        age = self._tick.item() - tracker.measured_at(Role.TRACKED_POSE)
        return tracker.trip not in DOUBTS and age <= self._known

    def _look(self) -> Observation:
        heights = [one.height() if self._knows(one.tracker) else math.nan for one in self._fingers]
        loads = [math.hypot(*self._supervisor.reading[name][:3].tolist()) for name in self._loads]
        return Observation(tuple(heights), max(loads, default=math.nan))

    def _judge(
        self, middle: Observation, after: Observation, stopped: NDArray[np.int8], way: NDArray[np.float64]
    ) -> None:
        """Decide what is next after a leg, by what was observed at its end and a while later."""
        asked, before = self._asked, self._before
        ways = list(zip(before.heights, middle.heights, after.heights, strict=True))
        followed = any((last - first) / asked >= FOLLOWS for first, _, last in ways)
        harder = min(middle.force, after.force) - before.force > HARDER and (self._up or not followed)
        softer = before.force - max(middle.force, after.force) > HARDER
        least = FIRM if (softer if self._up else harder) else FITS[0]
        moved = any(along(asked, *heights, least) for heights in ways)
        self._harder = self._harder + 1 if harder else 0
        self._pushed = self._pushed + 1 if moved else 0
        if self._phase is RetreatPhase.BACK:
            if not any(_tells(heights) for heights in ways):  # it stands where it stood: no way is better
                stopped[...] = HELD
                return
            self._phase = RetreatPhase.OTHER if moved else RetreatPhase.AWAY
        elif self._phase is RetreatPhase.OTHER and followed:
            self._phase = RetreatPhase.AWAY
        elif self._phase is RetreatPhase.DOWN and self._pushed >= SURE:
            self._phase = RetreatPhase.BACK
        elif self._harder >= SURE:
            stopped[...] = HELD
            return
        self._go_on(stopped, way)

    def _go_on(self, stopped: NDArray[np.int8], way: NDArray[np.float64]) -> None:
        """Lead the next leg of the phase; hold the surface if there is none."""
        sent, stood = self._sent[2].item(), way[0].item()
        if self._phase is RetreatPhase.BACK:
            goal = stood
        elif self._phase is RetreatPhase.AWAY:
            goal = stood - BLIND
        elif self._phase is RetreatPhase.OTHER:
            goal = min(sent + LEG, stood + BLIND)
        else:
            goal = max(sent - LEG, stood - BLIND)
        goal = min(max(goal, self._ends[0]), self._ends[1])
        if (goal - sent if self._up else sent - goal) < SHORTEST:
            stopped[...] = HELD
            return
        stopped[...] = BACKWARDS if self._up else 0
        way[1:] = (math.nan, goal) if self._up else (goal, math.nan)
        self._goal, self._asked = goal, goal - sent
        self._reached = self._left = None
        self._before, self._middle = self._look(), None
