"""Adaptive procedures: weighted up-down, QUEST and psi-marginal by SweetSpot, restored from their rows at any time.

The library proceeds deterministically from what it was told, so the state of a staircase is its list of (level, answer)
and nothing else: that is what a study keeps, and what a crash cannot lose.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from itouch.schema import ItouchError

Procedure = Literal["up-down", "quest", "psi"]


class MissingLibraryError(ItouchError):
    """A library that a study needs is not installed; the message says how to get it."""


def _library() -> Any:
    try:
        import SweetSpot
    except ImportError as error:
        raise MissingLibraryError(
            "adaptive procedures need SweetSpot, and that is not installed: pip install 'itouch-py[study]'"
        ) from error
    return SweetSpot


@dataclass(frozen=True, slots=True)
class Staircase:
    """The parameters of one adaptive procedure.

    Attributes
    ----------
    procedure
        ``"up-down"``: Kaernbach's weighted up-down; ``"quest"``: Watson and Pelli's; ``"psi"``: Prins' psi-marginal.
    low, high
        Range of levels that may be shown.
    start
        First level of the up-down procedure, and middle of the prior of the others.
    step
        Step down of the up-down procedure after a right answer, more than 0; and the quantum to which the levels of
        QUEST are rounded, 0: none.
    target
        Proportion right at which the up-down procedure converges; the others find the middle of the function.
    guess, lapse
        Guess rate and lapse rate of the psychometric function.
    slope
        Slope of the logistic function that QUEST assumes [1 / unit of the level].
    prior
        Standard deviation of the prior of the threshold [unit of the level].
    trials, reversals
        The procedure ends after ``trials`` trials, the up-down procedure also after ``reversals`` reversals.
    """

    procedure: Procedure
    low: float
    high: float
    start: float
    step: float = 0.0
    target: float = 0.75
    guess: float = 0.5
    lapse: float = 0.02
    slope: float = 3.0
    prior: float = 1.0
    trials: int = 40
    reversals: int = 12

    @property
    def found(self) -> float:
        """Proportion right at the threshold: the up-down procedure's target, else that at the function's middle."""
        return self.target if self.procedure == "up-down" else self.guess + 0.5 * (1.0 - self.guess - self.lapse)

    def __post_init__(self) -> None:
        if not self.low < self.high or not self.low <= self.start <= self.high:
            raise ValueError(f"levels go from {self.low:g} to {self.high:g}, the start {self.start:g} among them")
        if self.procedure == "up-down" and not self.step > 0.0:
            raise ValueError("an up-down procedure needs a step of more than 0")
        if not self.guess < self.target < 1.0 - self.lapse:
            raise ValueError(f"target = {self.target:g} must lie between {self.guess:g} and {1.0 - self.lapse:g}")
        if self.trials < 1 or self.reversals < 1:
            raise ValueError("a procedure has at least one trial and one reversal")


def _grid(rule: Staircase, count: int) -> tuple[float, float, int]:
    return rule.low, rule.high, count


def _made(rule: Staircase) -> Any:
    library = _library()
    if rule.procedure == "up-down":
        # a miss must outweigh a hit by target / (1 - target): Kaernbach 1991
        made = library.WUD(
            start=rule.start, hitEffect=-rule.step, target=rule.target, reversals=rule.reversals,
            reversalsToUse=max(2, rule.reversals - 2) if rule.reversals > 2 else rule.reversals,
        )  # fmt: skip
        made.min, made.max = rule.low, rule.high
        return made
    if rule.procedure == "quest":
        return library.QUEST(
            beta=math.log(rule.slope / 4.0), gamma=rule.guess, lambda_=rule.lapse, shape=library.Logistic(0.5),
            alphaGrid=_grid(rule, 121), alphaPrior=(rule.start, rule.prior), maxIterations=rule.trials,
        )  # fmt: skip
    function = library.PsychometricFunction(shape=library.Logistic(0.5), gamma=rule.guess)
    function.Grid(alpha=_grid(rule, 61), beta=(-2, 2, 11), lambda_=(0.0, 0.1, 3))
    function.SetPrior(alpha=(rule.start, rule.prior), beta=(0.0, 1.0))
    return library.PsiMarginal(function, xCandidates=np.linspace(rule.low, rule.high, 31), maxIterations=rule.trials)


@dataclass(frozen=True, slots=True)
class Running:
    """A staircase in progress.  ``rows`` are its pairs (level, answer), from which it can be restored."""

    rule: Staircase
    rows: list[tuple[float, int]] = field(default_factory=list)
    _made: Any = None

    @classmethod
    def begin(cls, rule: Staircase, rows: Iterable[tuple[float, int]] = ()) -> Running:
        """Begin a staircase, or go on after the rows of an earlier one.

        Raises
        ------
        MissingLibraryError
            If SweetSpot is not installed.
        ValueError
            If a row holds something that is no level or answer.
        """
        running = cls(rule, [], _made(rule))
        for level, answer in rows:
            running._take(level, answer)
        return running

    @property
    def finished(self) -> bool:
        """Whether the procedure asks for no more trials."""
        return bool(self._made.Finished()) or len(self.rows) >= self.rule.trials

    def level(self) -> float:
        """Return the level to show next, within the range and rounded to the quantum."""
        value = min(max(float(self._made.PendingValue()), self.rule.low), self.rule.high)
        if self.rule.procedure == "quest" and self.rule.step > 0.0:
            value = self.rule.low + round((value - self.rule.low) / self.rule.step) * self.rule.step
            value = min(value, self.rule.high)
        return value

    def answer(self, right: bool) -> None:
        """Take the answer to the level that was asked for.

        Raises
        ------
        ValueError
            If the procedure has ended.
        """
        if self.finished:
            raise ValueError("the staircase has ended; it takes no more answers")
        self._take(self.level(), int(right))

    def _take(self, level: float, answer: int) -> None:
        if answer not in (0, 1) or not math.isfinite(level):
            raise ValueError(f"a staircase takes a level and 0 or 1, not {level!r} and {answer!r}")
        self._made.Observe(answer, x=level)
        self.rows.append((level, answer))

    def estimate(self) -> float:
        """Return the threshold found so far; NaN if there is none yet.

        For an up-down procedure whose trials ran out before its reversals it is the median of the reversals that there
        were, without the first two, and with as many upper ones as lower ones.
        """
        if self.rule.procedure != "up-down" or self._made.Finished():
            return float(self._made.Estimate())
        turns = [float(self._made.Observation(index)[0]) for index in self._made.Reversals()][2:]
        turns = turns[len(turns) % 2 :]
        return float(np.median(turns)) if self.finished and turns else math.nan
