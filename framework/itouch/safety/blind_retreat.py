"""Withdrawing a surface whose position is not believed: in short legs, each judged by what touches the surface.

Its drive may be wired backwards as well, and then the surface comes up when it is told to go down.  Its own position
reading cannot show that; what can is independent of it: the devices that track the fingers over it, and its own force
sensor, as far as that one can be trusted.

* The surface is told to go down by one leg, and nothing is judged before the leg must be over: after as long as wires
  may take, counted, where the wire tells it, from when the last command of the leg has left.
* A finger that rose by about one leg *during* the leg, and no further after it, counts as pushed; if a force has grown
  as well, a part of the leg is enough, because the hand may be stiff.  Once may be chance (a finger that is lifted and
  then held): it has no consequence.  Twice in a row, leg by leg, is hardly chance.
* The surface is then told to go up to where it stood when all stopped, no further.  If a finger comes down with it, the
  finger had been pushed; else the surface is told to go down for good.  If by then nothing is known of any finger, it
  is held there.
* Only then is it driven on the other way, again by legs: the first leg in which a finger rises sends it down for good.
* A force that grows twice in a row on a finger that does not come down stops the surface; its sensor, too, may lie.

However it ends, the surface is held, at most ``BLIND`` from where it stood: as long as nobody knows which way it goes,
it goes no further than it must to let go of a finger.
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
from itouch.safety.actuation import BACKWARDS, HELD
from itouch.safety.gate import Gate

#: Length [m] of a leg, and of all legs together, from where a surface was sent when all stopped.
LEG, BLIND = 0.002, 0.006
#: How long [s] a surface and a finger on it take to come to rest, and how long they are then watched.
SETTLING, WATCHED = 0.025, 0.015
#: Between which parts of a leg a finger moves that is pushed along, and by what part it may then go on, or swing back.
FITS, STILL, SWINGS = (0.6, 1.4), 0.1, 0.4
#: The least part of a leg by which the finger of a stiff hand moves, if a force has changed as well.
FIRM = 0.2
#: Greatest age [s] of a finger's tracked position.
KNOWN = 0.1
#: A finger that moves by this part of a leg in its direction follows the surface or, on the other way, is pushed by it.
FOLLOWS = 0.5
#: By how much [N] a force must have grown, or fallen, to count.
HARDER = 0.3
#: After this many legs in a row that have pushed a finger, or pressed harder, a surface is turned round, or stopped.
SURE = 2
#: How long [s] a command that has not left is waited for; after that the retreat no longer counts as under way.
PATIENCE = 0.5
#: Shortest leg [m], and how near its goal a surface counts as being there [m].
SHORTEST, _NEAR = 0.001, 1e-9


class TrackedFinger(NamedTuple):
    """The device that tracks a finger over a surface, and the finger's height [m] along the surface's axis of lift."""

    tracker: Gate
    height: Callable[[], float]


class Observation(NamedTuple):
    """What is known of fingers and force at one time: their heights [m] and the force [N]; NaN: not known."""

    heights: tuple[float, ...]
    force: float


class RetreatPhase(enum.IntEnum):
    """The purpose of a leg."""

    DOWN = 0
    #: Up again, to where the surface stood.
    BACK = 1
    #: On the other way: further up.
    OTHER = 2
    #: Down, whatever happens.
    AWAY = 3


def along(asked: float, before: float, middle: float, after: float, least: float = FITS[0]) -> bool:
    """Tell whether a finger moved as a surface moves it that goes the opposite way to what it is told.

    Parameters
    ----------
    asked
        By how much the surface was told to go up [m].
    before, middle, after
        Height of the finger [m] when the leg began, when it must have been over, and a while later; NaN: not known.
    least
        The least part of the leg by which the finger must have moved.
    """
    moved, then = (before - middle) / asked, (middle - after) / asked
    return least <= moved <= FITS[1] and -SWINGS <= then <= STILL


def _tells(heights: tuple[float, ...]) -> bool:
    """Tell whether heights show a finger that has moved: they don't if one is unknown, or if all are the same."""
    return not math.isnan(sum(heights)) and any(height != heights[0] for height in heights)


class BlindRetreat:
    """Withdraws one surface whose position is not believed; it must be able to retract.

    ``fingers``: the tracked fingers over it.
    """

    def __init__(self, gate: Gate, tick: NDArray[np.int64], period: float, fingers: Sequence[TrackedFinger]) -> None:
        model = gate.model
        channel = next(channel for channel in model.commands if channel.safe is RETRACT)
        self._gate, self._tick = gate, tick
        self._fingers = tuple(fingers)
        self._sent = gate.sent[channel.name]
        self._ends = (channel.low[2], channel.high[2]) if channel.low else (-math.inf, math.inf)
        self._loads = [one.name for one in model.reads if one.role is Role.CONTACT_FORCE]
        exchange = max(model.cls.exchange_time_for(model.params), model.cls.period + model.cls.delay)
        #: How many ticks a leg takes after its last command was requested, and after that command has left.
        self._acts, self._rests = (round((trips * exchange + SETTLING) / period) for trips in (2.0, 1.0))
        self._watched = round(WATCHED / period)
        self._known, self._patience = round(KNOWN / period), round(PATIENCE / period)
        self.begin()

    def begin(self) -> None:
        """Begin a safe sequence: forget the legs of an earlier one."""
        #: Whether its position is not believed, so that it is withdrawn by legs.
        self.active = False
        self._phase = RetreatPhase.DOWN
        #: The ticks in which a leg's last command was requested, and was known to have left.
        self._reached: int | None = None
        self._left: int | None = None
        #: How many legs in a row have pushed a finger, and in how many in a row the force grew.
        self._pushed = self._harder = 0
        self._asked = self._goal = math.nan
        self._before = Observation((), math.nan)
        self._middle: Observation | None = None

    def said(self, way: NDArray[np.float64]) -> str:
        """Return what was done, as an addition to a sentence of the report; ``way`` (3,) [m] as in ``mind``."""
        if not self.active:
            return ""
        gone = (way[0].item() - self._sent[2].item()) * 1e3
        if self._phase is RetreatPhase.BACK:
            return "; it pushed as it was told to go back, and was sent to where it stood"
        if self._phase is RetreatPhase.OTHER:
            return f"; it pushed as it was told to go back, and was sent {-gone:.1f} mm the other way"
        return f"; it was told to go back by {gone:.1f} mm"

    def mind(self, stopped: NDArray[np.int8], way: NDArray[np.float64]) -> None:
        """Judge a leg that is over, and begin the next one; to be called in each tick.

        Parameters
        ----------
        stopped, way
            As in ``Gate``: how the surface retracts; where it was sent when all stopped, and how far down and up
            it may be sent [m], shape (3,).  Both are written.
        """
        if not self.active:
            self.active = True
            if stopped.item() == BACKWARDS:  # found to be the right way while its position was still believed
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
        """Tell whether an ``active`` retreat has legs to go; ``stopped`` as in ``mind``, shape (), dimensionless.

        A device whose wire has taken no command for ``PATIENCE`` is not waited for.
        """
        waited = 0 if self._reached is None else self._tick.item() - self._reached
        return stopped.item() != HELD and waited <= self._patience

    def drop(self, stopped: NDArray[np.int8], way: NDArray[np.float64]) -> None:
        """Let the surface retract as others do, because its position is believed again.

        ``stopped`` and ``way`` (3,) [m] as in ``mind``.
        """
        self.begin()
        stopped[...], way[1:] = 0, math.nan

    @property
    def _up(self) -> bool:
        """Whether the leg leads up: back to where it stood, or on the other way."""
        return self._phase in (RetreatPhase.BACK, RetreatPhase.OTHER)

    def _has_left(self) -> bool:
        """Tell whether a leg's last command has left, as far as the wire tells: a busy machine may send it late."""
        goal = self._gate.acquisition.departures.newest
        return goal is None or abs(goal - self._goal) <= _NEAR

    def _heard(self, tick: int) -> bool:
        """Tell whether all that is known of fingers was measured in a tick or later."""
        times = [
            one.tracker.acquisition.measured_at(Role.TRACKED_POSE) for one in self._fingers if self._knows(one.tracker)
        ]
        return bool(self._tick.item() >= tick) and all(time >= tick for time in times)

    def _knows(self, tracker: Gate) -> bool:
        """Tell whether a device's reading of a finger can be believed, and is recent."""
        age = self._tick.item() - tracker.acquisition.measured_at(Role.TRACKED_POSE)
        return tracker.latch.trip not in DOUBTS and age <= self._known

    def _look(self) -> Observation:
        heights = [one.height() if self._knows(one.tracker) else math.nan for one in self._fingers]
        loads = [math.hypot(*self._gate.reading[name][:3].tolist()) for name in self._loads]
        return Observation(tuple(heights), max(loads, default=math.nan))

    def _judge(
        self, middle: Observation, after: Observation, stopped: NDArray[np.int8], way: NDArray[np.float64]
    ) -> None:
        """Decide what comes after a leg, from the observations at its end and a while later."""
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
            if not any(_tells(heights) for heights in ways):  # it is back where it stood: neither way is better
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
        """Begin the next leg of the phase; hold the surface if there is no room for one."""
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
