"""Confidence intervals by resampling participants, because the answers of one person are not independent."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from itouch_tools.study.statistics.proportions import wilson

T = TypeVar("T")


def participant_interval(
    participants: Sequence[T], statistic: Callable[[Sequence[T]], float], *, seed: int, draws: int = 2000,
    level: float = 0.95,
) -> tuple[float, float]:  # fmt: skip
    """Return the bias-corrected and accelerated bootstrap interval of a statistic over participants (Efron 1987).

    Its quantiles are widened for small panels: Student's t for normal ones, and n - 1 for n (Hesterberg 2015, The
    American Statistician 69:371), without which the interval covers the truth in 91 to 92 % instead of 95 % with 16
    participants.

    Parameters
    ----------
    participants
        One entry for each participant: anything of which ``statistic`` takes a list.
    statistic
        Returns a number for a panel; draws for which it is NaN are left out.
    seed
        Seed of the resampling: equal seeds give equal intervals.
    draws
        Number of panels drawn with replacement.
    level
        Confidence level of the interval.

    Returns
    -------
    tuple of float
        The ends; NaN if there are fewer than two participants, or if the statistic is not defined.
    """
    count = len(participants)
    if count < 2:
        return math.nan, math.nan
    rng = np.random.default_rng(seed)
    picks = rng.integers(0, count, (draws, count))
    values = np.array([statistic([participants[i] for i in pick]) for pick in picks])
    values = values[np.isfinite(values)]
    seen = statistic(participants)
    if not len(values) or not math.isfinite(seen):
        return math.nan, math.nan
    left = np.array([statistic([*participants[:i], *participants[i + 1 :]]) for i in range(count)])
    low, high = _corrected_levels(values, seen, left, level)
    return float(np.quantile(values, low)), float(np.quantile(values, high))


def share_interval(
    counts: Sequence[tuple[int, int]], *, seed: int, draws: int = 2000, level: float = 0.95
) -> tuple[float, float]:
    """Return the interval of the participants' mean proportion, from the (successes, trials) of each.

    It is `participant_interval` of their proportions.  If these are all the same, resampling would give an interval of
    no width: 12 people who are right in 10 of 10 would have [1, 1], which never covers a truth of 99 %.  Then, and for
    a single participant, it is Wilson's interval of all answers.

    Parameters
    ----------
    counts
        Successes and trials of each participant; one without trials is left out.
    seed, draws, level
        As in `participant_interval`.

    Returns
    -------
    tuple of float
        The ends; NaN if there are no trials.
    """
    held = [(right, trials) for right, trials in counts if trials]
    if not held:
        return math.nan, math.nan
    shares = [right / trials for right, trials in held]
    if len(set(shares)) == 1:
        return wilson(sum(right for right, _ in held), sum(trials for _, trials in held), level=level)
    return participant_interval(shares, lambda some: sum(some) / len(some), seed=seed, draws=draws, level=level)


def _corrected_levels(
    values: NDArray[np.float64], seen: float, left: NDArray[np.float64], level: float
) -> tuple[float, float]:
    """Return the quantiles to take, from the bias of the draws and the skewness of the jackknife."""
    share = (np.sum(values < seen) + 0.5 * np.sum(values == seen)) / len(values)
    bias = float(stats.norm.ppf(min(max(share, 1e-6), 1 - 1e-6)))
    off = left.mean() - left
    spread = float((off**2).sum())
    speed = float((off**3).sum()) / (6.0 * spread**1.5) if spread > 0.0 and np.isfinite(spread) else 0.0
    ends = []
    count = len(left)
    reach = math.sqrt(count / (count - 1)) * float(stats.t.ppf(0.5 + level / 2.0, count - 1))
    for part in (-reach, reach):
        z = bias + part
        ends.append(float(stats.norm.cdf(bias + z / (1.0 - speed * z))))
    return ends[0], ends[1]
