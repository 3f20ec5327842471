"""Signal detection: d' from the proportion correct of forced-choice tasks, and back.

Noise is Gaussian, of equal variance.  *Which of m intervals is the coldest*: Hacker and Ratcliff (1979), Percept.
Psychophys. 26:168.  *Which of three intervals is the odd one* (the triangle method) is another task, and needs a larger
d' for the same proportion: Frijters (1980), Ennis (1993).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import stats

#: Nodes and weights of Gauss-Hermite quadrature for integrals against a standard normal density.
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(120)
_WEIGHTS = _WEIGHTS / math.sqrt(2.0 * math.pi)
#: Largest d' that is distinguished from certainty.
MOST = 10.0


def correct_of_alternatives(d_prime: float, alternatives: int) -> float:
    """Return the proportion correct of an ideal observer who picks the largest of ``alternatives`` cues.

    Parameters
    ----------
    d_prime
        Distance of the means in units of the noise of one interval.
    alternatives
        Number of intervals, 2 or more.

    Raises
    ------
    ValueError
        If there are fewer than two alternatives.
    """
    if alternatives < 2:
        raise ValueError(f"a choice needs at least 2 alternatives, not {alternatives}")
    if alternatives == 2:
        return float(stats.norm.cdf(d_prime / math.sqrt(2.0)))
    # integrate where the density of the signal is: x = node + d'
    return float(np.sum(_WEIGHTS * stats.norm.cdf(_NODES + d_prime) ** (alternatives - 1)))


def correct_of_oddity(d_prime: float) -> float:
    """Return the proportion correct of the triangle method: which of three is the odd one (Frijters 1980, eq. 2)."""
    z = np.linspace(0.0, 12.0, 4001)
    shift = d_prime * math.sqrt(2.0 / 3.0)
    root3 = math.sqrt(3.0)
    density = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    inside = stats.norm.cdf(-z * root3 + shift) + stats.norm.cdf(-z * root3 - shift)
    return float(2.0 * np.trapezoid(inside * density, z))


def d_prime_of_alternatives(correct: float, alternatives: int) -> float:
    """Return d' for a proportion correct among ``alternatives``; it is negative below chance, infinite at certainty."""
    return _inverse(lambda d: correct_of_alternatives(d, alternatives), correct, -MOST)


def d_prime_of_oddity(correct: float) -> float:
    """Return d' for a proportion correct in the triangle method; it is 0 at or below chance, infinite at certainty."""
    return _inverse(correct_of_oddity, correct, 0.0)


def d_prime_of_rates(hits: float, false_alarms: float) -> float:
    """Return d' of a yes-no task from the rates of hits and false alarms (infinite where one is 0 or 1)."""
    return _z(hits) - _z(false_alarms)


def criterion_of_rates(hits: float, false_alarms: float) -> float:
    """Return the criterion c of a yes-no task: 0 is unbiased, positive a bias towards *no*."""
    return -0.5 * (_z(hits) + _z(false_alarms))


def log_linear(count: int, total: int) -> float:
    """Return a rate that is never 0 or 1: (count + 0.5) / (total + 1), Hautus (1995)."""
    return (count + 0.5) / (total + 1.0)


def _z(rate: float) -> float:
    if not 0.0 <= rate <= 1.0:
        raise ValueError(f"a rate lies between 0 and 1, not at {rate!r}")
    return float(stats.norm.ppf(rate)) if 0.0 < rate < 1.0 else math.copysign(math.inf, rate - 0.5)


def _inverse(rising: Callable[[float], float], wanted: float, least: float) -> float:
    """Return the argument at which a rising function takes a value, by bisection to full precision."""
    if not 0.0 <= wanted <= 1.0:
        raise ValueError(f"a proportion lies between 0 and 1, not at {wanted!r}")
    if wanted >= 1.0:
        return math.inf
    low, high = least, MOST
    if wanted <= rising(low):
        return -math.inf if least < 0.0 and wanted == 0.0 else low
    if wanted >= rising(high):
        return math.inf
    for _ in range(80):
        middle = 0.5 * (low + high)
        if rising(middle) < wanted:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
