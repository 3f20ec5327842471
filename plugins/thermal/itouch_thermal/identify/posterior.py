"""The posterior distribution of all values, which may have several valleys or a curved one.

Along one coordinate, the epidermis's thickness, a thin and a thick one may both fit the data; given it, the others are
normal.  So the fit walks along it: at each node the others are fitted, and the probability of their distribution there
is the node's weight.  The mixture's quantiles are the intervals (the nested approximation of Rue, Martino and Chopin
2009).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from itouch_thermal.display.column import Array

#: Points between two nodes, and bisection steps for a quantile.
_FINE, _HALVINGS = 12, 60
_erf = np.vectorize(math.erf)


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """Normal distributions of all coordinates at points along one of them; shapes (p,), (p, n), (p, n).

    ``weight`` sums to 1; the width of the walked coordinate itself is the distance between points.
    """

    weight: Array
    middle: Array
    deviation: Array

    @classmethod
    def of(cls, along: int, places: Array, level: Array, middle: Array, deviation: Array) -> Mixture:
        """Build the mixture from a walk.

        Parameters
        ----------
        along
            The coordinate along which the walk goes.
        places, level
            Nodes, in ascending order, and the logarithm of the probability at each, shape (nodes,).
        middle, deviation
            Mean and standard deviation of all coordinates at the nodes, in their units, shape (nodes, n).
        """
        fine = np.concatenate(
            [np.linspace(a, b, _FINE, endpoint=False) for a, b in zip(places[:-1], places[1:], strict=True)]
            + [places[-1:]]
        )
        apart = np.gradient(fine)
        weight = np.exp(_bent(fine, places, level - level.max())) * apart
        rows = [
            np.stack([np.interp(fine, places, column) for column in table.T], axis=1) for table in (middle, deviation)
        ]
        rows[0][:, along], rows[1][:, along] = fine, 0.5 * apart
        return cls(np.asarray(weight / weight.sum()), rows[0], rows[1])

    def quantile(self, part: float) -> Array:
        """Return the quantile of each coordinate's distribution for a probability, shape (n,)."""
        low = (self.middle - 9.0 * self.deviation).min(axis=0)
        high = (self.middle + 9.0 * self.deviation).max(axis=0)
        for _ in range(_HALVINGS):
            half = 0.5 * (low + high)
            below = self.weight @ (0.5 * (1.0 + _erf((half - self.middle) / (math.sqrt(2.0) * self.deviation))))
            low, high = np.where(below < part, half, low), np.where(below < part, high, half)
            if float((high - low).max()) < 1e-4:
                break
        return np.asarray(0.5 * (low + high))


def _bent(fine: Array, places: Array, level: Array) -> Array:
    """Interpolate between nodes by cubics with the slopes of parabolas through three nodes."""
    slope = np.gradient(level, places)
    k = np.clip(np.searchsorted(places, fine, side="right") - 1, 0, len(places) - 2)
    wide = places[k + 1] - places[k]
    t = (fine - places[k]) / wide
    return np.asarray(
        (1.0 + 2.0 * t) * (1.0 - t) ** 2 * level[k] + t * (1.0 - t) ** 2 * wide * slope[k]
        + t * t * (3.0 - 2.0 * t) * level[k + 1] + t * t * (t - 1.0) * wide * slope[k + 1]
    )  # fmt: skip
