"""The closed loop of finger and object at constant resistance: its eigenmodes, with which a step is a product.

Connecting the port of a pair to a resistance adds a rank-one term to its diagonal matrix of rates.  The new rates are
the roots of ``R + sum(port**2 / (rate - root)) = 0``, one between each two old ones, and the new modes are Cauchy
vectors ``port / (rate - root)``; a resistance of zero is no special case.  Each root is stored as its distance from the
nearer old rate, so that all differences keep their digits (Bunch, Nielsen and Sorensen 1978).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from contact_heat.dot_product import padded
from contact_heat.hosting import kernel
from contact_heat.stack import Array

#: A mode whose rate times the period exceeds this has decayed after one step.
_GONE = 40.0
#: Rates that agree to this relative difference count as equal: one of their two modes then never reaches the contact.
_EQUAL = 1e-8
#: Rates below this [1/s] count as zero.
_STILL = 1e-18


@dataclass(frozen=True, slots=True, eq=False)
class ClosedLoop:
    """A pair at one resistance, with its ``live`` modes, those that last longer than a step.

    Attributes
    ----------
    decay, gain
        Factor of each mode per step and its flux [W/m2], shape (live padded,).
    heat
        Time integral of the flux of each mode [J/m2] until it has decayed, shape (live padded,).
    coming
        Heat [J/m2] beyond that of the stationary flux, per unit of each coordinate off rest, all modes included, shape
        (size,).
    vectors
        The modes in the coordinates of the pair, shape (live padded, size).
    rest
        Stationary coordinates, shape (size,).
    flux
        Stationary flux [W/m2].
    """

    decay: Array
    gain: Array
    heat: Array
    coming: Array
    vectors: Array
    rest: Array
    flux: float


def close_loop(rates: Array, port: Array, level: float, resistance: float, period: float) -> ClosedLoop:
    """Return the closed loop of a pair with rates [1/s] and port, shape (size,).

    ``level`` is the temperature difference [K] across the open contact at rest, finger minus object.
    """
    order = np.argsort(rates, kind="stable")
    order = order[port[order] != 0.0]
    poles, weights, mixing, still = _merged(rates[order], port[order])
    count = int(np.searchsorted(poles * period, _GONE))
    count = min(count, len(poles) - 1 if resistance == 0.0 else len(poles))
    roots, rows = np.empty(count), np.empty((count, len(poles)))
    _roots(poles, weights, resistance, roots, rows)
    norms = np.sqrt((rows**2).sum(axis=1))
    vectors = np.zeros((padded(count + len(still)), len(rates)))
    vectors[:count, order] = (rows / norms[:, None]) @ mixing
    vectors[count : count + len(still), order] = still
    decay, gain, heat = np.zeros((3, len(vectors)))
    decay[:count], gain[:count] = np.exp(-roots * period), 1.0 / norms
    heat[:count] = gain[:count] / np.maximum(roots, _STILL)
    decay[count : count + len(still)] = np.exp(-period * (still**2 @ rates[order]))
    slow = port / np.maximum(rates, _STILL)
    total = resistance + float(port @ slow)
    flux = level / total
    return ClosedLoop(decay, gain, heat, -slow / total, vectors, slow * flux, flux)


def _merged(rates: Array, port: Array) -> tuple[Array, Array, Array, Array]:
    """Merge equal rates: return poles, squared ports, their vectors (poles, n) and the modes left over (., n)."""
    poles: list[float] = []
    ports: list[float] = []
    mixing: list[Array] = []
    still: list[Array] = []
    unit = np.eye(len(rates))
    for rate, size, axis in zip(rates, port, unit, strict=True):
        if poles and rate - poles[-1] <= max(_EQUAL * rate, _STILL):
            total = float(np.hypot(ports[-1], size))
            still.append((size * mixing[-1] - ports[-1] * axis) / total)
            mixing[-1] = (ports[-1] * mixing[-1] + size * axis) / total
            poles[-1], ports[-1] = rate, total
        else:
            poles.append(float(rate))
            ports.append(float(size))
            mixing.append(axis)
    left = np.array(still) if still else np.zeros((0, len(rates)))
    return np.array(poles), np.array(ports) ** 2, np.array(mixing) * np.sign(ports)[:, None], left


@kernel
def _roots(poles: Array, weights: Array, resistance: float, roots: Array, rows: Any) -> None:
    """Find the roots, in ascending order, and the rows ``sqrt(weight) / (pole - root)``, shape (count, poles)."""
    last = len(poles) - 1
    shifted = np.empty(len(poles))
    for k in range(len(roots)):
        reach = weights.sum() / resistance if k == last else poles[k + 1] - poles[k]
        middle = resistance
        for i in range(len(poles)):
            middle += weights[i] / ((poles[i] - poles[k]) - 0.5 * reach)
        near = k if middle >= 0.0 or k == last else k + 1
        for i in range(len(poles)):
            shifted[i] = poles[i] - poles[near]
        root = _root_between(shifted, weights, resistance, k, near, reach)
        roots[k] = poles[near] + root
        for i in range(len(poles)):
            rows[k, i] = np.sqrt(weights[i]) / (shifted[i] - root)


@kernel
def _root_between(poles: Array, weights: Array, resistance: float, k: int, near: int, reach: float) -> float:
    """Return the root above pole k, measured from the pole ``near``, which is at zero.

    The terms of the poles below and of those above are each replaced by one pole with the right value and slope; the
    root of the replacement is the next guess.
    """
    low, high = (0.0, reach) if near == k else (-reach, 0.0)
    x = 0.5 * (low + high)
    for _ in range(60):
        value, below, above = resistance, 0.0, 0.0
        for i in range(len(poles)):
            term = 1.0 / (poles[i] - x)
            value += weights[i] * term
            if i <= k:
                below += weights[i] * term * term
            else:
                above += weights[i] * term * term
        if value >= 0.0:
            high = x
        else:
            low = x
        left, right = (0.0, reach) if near == k else (-reach, 0.0)
        p, q = below * (left - x) ** 2, above * (right - x) ** 2
        constant = value - p / (left - x) - q / (right - x)
        if near == k:
            guess = _small_root(constant, constant * reach + p + q, p * reach)
        else:
            guess = -_small_root(-constant, -constant * reach + p + q, q * reach)
        if not low < guess < high:
            guess = 0.5 * (low + high)
        if abs(guess - x) <= 4e-16 * abs(guess):
            return float(guess)
        x = guess
    return float(x)


@kernel
def _small_root(a: float, b: float, c: float) -> float:
    """Return the root of ``a x**2 - b x + c`` next to zero, without cancellation."""
    root = np.sqrt(max(b * b - 4.0 * a * c, 0.0))
    return float(2.0 * c / (b + root) if b > 0.0 else (b - root) / (2.0 * a))
