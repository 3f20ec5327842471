"""The structure of a claim: a quoted place, our set-up, computed numbers, and a verdict that follows from bounds."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from itouch_thermal.paper.work import Work

HOLDS, PARTLY, FAILS, UNKNOWN = "holds", "holds partly", "does not hold", "cannot be checked here"
VERDICTS = (HOLDS, PARTLY, FAILS, UNKNOWN)


class Check(NamedTuple):
    """A number that must lie within bounds for the claim to hold."""

    what: str
    value: float
    low: float = float("-inf")
    high: float = float("inf")
    unit: str = ""

    @property
    def met(self) -> bool:
        """Whether it does; NaN does not."""
        return self.low <= self.value <= self.high

    @property
    def measured(self) -> str:
        """The number in words."""
        return f"{self.what} {self.value:.3g}{self.unit}"

    @property
    def bound(self) -> str:
        """The bound in words, the same for all checks of one kind."""
        if self.low == float("-inf"):
            return f"≤ {self.high:g}{self.unit}"
        if self.high == float("inf"):
            return f"≥ {self.low:g}{self.unit}"
        return f"{self.low:.3g} to {self.high:.3g}{self.unit}"


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper: its place, its words, the set-up in which it is checked, and the numbers that decide."""

    place: str
    words: str
    setup: str
    checks: tuple[Check, ...]
    note: str = ""

    @property
    def verdict(self) -> str:
        """The verdict: all numbers are within their bounds, some are, none is, or there are no numbers."""
        if not self.checks:
            return UNKNOWN
        met = sum(check.met for check in self.checks)
        return HOLDS if met == len(self.checks) else PARTLY if met else FAILS

    def row(self) -> str:
        """Return the claim's row of the table."""
        measured = "; ".join(check.measured for check in self.checks)
        said = "; ".join(part for part in (measured, self.note) if part)
        bounds: list[str] = []
        for check in self.checks:
            if check.bound not in bounds:
                bounds.append(check.bound)
        return f"| {self.place} | {self.words} | {self.setup} | {said} | {'; '.join(bounds) or '-'} | {self.verdict} |"


#: A function that makes a claim.
Maker = Callable[[Work], Claim]


def over(names: Iterable[str], value: Callable[[str], float], low: float, high: float, unit: str) -> tuple[Check, ...]:
    """Return a check for each name."""
    return tuple(Check(name, value(name), low, high, unit) for name in names)
