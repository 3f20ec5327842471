"""Psychometric functions: psi(x) = guess + (1 - guess - lapse) F((x - threshold) / spread), with intervals.

They are fitted by maximum likelihood from the best point of a grid; the beta-binomial model of Schuett et al. (2016),
Vision Res. 122:105, describes the overdispersion of real observers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, special, stats

Array = NDArray[np.float64]
Shape = Literal["normal", "logistic", "weibull"]

_SHAPES: dict[str, tuple[Callable[[Array], Array], Callable[[float], float]]] = {
    "normal": (special.ndtr, lambda p: float(special.ndtri(p))),
    "logistic": (special.expit, lambda p: math.log(p / (1.0 - p))),
    # of log x: the cumulative Gumbel function
    "weibull": (lambda z: -np.expm1(-np.exp(np.clip(z, -700.0, 700.0))), lambda p: math.log(-math.log1p(-p))),
}


@dataclass(frozen=True, slots=True)
class Psychometric:
    """A fitted psychometric function.

    ``threshold`` and ``spread`` are in the unit of the stimulus (for ``"weibull"`` of its natural logarithm); ``loss``
    is the negative log-likelihood without binomial coefficients, ``deviance`` that against the saturated model.
    ``bounded`` means that the fit ended at a bound of its search (the data are a step, or have no slope): its numbers
    mean nothing then.
    """

    threshold: float
    spread: float
    guess: float
    lapse: float
    shape: Shape
    loss: float
    deviance: float
    bounded: bool

    def __call__(self, level: ArrayLike) -> Array:
        """Return the probability of a right answer at these levels, elementwise."""
        return _psi(np.asarray(level, float), self.threshold, self.spread, self.guess, self.lapse, self.shape)

    def level(self, probability: float) -> float:
        """Return the level at which the function takes this probability.

        Raises
        ------
        ValueError
            If the function never takes it.
        """
        share = (probability - self.guess) / (1.0 - self.guess - self.lapse)
        if not 0.0 < share < 1.0:
            raise ValueError(f"the function goes from {self.guess:g} to {1 - self.lapse:g}, never to {probability:g}")
        value = self.threshold + self.spread * _SHAPES[self.shape][1](share)
        return math.exp(value) if self.shape == "weibull" else value


def _psi(x: Array, threshold: float | Array, spread: float | Array, guess: float, lapse: float, shape: Shape) -> Array:
    if shape == "weibull":
        with np.errstate(divide="ignore"):
            x = np.log(x)
    return np.asarray(guess + (1.0 - guess - lapse) * _SHAPES[shape][0]((x - threshold) / spread))


def _losses(p: Array, right: Array, wrong: Array) -> Array:
    """Return the negative log-likelihoods, over the last axis."""
    p = np.clip(p, 1e-12, 1.0 - 1e-12)
    return np.asarray(-(right * np.log(p) + wrong * np.log1p(-p)).sum(axis=-1))


def _loss(p: Array, right: Array, wrong: Array) -> float:
    return float(_losses(p, right, wrong))


def _data(levels: ArrayLike, right: ArrayLike, trials: ArrayLike, shape: Shape) -> tuple[Array, Array, Array]:
    x, r, n = (np.asarray(values, float).ravel() for values in (levels, right, trials))
    if not len(x) == len(r) == len(n):
        raise ValueError("levels, right and trials must have the same length")
    if (r < 0).any() or (r > n).any():
        raise ValueError("there cannot be more right answers than trials")
    if shape == "weibull" and (x <= 0).any():
        raise ValueError("a Weibull function needs levels above 0")
    keep = n > 0
    return x[keep], r[keep], n[keep]


def fit_psychometric(
    levels: ArrayLike, right: ArrayLike, trials: ArrayLike, *, guess: float, lapse: float | None = None,
    shape: Shape = "normal", most_lapse: float = 0.1,
) -> Psychometric:  # fmt: skip
    """Fit threshold and spread, and the lapse rate if it is not given.

    Parameters
    ----------
    levels, right, trials
        Stimulus levels in the stimulus's unit, and counts of right answers and of trials at each, shape (levels,).
    guess
        Proportion right without any stimulus: 1/2 for two intervals.
    lapse
        Proportion wrong however strong the stimulus is; None: fitted between 0 and ``most_lapse``.
    shape
        Shape of the function F.

    Raises
    ------
    ValueError
        If the data do not fit together, or there are none.
    """
    x, r, n = _data(levels, right, trials, shape)
    if not len(x):
        raise ValueError("there is no trial to fit")
    z = np.log(x) if shape == "weibull" else x
    width = float(np.ptp(z)) or max(abs(float(z[0])), 1.0)
    steps = np.diff(np.unique(z))
    least, most = 0.02 * (float(steps.min()) if len(steps) else width), 20.0 * width
    centre = float(z.mean())
    free = lapse is None

    def loss(parameters: Array) -> float:
        missed = float(parameters[2]) if free else float(lapse or 0.0)
        p = _psi(x, float(parameters[0]), math.exp(float(parameters[1])), guess, missed, shape)
        return _loss(p, r, n - r)

    bounds = [(centre - 3.0 * width, centre + 3.0 * width), (math.log(least), math.log(most))]
    bounds += [(0.0, most_lapse)] if free else []
    starts = np.linspace(*bounds[0], 61)[:, None, None], np.exp(np.linspace(*bounds[1], 41))[:, None]
    missed = lapse if lapse is not None else 0.02
    losses = _losses(_psi(x, starts[0], starts[1], guess, missed, shape), r, n - r)
    row, column = np.unravel_index(int(losses.argmin()), losses.shape)
    first = [float(starts[0][row, 0, 0]), math.log(float(starts[1][column, 0]))] + ([missed] if free else [])
    best = optimize.minimize(
        loss, first, method="Nelder-Mead", bounds=bounds, options={"xatol": 1e-10, "fatol": 1e-12, "maxiter": 4000}
    )
    threshold, log_spread = float(best.x[0]), float(best.x[1])
    missed = float(best.x[2]) if free else float(lapse or 0.0)
    saturated = _loss(r / n, r, n - r)
    bounded = not math.log(least) + 1e-6 < log_spread < math.log(most) - 1e-6
    return Psychometric(
        threshold, math.exp(log_spread), guess, missed, shape, float(best.fun), 2.0 * (float(best.fun) - saturated),
        bounded or not bounds[0][0] < threshold < bounds[0][1],
    )  # fmt: skip


def profile_interval(
    levels: ArrayLike, right: ArrayLike, trials: ArrayLike, fitted: Psychometric, *, level: float = 0.95
) -> tuple[float, float]:
    """Return the profile-likelihood interval of the threshold (infinite where the data do not bound it).

    The lapse rate stays as fitted; the spread is fitted anew at every threshold.

    Parameters
    ----------
    levels, right, trials
        Stimulus levels in the stimulus's unit, and counts of right answers and of trials at each, shape (levels,).
    fitted
        The fit of the same data by `fit_psychometric`.
    level
        Confidence level, 0 to 1.

    Returns
    -------
    tuple
        The ends of the interval, in the unit of the levels.
    """
    x, r, n = _data(levels, right, trials, fitted.shape)
    allowed = fitted.loss + 0.5 * float(stats.chi2.ppf(level, 1))
    z = np.log(x) if fitted.shape == "weibull" else x
    width = float(np.ptp(z)) or 1.0

    spreads = np.linspace(math.log(1e-3 * width), math.log(50.0 * width), 200)

    def loss(log_spread: float, threshold: float) -> float:
        p = _psi(x, threshold, math.exp(log_spread), fitted.guess, fitted.lapse, fitted.shape)
        return _loss(p, r, n - r)

    def excess(threshold: float) -> float:
        p = _psi(x, threshold, np.exp(spreads)[:, None], fitted.guess, fitted.lapse, fitted.shape)
        best = int(_losses(p, r, n - r).argmin())
        near = spreads[max(best - 1, 0)], spreads[min(best + 1, len(spreads) - 1)]
        found = optimize.minimize_scalar(loss, bounds=near, args=(threshold,), method="bounded")
        return float(found.fun) - allowed

    return _crossing(excess, fitted.threshold, -width), _crossing(excess, fitted.threshold, width)


def _crossing(excess: Callable[[float], float], inside: float, width: float) -> float:
    """Return where ``excess`` becomes positive, from ``inside`` in the direction of ``width``; infinite: nowhere."""
    step = 0.05 * width
    if excess(inside) >= 0.0:
        return inside
    while excess(inside + step) < 0.0:
        step *= 2.0
        if abs(step) > 100.0 * abs(width):
            return math.copysign(math.inf, width)
    return float(optimize.brentq(excess, inside, inside + step, xtol=1e-9 * abs(width)))


def beta_binomial_log_pmf(right: int, trials: int, probability: float, overdispersion: float) -> float:
    """Return log P(right) of the beta-binomial model, with the overdispersion eta in [0, 1): nu = 1 / eta^2 - 1.

    eta = 0 is the binomial model.
    """
    if overdispersion == 0.0:
        return float(stats.binom.logpmf(right, trials, probability))
    nu = 1.0 / overdispersion**2 - 1.0
    return float(stats.betabinom.logpmf(right, trials, probability * nu, (1.0 - probability) * nu))
