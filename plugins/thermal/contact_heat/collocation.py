"""One step of a modal side under a flux not known in advance: collocation with half powers of time.

If the slope of the contact resistance jumps, as it does at the end of every step, the flux afterwards behaves as
``1, t, t**1.5, t**2, ...``, since conduction responds with half powers.  With these as the basis for the flux within a
step, six stages achieve what would take polynomials many short steps.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from contact_heat.stack import Array

#: Exponents of time in the basis of the flux within a step.
POWERS = (0.0, 1.0, 1.5, 2.0, 2.5, 3.0)
STAGES = len(POWERS)

_HALVINGS, _POINTS = 34, 14


def radau(stages: int) -> Array:
    """Return the right Radau points on (0, 1], shape (stages,); the last one is 1."""
    series = np.zeros(stages + 1)
    series[-2:] = (-1.0, 1.0)
    # All roots are real; since NumPy 2.5 they come as complex numbers.
    return np.asarray((np.sort(np.polynomial.legendre.legroots(series).real) + 1.0) / 2.0)


@lru_cache(maxsize=1)
def points() -> Array:
    """Return the collocation points within a step of unit length, shape (STAGES,)."""
    return radau(STAGES)


@lru_cache(maxsize=1)
def _inverse_basis() -> Array:
    return np.linalg.inv(points()[:, None] ** np.array(POWERS))


def quadrature() -> Array:
    """Return the weights that integrate the flux over a unit step from its stage values, shape (STAGES,)."""
    return np.asarray((1.0 / (np.array(POWERS) + 1.0)) @ _inverse_basis())


def memory(decay: Array) -> Array:
    """Return ``exp(-decay c)`` at every stage c, shape (STAGES, modes); ``decay`` (modes,) is rate times step [1]."""
    return np.exp(-points()[:, None] * decay)


def response(decay: Array) -> Array:
    """Return what each stage flux adds to each mode at each stage, shape (STAGES at, STAGES flux, modes), per step.

    ``decay`` (modes,) is rate times step [1].
    """
    return np.stack([_inverse_basis().T @ _integrals(decay, c) for c in points()])


def _integrals(decay: Array, end: float) -> Array:
    """Return ``int_0^end exp(-decay (end - t)) t**p dt``, shape (STAGES, modes).

    Substituting ``t = u**2`` turns half powers into polynomials; panels shrink towards the end, where fast modes act.
    """
    past, basis = _panels(float(end))
    fading = np.exp(-decay[:, None] * past)
    return np.asarray((fading @ basis).T)


@lru_cache(maxsize=64)
def _panels(end: float) -> tuple[Array, Array]:
    """Return each node's distance before the end, (nodes,), and its weight by power, (nodes, STAGES)."""
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    gaps = np.sqrt(end) * np.concatenate((0.5 ** np.arange(_HALVINGS), [0.0]))
    width = -np.diff(gaps)[:, None]
    left = (gaps[1:, None] + 0.5 * width * (nodes + 1.0)).ravel()
    u = np.sqrt(end) - left
    measure = (width * weights).ravel() * u
    return left * (np.sqrt(end) + u), measure[:, None] * u[:, None] ** (2.0 * np.array(POWERS))
