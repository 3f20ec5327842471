"""Passive modal models of a layered side: few real modes that reproduce its response at the contact.

The exact Laplace-domain fields at real shifts, spaced geometrically between the slowest and the fastest rate of
interest, span a space; the heat equation is projected onto it (Galerkin).  The reduced impedance then agrees with the
exact one in value and slope at every shift, converges as ``exp(-pi**2 / log(ratio))``, and stays symmetric: ``q' =
-rate * q + port * flux`` with ``temperature = port . q``, so that no step can create heat.  Rates are computed as
squared singular values of a gradient, not as eigenvalues of a stiffness matrix: the slow ones keep their digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from contact_heat.blas import one_thread
from contact_heat.hosting import kept
from contact_heat.layers import Back, Layer, Side
from contact_heat.stack import Array, Stack, imbalance, layer_stack
from contact_heat.trial_functions import PANEL_POINTS, Span, quadrature, trial_span

#: Ratio of neighbouring shifts; 1.6 gives about 1e-9 in the contact flux.
RATIO = 1.6
#: Slowest rate of interest [1/s].
SLOWEST = 2e-5
#: Shifts reach this many times 1/period.
REACH = 1e4

_RANK = 1e-10

# Maps values at the Gauss points of a panel to Legendre coefficients.
_FIT = np.linalg.inv(legendre.legvander(legendre.leggauss(PANEL_POINTS)[0], PANEL_POINTS - 1))


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """Modes of a side for the deviation from a stationary field; ``n`` modes, ``m`` quadrature depths.

    With coordinates q of shape (n,): ``q' = -rates * q + contact * j_in + back * j_back_in`` where the fluxes
    enter the side [W/m2] at the contact and through the back face; the deviation at a depth is ``shape . q``.

    Attributes
    ----------
    rates
        Decay rates [1/s], ascending, shape (n,).
    contact, back
        Mode values at the contact and at the back face, shape (n,): port vectors and output rows alike.
        The back is a port only where the side was built with it; a semi-infinite side has zeros there.
    content
        Heat [J/m2] per coordinate, shape (n,).
    blood
        Perfusion as a port: the drive [W/m2] per kelvin of warmer blood, shape (n,).
    depths, weights, shapes
        Quadrature depths [m] and heat capacity weights [J/m2K], shape (m,), and mode values, shape (m, n).
    edges
        Edges of the quadrature panels [m]; the modes are smooth between them.
    """

    rates: Array
    contact: Array
    back: Array
    content: Array
    blood: Array
    depths: Array
    weights: Array
    shapes: Array
    edges: Array

    def project(self, deviation: Array) -> Array:
        """Return the coordinates, shape (n,), of a field [K] given at ``depths``."""
        return np.asarray((self.weights * deviation) @ self.shapes)

    def row(self, depth: float) -> Array:
        """Return the mode values at a depth [m], shape (n,), interpolated within its panel."""
        inside, place, _ = self._panel(depth)
        return np.asarray(legendre.legvander(np.array([place]), PANEL_POINTS - 1)[0] @ _FIT @ self.shapes[inside])

    def slope(self, depth: float) -> Array:
        """Return the mode gradients at a depth [1/m], shape (n,)."""
        inside, place, half = self._panel(depth)
        terms = [legendre.legval(place, legendre.legder(unit)) for unit in np.eye(PANEL_POINTS)]
        return np.asarray(np.array(terms) @ _FIT @ self.shapes[inside] / half)

    def _panel(self, depth: float) -> tuple[slice, float, float]:
        """Return the points of a depth's panel, its position there from -1 to 1, and half the panel's width [m]."""
        panel = int(np.clip(np.searchsorted(self.edges, depth, side="right") - 1, 0, len(self.edges) - 2))
        half = 0.5 * float(self.edges[panel + 1] - self.edges[panel])
        inside = slice(panel * PANEL_POINTS, (panel + 1) * PANEL_POINTS)
        return inside, (depth - float(self.edges[panel])) / half - 1.0, half

    @property
    def unit_rise(self) -> Array:
        """Coordinates, shape (n,), of the stationary field with 1 K at the contact."""
        rise = self.contact / np.maximum(self.rates, SLOWEST * 1e-9)
        return np.asarray(rise / (self.contact @ rise))


def side_modes(side: Side, period: float, *, back_port: bool = False) -> Modes:
    """Return the modes of a side for steps of ``period`` [s].

    Cached by content.  ``back_port`` adds the response to a flux through the back face, for stacks that are driven from
    behind (a plate on a Peltier element).  A uniform start out of equilibrium with blood or back adds the fields of its
    own decay.
    """
    return layer_modes(side.layers, side.back, REACH / period, back_port, _ratios(imbalance(side)))


def _ratios(temperatures: tuple[float, float] | None) -> tuple[float, float] | None:
    """Scale an imbalance to a greatest value of 1, so that sides that differ only in temperature share modes."""
    if temperatures is None:
        return None
    scale = max(abs(temperatures[0]), abs(temperatures[1]))
    return temperatures[0] / scale, temperatures[1] / scale


def layer_modes(
    layers: tuple[Layer, ...],
    back: Back | None,
    fastest: float,
    back_port: bool = False,
    drive: tuple[float, float] | None = None,
) -> Modes:
    """Return the modes of layers for rates from `SLOWEST` to ``fastest`` [1/s]; see `side_modes`.

    A restored session uses the modes stored with it.

    Raises
    ------
    ValueError
        If the shapes of stored modes do not match.
    """

    def solve() -> Modes:
        return solved_modes(layers, back, fastest, back_port, drive)

    return kept(("modes", layers, back, fastest, back_port, drive), solve, _packed, _loaded)


def _packed(modes: Modes) -> tuple[Array, ...]:
    return tuple(getattr(modes, name) for name in Modes.__dataclass_fields__)


def _loaded(arrays: tuple[Array, ...]) -> Modes:
    """Return stored arrays as modes, after checking their shapes: compiled steps do not check sizes."""
    shapes = [array.shape for array in arrays]
    n, m = (shapes[0][0], shapes[5][0]) if len(shapes) == 9 and shapes[0] and shapes[5] else (0, 0)
    edges = m // PANEL_POINTS + 1
    if n == 0 or shapes != [(n,)] * 5 + [(m,), (m,), (m, n), (edges,)]:
        raise ValueError(f"stored modes have the shapes {shapes}, which do not fit together")
    return Modes(*arrays)


@lru_cache(maxsize=256)
def solved_modes(
    layers: tuple[Layer, ...],
    back: Back | None,
    fastest: float,
    back_port: bool,
    drive: tuple[float, float] | None,
) -> Modes:
    """Return the modes of layers by a new solve; cached by content."""
    with one_thread():
        return _project(layer_stack(layers, back), _shifts(fastest), back_port, drive)


def _shifts(fastest: float) -> Array:
    count = int(np.ceil(np.log(fastest / SLOWEST) / np.log(RATIO))) + 1
    return np.geomspace(SLOWEST, fastest, count)


def _project(stack: Stack, shifts: Array, back_port: bool, drive: tuple[float, float] | None) -> Modes:
    """Orthonormalise the trial functions in heat capacity and diagonalise conduction on them."""
    points, weights, edges = quadrature(stack, shifts, back=back_port, faces=drive is not None)
    index = np.repeat(np.arange(len(points)), [len(x) for x in points])
    weight = np.concatenate(weights)
    mass = weight * stack.capacity[index]
    span = _orthonormal(trial_span(stack, shifts, points, back_port, drive), mass)
    gradient = [np.sqrt(weight * stack.conductivity[index])[:, None] * span.gradients]
    gradient.append(np.sqrt(weight * stack.perfusion[index])[:, None] * span.values)
    if np.isfinite(stack.back):
        gradient.append(np.sqrt(stack.back) * span.back[None, :])
    _, roots, rows = np.linalg.svd(np.concatenate(gradient), full_matrices=False)
    span = span.times(rows[::-1].T)
    depths = np.concatenate([x + face for x, face in zip(points, stack.faces, strict=False)])
    back = np.zeros_like(span.back) if stack.endless else span.back
    blood = (weight * stack.perfusion[index]) @ span.values
    content = mass @ span.values
    found = (roots[::-1] ** 2, span.contact, back, content, blood, depths, mass, span.values, edges)
    for array in found:
        array.setflags(write=False)
    return Modes(*found)


def _orthonormal(span: Span, mass: Array) -> Span:
    """Return an orthonormal basis of the span without its weakest directions; the second pass corrects rounding."""
    span = span.scaled(np.sqrt(np.maximum(mass @ span.values**2, 1e-300)))
    root = np.sqrt(mass)[:, None]
    _, sizes, rows = np.linalg.svd(root * span.values, full_matrices=False)
    kept = sizes > _RANK * sizes[0]
    span = span.times(rows[kept].T / sizes[kept])
    return span.times(np.asarray(np.linalg.inv(np.linalg.qr(root * span.values, mode="r"))))
