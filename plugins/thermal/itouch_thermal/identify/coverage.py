"""How often the intervals of ``identify`` contain the truth: random fingers, touches with noise, Cramer-Rao bounds.

Each finger is drawn from the prior distribution of fingers, and touches a film on a sample with a few forces.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from contact_heat.layers import ROOM
from itouch_thermal.display.column import Array
from itouch_thermal.film.film_params import FilmParams
from itouch_thermal.identify.film_differences import readings
from itouch_thermal.identify.fit import TOLD, Problem
from itouch_thermal.identify.forward import Forward, Known
from itouch_thermal.rendering.materials import material

#: Temperature of the skin [K], rms noise of one sample [W/m2], forces [N], depth of a known sample [m].
SKIN, NOISE, FORCES, DEPTH = 306.15, 20.0, (0.5, 1.0, 2.0), 0.02
#: Times of the samples [s]: 4 s at 500 Hz.
TIMES: Array = np.arange(1, 2001, dtype=np.float64) * 2e-3
#: Range for the share of intervals that contain the truth, and confidence of the verdict (standard deviations).
LEAST, MOST, SURE = 0.93, 0.97, 1.96


@dataclass(frozen=True, slots=True)
class Row:
    """The results for one value over all fingers.

    ``error`` is the rms difference from the truth, and ``bound`` the least that it can be (Cramer-Rao with the prior,
    the rms over the same fingers), both in standard deviations of the prior; ``told`` is the share of fingers for which
    the data determine the value; ``median`` is the median of errors over their bounds, 0.674 if they are normal.
    """

    name: str
    fingers: int
    covered: int
    error: float
    bound: float
    told: float
    median: float = 0.0

    @property
    def coverage(self) -> float:
        """Share of the fingers whose interval contains the truth."""
        return self.covered / self.fingers

    @property
    def interval(self) -> tuple[float, float]:
        """Confidence interval of the true share, by Wilson's score."""
        n, p, z = self.fingers, self.coverage, SURE
        middle, half = p + z * z / (2 * n), z * math.sqrt(p * (1.0 - p) / n + z * z / (4.0 * n * n))
        return (middle - half) / (1.0 + z * z / n), (middle + half) / (1.0 + z * z / n)

    @property
    def holds(self) -> bool:
        """Whether the share is within the required range; with few fingers: whether it may be."""
        low, high = self.interval
        return LEAST <= self.coverage <= MOST or (low <= LEAST <= high or low <= MOST <= high)


def touched(sample: str) -> Known:
    """Return what is known of touches of a sample, named by its material; empty: unknown material."""
    layer = material(sample)[1].layer(DEPTH) if sample else None
    return Known(SKIN, ROOM, FilmParams().film, FORCES, DEPTH, layer)


def campaign(
    fingers: int, seed: int, sample: str = "", *, other: bool = False, each: Callable[[int], None] | None = None
) -> list[Row]:
    """Return coverage, error and bound of every value over random fingers.

    Parameters
    ----------
    fingers, seed
        Number of fingers, and seed of all random numbers.
    sample
        The material that is touched; empty: unknown, so that its effusivity is estimated.
    other
        Whether the data are from finite differences with Laplace noise, instead of the closed form with normal noise.
    each
        Called with the number of fingers done.
    """
    rng, of = np.random.default_rng(seed), touched(sample)
    names = Problem(of, TIMES, np.zeros((len(FORCES), len(TIMES))), NOISE)
    exact, shape = Forward(of, TIMES), (len(FORCES), len(TIMES))
    held: list[list[float]] = []
    off: list[list[float]] = []
    least: list[list[float]] = []
    told: list[list[float]] = []
    for done in range(1, fingers + 1):
        place = rng.normal(size=len(names.names))
        truth = names.values(place)
        noise = rng.laplace(size=shape) / math.sqrt(2.0) if other else rng.normal(size=shape)
        shown = readings(of, truth, TIMES) if other else exact(truth)
        problem = Problem(of, TIMES, shown + NOISE * noise, NOISE)
        fit, bound = problem.fit(), problem.bound(truth)
        found = [fit.found[name] for name in problem.names]
        true = [getattr(truth, name) for name in problem.names]
        held.append([float(one.low <= value <= one.high) for one, value in zip(found, true, strict=True)])
        off.append(((fit.point - place) ** 2).tolist())
        least.append([bound[name] ** 2 for name in problem.names])
        told.append([float(one.narrowed < TOLD) for one in found])
        if each is not None:
            each(done)
    covered, error, bounds, part = (np.array(rows).mean(axis=0) for rows in (held, off, least, told))
    medians = np.median(np.sqrt(np.array(off) / np.array(least)), axis=0)
    return [
        Row(name, fingers, round(float(covered[k]) * fingers), math.sqrt(error[k]), math.sqrt(bounds[k]),
            float(part[k]), float(medians[k]))
        for k, name in enumerate(names.names)
    ]  # fmt: skip
