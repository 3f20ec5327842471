"""Sample points: independent, Latin hypercubes, or a Sobol sequence; more can be drawn later without changing them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from itouch_tools.study.study_elements import split_levels
from itouch_tools.sweeps.sweep_elements import Draws, Over

#: Points that are made at once.
CHUNK = 1 << 14
#: Bits of a Sobol sequence, for 2^30 points; with more than 32 bits it cannot be entered in the middle.
BITS = 30
#: Significant digits of a drawn value, in the scene and in the results.
DIGITS = 12


class Points:
    """The points of one ``<draws>``, made in chunks, so that any point can be had without keeping those before it."""

    def __init__(self, draws: Draws, seed: int) -> None:
        self._draws, self._seed = draws, seed
        self._chunk: tuple[int, NDArray[np.float64]] = (-1, np.empty((0, 0)))

    def __len__(self) -> int:
        return self._draws.count

    def point(self, index: int) -> list[float | str]:
        """Return the values of the parameters at one point: numbers in their unit, or words."""
        size = self._size()
        number, within = divmod(index, size)
        if self._chunk[0] != number:
            self._chunk = (number, self._made(number, size))
        row = self._chunk[1][within]
        return [value_of(one, float(u)) for one, u in zip(self._draws.over, row, strict=True)]

    def _size(self) -> int:
        if self._draws.kind == "latin":
            return self._draws.block or self._draws.count
        return CHUNK

    def _made(self, number: int, size: int) -> NDArray[np.float64]:
        """Return a chunk of the unit cube, shape (size, parameters)."""
        from scipy.stats import qmc

        dimension = len(self._draws.over)
        if self._draws.kind == "random":
            return np.random.default_rng([self._seed, number]).random((size, dimension))
        if self._draws.kind == "latin":
            return np.asarray(
                qmc.LatinHypercube(dimension, rng=np.random.default_rng([self._seed, number])).random(size)
            )
        sobol = qmc.Sobol(dimension, bits=BITS, rng=np.random.default_rng(self._seed))
        if number:
            sobol.fast_forward(number * size)
        return np.asarray(sobol.random(size))


def value_of(over: Over, u: float) -> float | str:
    """Return the value of a parameter's distribution at the quantile ``u`` in [0, 1)."""
    if over.values:
        words = split_levels(over.values)
        return words[min(int(u * len(words)), len(words) - 1)]
    if over.mean is not None and over.deviation is not None:
        return rounded(_normal(over, u))
    if over.low is None or over.high is None:
        raise ValueError(f"'{over.name}' has no distribution")
    return rounded(_spaced(over.low, over.high, u, over.scale))


def _normal(over: Over, u: float) -> float:
    from scipy.stats import norm

    mean, deviation = float(over.mean or 0.0), float(over.deviation or 1.0)
    below = 0.0 if over.low is None else float(norm.cdf(over.low, mean, deviation))
    above = 1.0 if over.high is None else float(norm.cdf(over.high, mean, deviation))
    tiny = 2.0**-53
    return float(norm.ppf(min(max(below + u * (above - below), tiny), 1.0 - tiny), mean, deviation))


def _spaced(low: float, high: float, u: float, scale: str) -> float:
    return low * (high / low) ** u if scale == "log" else low + (high - low) * u


def spaced(low: float, high: float, steps: int, scale: str) -> Sequence[float]:
    """Return evenly spaced levels from low to high, linearly or on a log scale."""
    return [rounded(_spaced(low, high, index / (steps - 1), scale)) for index in range(steps)]


def rounded(value: float) -> float:
    """Return a number as it is written into the scene."""
    return float(f"{value:.{DIGITS}g}")
