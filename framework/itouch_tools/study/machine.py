"""One trial as a state machine: skin, approach, go, contact, judge, answer, pause; void if a touch breaks a rule.

``skin`` -> ``approach`` -> ``go`` -> ``contact`` -> ``judge``, once for each interval, then ``answer`` -> ``pause`` ->
``end``.  Its driver presents the next interval's scene when the machine is in ``skin`` again, judges a touch in
``judge``, and reports the answer in ``answer``.  A trial that broke a rule goes to ``pause`` without an answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from itouch.world.skin_source import is_back


class Phase(Enum):
    """The phase of a trial; the value is its name in data and tests."""

    SKIN = "skin"
    APPROACH = "approach"
    GO = "go"
    CONTACT = "contact"
    JUDGE = "judge"
    ANSWER = "answer"
    PAUSE = "pause"
    END = "end"


@dataclass(frozen=True, slots=True)
class Sensed:
    """What the machine is told at each tick.

    ``seconds`` of the servo's clock; ``skin`` [K] as measured, None if nothing measures it now; whether the plate is
    ``ready``; which ``object`` is touched, -1: none; and whether the scripted motion of a twin's hand is ``over``.
    """

    seconds: float
    skin: float | None = None
    ready: bool = True
    object: int = -1
    over: bool = False


@dataclass(frozen=True, slots=True)
class Rules:
    """What a trial waits for, in SI units; see ``<contact>`` and ``<blind>`` of the study language.

    ``equal``: the signal comes ``approach`` seconds after the skin has recovered, whatever the plate does; else as soon
    as the plate is ready, after ``approach`` seconds at the earliest.
    """

    object: int
    intervals: int = 1
    baseline: float | None = None
    skin_return: float = 0.5
    skin_wait: float = math.inf
    approach: float = 0.0
    equal: bool = True
    ready_wait: float = math.inf
    reach: float = math.inf
    answer_wait: float = math.inf
    pause: float = 0.0


@dataclass(slots=True)
class Machine:
    """A trial in progress.  ``void`` is why it does not count; empty: it does."""

    rules: Rules
    phase: Phase = Phase.SKIN
    interval: int = 0
    void: str = ""
    #: Time [s] of the servo's clock at which each phase last began.
    times: dict[Phase, float] = field(default_factory=dict)
    #: For each interval so far, whether the skin recovered in time; None where that is not known.
    back: list[bool | None] = field(default_factory=list)
    _now: float = math.nan

    def step(self, sensed: Sensed) -> Phase:
        """Take one tick, and return the phase after it."""
        self._now = sensed.seconds
        if not self.times:
            self.times[Phase.SKIN] = sensed.seconds
        {
            Phase.SKIN: self._skin, Phase.APPROACH: self._approach, Phase.GO: self._go, Phase.CONTACT: self._contact,
            Phase.ANSWER: self._answer, Phase.PAUSE: self._pause,
        }.get(self.phase, self._wait)(sensed)  # fmt: skip
        return self.phase

    def since(self, phase: Phase | None = None) -> float:
        """Return the seconds since a phase began; default: the present one."""
        return round(self._now - self.times.get(phase or self.phase, self._now), 9)  # so that ticks count exactly

    def judged(self, void: str) -> None:
        """Take the verdict on the touch that has ended ("": it counts); the next interval begins, or the question.

        Raises
        ------
        ValueError
            If no touch has just ended.
        """
        if self.phase is not Phase.JUDGE:
            raise ValueError(f"a touch is judged when it has ended, not in '{self.phase.value}'")
        self.void = self.void or void
        if self.void:
            self._enter(Phase.PAUSE)
        elif self.interval + 1 < self.rules.intervals:
            self.interval += 1
            self._enter(Phase.SKIN)
        else:
            self._enter(Phase.ANSWER)

    def answered(self) -> None:
        """Note that the answer was given in this tick.

        Raises
        ------
        ValueError
            If no answer is asked for.
        """
        if self.phase is not Phase.ANSWER:
            raise ValueError(f"an answer is taken when it is asked for, not in '{self.phase.value}'")
        self._enter(Phase.PAUSE)

    def fail(self, why: str) -> None:
        """Make the trial void because something failed."""
        self.void = self.void or why
        self._enter(Phase.PAUSE)

    def _enter(self, phase: Phase) -> None:
        self.phase = phase
        self.times[phase] = self._now

    def _wait(self, sensed: Sensed) -> None:
        """Do nothing: in this phase the driver acts."""

    def _skin(self, sensed: Sensed) -> None:
        rules, skin = self.rules, sensed.skin
        unknown = skin is None or rules.baseline is None or not math.isfinite(skin)
        back = unknown or is_back(skin or 0.0, rules.baseline or 0.0, rules.skin_return)
        if not back and self.since() < rules.skin_wait:
            return
        self.back.append(None if unknown else back)
        self._enter(Phase.APPROACH)

    def _approach(self, sensed: Sensed) -> None:
        rules = self.rules
        if sensed.object >= 0:
            self.fail("touched before the signal")
        elif self.since() >= rules.approach and (rules.equal or sensed.ready):
            self._enter(Phase.GO)
        elif self.since() >= rules.ready_wait:
            self.fail("the plate was not ready in time")

    def _go(self, sensed: Sensed) -> None:
        if sensed.object == self.rules.object:
            self._enter(Phase.CONTACT)
        elif sensed.object >= 0:
            self.fail("something else was touched")
        elif sensed.over or self.since() >= self.rules.reach:
            self.fail("nothing was touched")

    def _contact(self, sensed: Sensed) -> None:
        if sensed.object >= 0 and sensed.object != self.rules.object:
            self.void = self.void or "the material changed in contact"
            self._enter(Phase.JUDGE)
        elif sensed.object < 0 or sensed.over:
            self._enter(Phase.JUDGE)

    def _answer(self, sensed: Sensed) -> None:
        if self.since() >= self.rules.answer_wait:
            self.fail("no answer in time")

    def _pause(self, sensed: Sensed) -> None:
        if self.since() >= self.rules.pause:
            self._enter(Phase.END)
