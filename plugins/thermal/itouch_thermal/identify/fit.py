"""The most probable values of a finger and a sample, their intervals, and which values the data do not determine.

Positive values are fitted as logarithms.  The prior is a normal distribution of each value (`ASSUMED`: what fingers and
sensors are like); the result minimises the sum of squares of data and prior.  The intervals are those of the posterior
along the epidermis's thickness, since a thin and a thick one may both fit the data (`posterior`).  A value whose
interval the data hardly narrow cannot be told from its prior.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from itouch_thermal.display.column import Array
from itouch_thermal.identify.forward import Forward, Known, Values, binned, inside
from itouch_thermal.identify.posterior import Mixture

#: The prior of each value: mean and standard deviation; of the logarithm if the third is True.
ASSUMED: dict[str, tuple[float, float, bool]] = {
    "resistance": (1.5e-3, 0.6, True),
    "exponent": (0.3, 0.2, False),
    "curve": (0.0, 0.05, False),
    "effusivity": (500.0, 1.5, True),
    "epidermis": (7e-4, 0.3, True),
    "core": (309.15, 1.0, False),
    "perfusion": (5000.0, 0.7, True),
    "lag": (0.05, 0.2, True),
    "gain": (1.0, 0.02, False),
    "late": (0.0, 5e-3, False),
    "offset": (0.0, 2.0, False),
}
UNITS = {
    "resistance": "m2*K/W", "exponent": "", "curve": "", "effusivity": "W*s^0.5/(m2*K)",
    "epidermis": "m", "core": "K",
    "perfusion": "W/(m3*K)", "lag": "s", "gain": "", "late": "s", "offset": "W/m2",
}  # fmt: skip
#: The data determine a value if they narrow its interval to less than this fraction.
TOLD = 0.7
#: Probability of an interval, and its half width if it is normal, in standard deviations.
HELD, HALF = 0.95, 1.959964
_STEPS, _MOVE = 100, 1e-3
#: Longest step towards the minimum, in any coordinate: a longer one may jump into another valley.
_LONGEST = 1.0
#: Other starts are tried if the sum of squares is so many standard deviations too large, or a value so far from its
#: prior.
_UNLIKELY, _FAR = 1.5, 2.8
#: Thicknesses of the epidermis along which to walk: relative to the prior, and to the minimum in its own deviations.
_WALKED, _NEAR = (-3.2, -2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4, 3.2), (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
#: By how much the sum of squares must be smaller for another valley to be taken.
_GAIN = 1e-2
#: Starts for resistance, epidermis and effusivity, in standard deviations of the prior.
_STARTS = (
    (0.0, 0.0, 1.5), (0.0, -1.5, 0.0), (0.0, 1.5, 1.5), (0.0, 1.5, 0.0), (1.5, -1.5, 1.5), (-1.5, 0.0, 0.0),
    (1.5, 0.0, 0.0), (0.0, 0.0, -1.5), (-1.5, 1.5, -1.5), (1.5, 1.5, 0.8),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Found:
    """A value with its interval, and the width of that relative to the prior's (1: the data say nothing)."""

    value: float
    low: float
    high: float
    narrowed: float

    @property
    def told(self) -> bool:
        """Whether the data determine it."""
        return self.narrowed < TOLD


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """All values, the point in the space of the fit with its covariance, and how well the data are fitted.

    ``misfit`` is the sum of squares of the data over their number: 1 if the noise is as stated.
    """

    found: dict[str, Found]
    values: Values
    point: Array
    covariance: Array
    misfit: float


class Problem:
    """Touches of one finger on one sample.

    Parameters
    ----------
    known
        Temperatures, film, forces; without a sample, its effusivity is estimated.
    times, readings
        Times [s], shape (n,), and the film's readings [W/m2] less its reading at rest, shape (touches, n).
    noise
        Rms noise of one sample [W/m2].
    edges
        Bounds of the bins over which samples are averaged [s].
    lag
        Calibrated time constant of the film [s], the mean of its prior; None: unknown.
    """

    def __init__(
        self, known: Known, times: Array, readings: Array, noise: float, edges: Array | None = None,
        lag: float | None = None,
    ) -> None:  # fmt: skip
        self.assumed = dict(ASSUMED) if lag is None else ASSUMED | {"lag": (lag, *ASSUMED["lag"][1:])}
        bounds = edges_for(times) if edges is None else edges
        points, self._mean = inside(bounds)
        self.forward = Forward(known, points)
        self.data, count = binned(times, readings, bounds)
        self.deviation = noise / np.sqrt(count)
        forces = np.array(known.forces)
        spread = float(np.log(forces).std()) if len(forces) else 0.0
        left_out = {"effusivity"} if known.sample is not None else set()
        several = len({round(float(np.log(force)) / 0.2) for force in forces})
        left_out |= {"exponent", "curve"} if spread < 0.05 else {"curve"} if several < 3 else set()
        self.names = tuple(name for name in self.assumed if name not in left_out)
        #: Force for which the resistance is stated [N]: without an exponent, the mean of those of the touches.
        self.force = 1.0 if "exponent" in self.names else float(np.exp(np.log(forces).mean()))

    def unit(self, name: str) -> str:
        """Return a value's unit, for the resistance with its force."""
        return f"{UNITS[name]} at {self.force:.3g} N" if name == "resistance" else UNITS[name]

    def values(self, point: Array) -> Values:
        """Return the values at a point of the space of the fit, whose coordinates are deviations from the prior's mean.

        ``point`` (n,) has one coordinate for each name, in standard deviations [1].
        """
        changed = {}
        for name, u in zip(self.names, point.tolist(), strict=True):
            middle, deviation, log = self.assumed[name]
            changed[name] = middle * math.exp(deviation * u) if log else middle + deviation * u
        return replace(Values(), **{name: 0.0 for name in ("exponent", "curve") if name not in changed} | changed)

    def point(self, values: Values) -> Array:
        """Return the point that corresponds to some values."""
        found = []
        for name in self.names:
            middle, deviation, log = self.assumed[name]
            value = getattr(values, name)
            found.append((math.log(value / middle) if log else value - middle) / deviation)
        return np.array(found)

    def residual(self, point: Array) -> Array:
        """Return the errors of the data, in standard deviations, shape (data,).

        ``point`` (n,) as in `values`, in standard deviations [1].
        """
        shown = self._mean(self.forward(self.values(point)))
        return np.asarray(((shown - self.data) / self.deviation).ravel())

    def slopes(self, point: Array, free: Sequence[int]) -> Array:
        """Return the derivatives of the residual with respect to the free coordinates, shape (data, free).

        ``point`` (n,) as in `values`, in standard deviations [1].
        """
        columns = []
        for k in free:
            step = np.zeros(len(point))
            step[k] = _MOVE
            columns.append((self.residual(point + step) - self.residual(point - step)) / (2.0 * _MOVE))
        return np.stack(columns, axis=1)

    def solve(self, start: Array | None = None, fixed: dict[int, float] | None = None) -> tuple[Array, float]:
        """Return the minimum and its cost, the squares of data and prior; some coordinates may be fixed.

        ``start`` and the point (n,) as in `values`, in standard deviations [1].
        """
        point = np.zeros(len(self.names)) if start is None else start.copy()
        for k, value in (fixed or {}).items():
            point[k] = value
        free = [k for k in range(len(point)) if k not in (fixed or {})]
        damping, cost, off = 1e-3, math.inf, self.residual(point)
        cost = float(off @ off + point @ point)
        for _ in range(_STEPS):
            slopes = self.slopes(point, free)
            bend = slopes.T @ slopes + np.eye(len(free))
            pull = slopes.T @ off + point[free]
            for _ in range(8):
                move = np.linalg.solve(bend + damping * np.diag(np.diag(bend)), pull)
                move *= _LONGEST / max(_LONGEST, float(np.abs(move).max()))
                trial = point.copy()
                trial[free] = np.clip(point[free] - move, -6.0, 6.0)
                there = self.residual(trial)
                after = float(there @ there + trial @ trial)
                if after <= cost:
                    break
                damping *= 10.0
            else:
                break
            gained, point, off, cost, damping = cost - after, trial, there, after, max(damping * 0.1, 1e-9)
            if gained < 1e-4:
                break
        return point, cost

    def bound(self, values: Values) -> dict[str, float]:
        """Return the least standard deviation of any estimate (Cramer-Rao), in units of the fit."""
        slopes = self.slopes(self.point(values), range(len(self.names)))
        covariance = np.linalg.inv(slopes.T @ slopes + np.eye(len(self.names)))
        return dict(zip(self.names, np.sqrt(np.diag(covariance)).tolist(), strict=True))

    def best(self) -> Array:
        """Return the lowest minimum from several starts: the sum of squares may have more than one valley."""
        start, cost = self.solve()
        count = self.data.size
        likely = count + _UNLIKELY * math.sqrt(2.0 * count)
        for places in _STARTS:
            if cost < likely and float(np.abs(start).max()) < _FAR:
                break
            near = np.zeros(len(start))
            for name, place in zip(("resistance", "epidermis", "effusivity"), places, strict=True):
                if name in self.names:
                    near[self.names.index(name)] = place
            point, less = self.solve(near)
            if less < cost:
                start, cost = point, less
        return start

    def fit(self) -> Fit:
        """Return the most probable values and their intervals."""
        point = self.best()
        mixture, better = self._mixture(point)
        if better is not point:
            point = better
            mixture, _ = self._mixture(point)
        slopes = self.slopes(point, range(len(point)))
        covariance: Array = np.asarray(np.linalg.inv(slopes.T @ slopes + np.eye(len(point))), dtype=np.float64)
        values, found = self.values(point), {}
        ends = mixture.quantile(0.5 - 0.5 * HELD), mixture.quantile(0.5 + 0.5 * HELD)
        for k, name in enumerate(self.names):
            middle, scale, log = self.assumed[name]
            places = [float(end[k]) for end in ends]
            low, high = (middle * math.exp(scale * end) if log else middle + scale * end for end in places)
            found[name] = Found(float(getattr(values, name)), low, high, (places[1] - places[0]) / (2.0 * HALF))
        off = self.residual(point)
        return Fit(found, values, point, covariance, float(off @ off) / len(off))

    def _mixture(self, point: Array) -> tuple[Mixture, Array]:
        """Return the posterior along the epidermis's thickness, and the minimum, or a better one met on the walk."""
        along = self.names.index("epidermis")
        free = [k for k in range(len(point)) if k != along]
        slopes = self.slopes(point, range(len(point)))
        wide = math.sqrt(float(np.linalg.inv(slopes.T @ slopes + np.eye(len(point)))[along, along]))
        near, middle = point[along] + wide * np.array(_NEAR), float(point[along])
        places = np.unique(np.concatenate((near, np.array(_WALKED))).round(6))
        apart = np.concatenate(([True], np.diff(places) > 0.5 * wide * min(np.diff(_NEAR))))
        places = places[apart & (np.abs(places) <= _WALKED[-1])]
        rows: dict[float, tuple[float, Array, Array]] = {}
        best, least = point, math.inf
        for way in (places[places >= middle], places[places < middle][::-1]):
            start = point
            for place in way.tolist():
                start, cost = self.solve(start, {along: place})
                bend = self.slopes(start, free)
                bend = bend.T @ bend + np.eye(len(free))
                deviation = np.zeros(len(point))
                deviation[free] = np.sqrt(np.diag(np.linalg.inv(bend)))
                rows[place] = -0.5 * (cost + float(np.linalg.slogdet(bend)[1])), start, deviation
                if cost < least:
                    best, least = start, cost
        best = self.solve(best)[0] if least < self._cost(point) - _GAIN else point
        nodes = np.array(sorted(rows))
        level, middles, deviations = (np.array([rows[place][k] for place in nodes.tolist()]) for k in range(3))
        return Mixture.of(along, nodes, level, middles, deviations), best

    def _cost(self, point: Array) -> float:
        """Return the sum of squares of data and prior."""
        off = self.residual(point)
        return float(off @ off + point @ point)

    def profile(
        self, name: str, fit: Fit, at: Sequence[float] = (-2.0, -1.0, 0.0, 1.0, 2.0)
    ) -> list[tuple[float, float]]:
        """Return a value's likelihood profile: pairs of the value and the increase of the data's sum of squares there.

        The others are fitted anew for each; if the profile is flat over the prior, the data do not determine the value.
        """
        k, rows = self.names.index(name), []
        best = math.inf
        for place in at:
            point, _ = self.solve(fit.point, {k: place})
            off = self.residual(point)
            rows.append((float(getattr(self.values(point), name)), float(off @ off)))
            best = min(best, rows[-1][1])
        return [(value, cost - best) for value, cost in rows]


def edges_for(times: Array, *, bins: int = 30, first: float = 0.05) -> Array:
    """Return edges of bins that grow with time and all contain samples, from ``first`` to the end.

    ``times`` (n,) [s] must be evenly spaced; the edges are (bins + 1,) or fewer [s].
    """
    period = float(times[1] - times[0])
    wanted = np.geomspace(max(first, float(times[0])), float(times[-1]) + period, bins + 1)
    # Edges lie half a period before samples, so that a bin's samples are spaced evenly about its middle.
    index = np.unique(np.searchsorted(times, wanted - 1e-9))
    index = index[index < len(times)]
    bounds = times[index] - 0.5 * period
    return np.append(bounds, times[-1] + 0.5 * period)
