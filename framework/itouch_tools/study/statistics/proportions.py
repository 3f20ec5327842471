"""Proportions: intervals, exact tests, equivalence, and corrections for many tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, stats


def _checked(successes: float, trials: float) -> None:
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} of {trials} is not a proportion")


def wilson(successes: int, trials: int, *, level: float = 0.95) -> tuple[float, float]:
    """Return Wilson's interval of a proportion; (0, 1) where there are no trials."""
    _checked(successes, trials)
    if not trials:
        return 0.0, 1.0
    z = float(stats.norm.ppf(0.5 + level / 2.0))
    share, spread = successes / trials, z * z / trials
    middle = (share + spread / 2.0) / (1.0 + spread)
    half = z / (1.0 + spread) * math.sqrt(share * (1.0 - share) / trials + spread / (4.0 * trials))
    return max(0.0, middle - half), min(1.0, middle + half)


def binomial_tail(successes: int, trials: int, chance: float) -> float:
    """Return the probability of at least this many successes: the p of the one-sided exact test against ``chance``."""
    _checked(successes, trials)
    return float(stats.binom.sf(successes - 1, trials, chance))


def mcnemar(only_first: int, only_second: int) -> float:
    """Return the exact two-sided p of McNemar's test, from the numbers of pairs in which only one of two was right."""
    total = only_first + only_second
    return min(1.0, 2.0 * binomial_tail(max(only_first, only_second), total, 0.5)) if total else 1.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """A test statistic, its degrees of freedom and its p value."""

    statistic: float
    freedom: int
    p: float


def cochran_q(answers: ArrayLike) -> Outcome:
    """Test with Cochran's Q whether the conditions are equally often right.

    Parameters
    ----------
    answers
        Shape (participants, conditions), 1 for right and 0 for wrong.
    """
    table = np.asarray(answers, float)
    if table.ndim != 2 or not np.isin(table, (0.0, 1.0)).all():
        raise ValueError("Cochran's Q needs a table of 0 and 1, a row for each participant")
    columns, rows = table.sum(axis=0), table.sum(axis=1)
    count = table.shape[1]
    spread = float((rows * (count - rows)).sum())
    if count < 2 or spread == 0.0:
        return Outcome(0.0, max(count - 1, 0), 1.0)  # everybody was right, or wrong, everywhere
    q = (count - 1) * float(((columns - columns.mean()) ** 2).sum()) * count / spread
    return Outcome(q, count - 1, float(stats.chi2.sf(q, count - 1)))


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Two one-sided tests: the ``difference`` of two proportions, its 1 - 2 alpha interval, and the larger p."""

    difference: float
    low: float
    high: float
    z: tuple[float, float]
    p: float


def tost(
    first: int, first_trials: int, second: int, second_trials: int, *, margin: float, alpha: float = 0.05,
    method: Literal["wald", "score"] = "wald",
) -> Equivalence:  # fmt: skip
    """Test that two proportions differ by less than ``margin`` (Schuirmann 1987).

    Parameters
    ----------
    first, first_trials, second, second_trials
        Successes and trials; all trials are taken as independent, see `clustered_tost` for several from each person.
    margin
        Smallest difference of proportions that would matter, more than 0.
    alpha
        Level of each of the two tests, which sets the interval.
    method
        ``"wald"`` takes the standard error of the observed proportions, ``"score"`` that at the border of the
        hypothesis (Miettinen and Nurminen 1985), which is valid for proportions near 0 and 1, too.
    """
    _checked(first, first_trials)
    _checked(second, second_trials)
    _margin(margin)
    if not first_trials or not second_trials:
        return Equivalence(math.nan, -1.0, 1.0, (math.nan, math.nan), 1.0)
    p1, p2 = first / first_trials, second / second_trials
    difference = p1 - p2
    wald = math.sqrt(p1 * (1 - p1) / first_trials + p2 * (1 - p2) / second_trials)
    errors = (wald, wald) if method == "wald" else tuple(
        _restricted_error(first, first_trials, second, second_trials, border) for border in (-margin, margin)
    )  # fmt: skip
    return _two_one_sided(difference, (errors[0], errors[1]), wald, margin, alpha, stats.norm)


def _margin(margin: float) -> None:
    if not margin > 0.0:
        raise ValueError(f"margin = {margin!r} must be more than 0")


def _two_one_sided(
    difference: float, errors: tuple[float, float], shown: float, margin: float, alpha: float, distribution: Any
) -> Equivalence:
    """Return both tests; ``distribution`` is that of difference / error, ``shown`` the error for the interval."""
    statistics = tuple(
        (difference + side) / error if error else math.copysign(math.inf, difference + side)
        for side, error in zip((margin, -margin), errors, strict=True)
    )
    quantile = float(distribution.ppf(1.0 - alpha))
    p = max(float(distribution.sf(statistics[0])), float(distribution.cdf(statistics[1])))
    low, high = difference - quantile * shown, difference + quantile * shown
    return Equivalence(difference, low, high, (statistics[0], statistics[1]), p)


def clustered_tost(first: ArrayLike, second: ArrayLike, *, margin: float, alpha: float = 0.05) -> Equivalence:
    """Test that two proportions differ by less than ``margin`` when each participant gave many answers.

    The participants' own differences are the sample, so answers of one person need not be independent.  It is the
    paired t test of equivalence, with participants - 1 degrees of freedom.

    Parameters
    ----------
    first, second
        Proportion of each participant in the two conditions, 0 to 1, shape (participants,); a NaN leaves a participant
        out.
    margin
        Smallest difference of proportions that would matter, more than 0.
    """
    _margin(margin)
    differences = np.asarray(first, float) - np.asarray(second, float)
    differences = differences[np.isfinite(differences)]
    count = len(differences)
    if count < 2:
        middle = float(differences.mean()) if count else math.nan
        return Equivalence(middle, -1.0, 1.0, (math.nan, math.nan), 1.0)
    error = float(differences.std(ddof=1)) / math.sqrt(count)
    distribution = stats.t(count - 1)
    return _two_one_sided(float(differences.mean()), (error, error), error, margin, alpha, distribution)


def _restricted_error(first: float, n1: float, second: float, n2: float, border: float) -> float:
    """Return the standard error of p1 - p2 with both fitted under p1 - p2 = border (Miettinen and Nurminen 1985)."""

    def slope(p1: float) -> float:  # of the log-likelihood, which is concave
        p2 = p1 - border
        return first / p1 - (n1 - first) / (1.0 - p1) + second / p2 - (n2 - second) / (1.0 - p2)

    low, high = max(0.0, border), min(1.0, 1.0 + border)
    inset = 1e-12
    low, high = low + inset, high - inset
    if slope(low) <= 0.0:
        p1 = low
    elif slope(high) >= 0.0:
        p1 = high
    else:
        p1 = float(optimize.brentq(slope, low, high, xtol=1e-15))
    p2 = p1 - border
    total = n1 + n2
    return math.sqrt((p1 * (1.0 - p1) / n1 + p2 * (1.0 - p2) / n2) * total / (total - 1.0))


def holm(p_values: Sequence[float]) -> NDArray[np.float64]:
    """Return Holm's adjusted p values, in the order given."""
    p = np.asarray(p_values, float)
    order = np.argsort(p, kind="stable")
    adjusted = np.empty_like(p)
    running = 0.0
    for rank, index in enumerate(order):
        running = max(running, min(1.0, float(p[index]) * (len(p) - rank)))
        adjusted[index] = running
    return adjusted
