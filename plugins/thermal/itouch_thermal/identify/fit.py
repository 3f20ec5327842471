"""The most probable values of a finger and a sample, their intervals, and which cannot be told from the data.

Values are logarithms where they are positive.  What is assumed beforehand is a normal distribution of each (`ASSUMED`:
what fingers and sensors are like); the result is the least of the sum of squares of data and assumptions.  Its interval
is what is probable along the epidermis' thickness, of which thin and thick may both meet the data (`posterior`).
A value whose interval the data hardly narrow cannot be told apart from others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from itouch_thermal.display.column import Array
from itouch_thermal.identify.forward import Forward, Known, Values, binned, inside
from itouch_thermal.identify.posterior import Mixture

#: Middle and standard deviation of each value beforehand; of the logarithm where the third is True.
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
#: A value is told apart if the data narrow its interval to this part.
TOLD = 0.7
#: What an interval holds, and its half width where it is normal, in standard deviations.
HELD, HALF = 0.95, 1.959964
_STEPS, _MOVE = 100, 1e-3
#: Longest step towards the least point, in any coordinate: a longer one leaps over valleys into false ones.
_LONGEST = 1.0
#: A sum of squares so many standard deviations too large, or a value so far from what is assumed, is tried again.
_UNLIKELY, _FAR = 1.5, 2.8
#: Where the epidermis' thickness is walked along: from what is assumed, and from the point in its own deviations.
_WALKED, _NEAR = (-3.2, -2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4, 3.2), (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
#: By how much the sum of squares must be less in another valley.
_GAIN = 1e-2
#: Starts for resistance, epidermis and effusivity, in standard deviations of what is assumed.
_STARTS = (
    (0.0, 0.0, 1.5), (0.0, -1.5, 0.0), (0.0, 1.5, 1.5), (0.0, 1.5, 0.0), (1.5, -1.5, 1.5), (-1.5, 0.0, 0.0),
    (1.5, 0.0, 0.0), (0.0, 0.0, -1.5), (-1.5, 1.5, -1.5), (1.5, 1.5, 0.8),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Found:
    """A value with its interval, and by how much the data have narrowed it (1: not at all)."""

    value: float
    low: float
    high: float
    narrowed: float

    @property
    def told(self) -> bool:
        """Whether the data tell it."""
        return self.narrowed < TOLD


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """All values, the point in the space of the fit with its covariance, and how well the data are met.

    ``misfit`` is the sum of squares of the data over the number of data: 1 where the noise is as stated.
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
        Temperatures, film, forces; without a sample its effusivity is looked for.
    times, readings
        Times [s], shape (n,), and what the film read [W/m2] without its reading at rest, shape (touches, n).
    noise
        Rms of one sample [W/m2].
    edges
        Bounds of the bins over which samples are averaged [s].
    lag
        Time constant of the film by its calibration [s], the middle of what is assumed of it; None: not known.
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
        #: Force at which the resistance is told [N]: without an exponent the mean of those at which it was found.
        self.force = 1.0 if "exponent" in self.names else float(np.exp(np.log(forces).mean()))

    def unit(self, name: str) -> str:
        """Return a value's unit, for the resistance with its force."""
        return f"{UNITS[name]} at {self.force:.3g} N" if name == "resistance" else UNITS[name]

    def values(self, point: Array) -> Values:
        """Return the values at a point of the space of the fit, which counts deviations from what is assumed.

        ``point`` (n,), one coordinate for each name, in standard deviations [1].
        """
        changed = {}
        for name, u in zip(self.names, point.tolist(), strict=True):
            middle, deviation, log = self.assumed[name]
            changed[name] = middle * math.exp(deviation * u) if log else middle + deviation * u
        return replace(Values(), **{name: 0.0 for name in ("exponent", "curve") if name not in changed} | changed)

    def point(self, values: Values) -> Array:
        """Return the point of values."""
        found = []
        for name in self.names:
            middle, deviation, log = self.assumed[name]
            value = getattr(values, name)
            found.append((math.log(value / middle) if log else value - middle) / deviation)
        return np.array(found)

    def residual(self, point: Array) -> Array:
        """Return what the data are off, in standard deviations, shape (data,).

        ``point`` (n,) as in `values`, in standard deviations [1].
        """
        shown = self._mean(self.forward(self.values(point)))
        return np.asarray(((shown - self.data) / self.deviation).ravel())

    def slopes(self, point: Array, free: Sequence[int]) -> Array:
        """Return the change of the residual with each free coordinate, shape (data, free).

        ``point`` (n,) as in `values`, in standard deviations [1].
        """
        columns = []
        for k in free:
            step = np.zeros(len(point))
            step[k] = _MOVE
            columns.append((self.residual(point + step) - self.residual(point - step)) / (2.0 * _MOVE))
        return np.stack(columns, axis=1)

    def solve(self, start: Array | None = None, fixed: dict[int, float] | None = None) -> tuple[Array, float]:
        """Return the least point and its cost: squares of data and assumptions; some coordinates may be fixed.

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
        """Return the least standard deviation that any estimate can have (Cramer-Rao), in units of the fit."""
        slopes = self.slopes(self.point(values), range(len(self.names)))
        covariance = np.linalg.inv(slopes.T @ slopes + np.eye(len(self.names)))
        return dict(zip(self.names, np.sqrt(np.diag(covariance)).tolist(), strict=True))

    def best(self) -> Array:
        """Return the least point of several starts: the sum of squares may have more than one valley."""
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
        """Return what is probable along the epidermis' thickness, and the point, or a better one if one is met."""
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
        """Return the sum of squares of data and assumptions."""
        off = self.residual(point)
        return float(off @ off + point @ point)

    def profile(
        self, name: str, fit: Fit, at: Sequence[float] = (-2.0, -1.0, 0.0, 1.0, 2.0)
    ) -> list[tuple[float, float]]:
        """Return the likelihood's profile of a value: the value, and by how much the data alone are worse off there.

        The others are fitted anew at each; where the profile is flat over what is assumed, the data do not tell it.
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
    """Return bounds of bins that grow with the time and hold samples, from 0.05 s to the end.

    ``times`` (n,) [s], evenly spaced; the bounds (bins + 1,) or fewer [s].
    """
    period = float(times[1] - times[0])
    wanted = np.geomspace(max(first, float(times[0])), float(times[-1]) + period, bins + 1)
    # Bounds lie half a period before samples, so that a bin's samples are evenly around its middle.
    index = np.unique(np.searchsorted(times, wanted - 1e-9))
    index = index[index < len(times)]
    bounds = times[index] - 0.5 * period
    return np.append(bounds, times[-1] + 0.5 * period)
