"""Passive modal models of a layered side: few real modes that reproduce its response at the contact.

The exact Laplace-domain fields at real shifts, spaced geometrically between the slowest and the fastest rate of
interest, span a space; the heat equation is projected on it (Galerkin).  The reduced impedance then agrees with
the exact one in value and slope at every shift, it converges as ``exp(-pi**2 / log(ratio))``, and it stays
symmetric: ``q' = -rate * q + port * flux`` with ``temperature = port . q``, so that no step can create heat.
Rates are squared singular values of a gradient, not eigenvalues of a stiffness: the slow ones keep their digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from itouch_thermal.solver.fields import waves
from itouch_thermal.solver.layers import Back, Layer, Side
from itouch_thermal.solver.stack import Array, Stack, imbalance, layer_stack

#: Ratio of neighbouring shifts; 1.6 gives about 1e-9 in the contact flux.
RATIO = 1.6
#: Slowest rate of interest [1/s].
SLOWEST = 2e-5
#: Shifts reach this many times 1/period.
REACH = 3e3

_PANEL_POINTS, _PANEL_GROWTH = 14, 0.6
_RANK = 1e-10
#: What happens deep inside faster than this [1/s] is not seen at the contact.
_DEEP_RATE = 4000.0


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
    depths, weights, shapes
        Quadrature depths [m] and heat capacity weights [J/m2K], shape (m,), and mode values, shape (m, n).
    edges
        Edges of the quadrature panels [m]; the modes are smooth between them.
    """

    rates: Array
    contact: Array
    back: Array
    content: Array
    depths: Array
    weights: Array
    shapes: Array
    edges: Array

    def project(self, deviation: Array) -> Array:
        """Return the coordinates, shape (n,), of a field [K] given at ``depths``."""
        return np.asarray(self.shapes.T @ (self.weights * deviation))

    def row(self, depth: float) -> Array:
        """Return the mode values at a depth [m], shape (n,), interpolated within its panel."""
        panel = int(np.clip(np.searchsorted(self.edges, depth, side="right") - 1, 0, len(self.edges) - 2))
        inside = slice(panel * _PANEL_POINTS, (panel + 1) * _PANEL_POINTS)
        near = self.depths[inside]
        ratios = (depth - near)[None, :] / (near[:, None] - near + np.eye(len(near)))
        np.fill_diagonal(ratios, 1.0)
        return np.asarray(ratios.prod(axis=1) @ self.shapes[inside])

    @property
    def unit_rise(self) -> Array:
        """Coordinates, shape (n,), of the stationary field with 1 K at the contact."""
        rise = self.contact / np.maximum(self.rates, SLOWEST * 1e-9)
        return np.asarray(rise / (self.contact @ rise))


def side_modes(side: Side, period: float, *, back_port: bool = False) -> Modes:
    """Return the modes of a side for steps of ``period`` [s].

    Cached by content.  ``back_port`` adds the response to a flux through the back face, for stacks which are
    driven from behind (a plate on a Peltier element).  A uniform start out of balance with blood or back adds
    the fields of its own decay.
    """
    return layer_modes(side.layers, side.back, REACH / period, back_port, _ratios(imbalance(side)))


def _ratios(temperatures: tuple[float, float] | None) -> tuple[float, float] | None:
    """Scale an imbalance to a greatest value of 1, so that sides which differ only in temperature share modes."""
    if temperatures is None:
        return None
    scale = max(abs(temperatures[0]), abs(temperatures[1]))
    return temperatures[0] / scale, temperatures[1] / scale


@lru_cache(maxsize=256)
def layer_modes(
    layers: tuple[Layer, ...],
    back: Back | None,
    fastest: float,
    back_port: bool = False,
    drive: tuple[float, float] | None = None,
) -> Modes:
    """Return the modes of layers for rates from `SLOWEST` to ``fastest`` [1/s]; see `side_modes`."""
    return _project(layer_stack(layers, back), _shifts(fastest), back_port, drive)


def _shifts(fastest: float) -> Array:
    count = int(np.ceil(np.log(fastest / SLOWEST) / np.log(RATIO))) + 1
    return np.geomspace(SLOWEST, fastest, count)


@dataclass(slots=True, eq=False)
class _Span:
    """Trial functions as columns: values and gradients at the quadrature depths, values at both faces."""

    values: Array
    gradients: Array
    contact: Array
    back: Array

    def join(self, other: _Span) -> _Span:
        pairs = zip(self._all(), other._all(), strict=True)
        return _Span(*(np.concatenate(pair, axis=-1) for pair in pairs))

    def scaled(self, norms: Array) -> _Span:
        return _Span(*(part / norms for part in self._all()))

    def times(self, matrix: Array) -> _Span:
        return _Span(*(part @ matrix for part in self._all()))

    def _all(self) -> tuple[Array, Array, Array, Array]:
        return self.values, self.gradients, self.contact, self.back


def _project(stack: Stack, shifts: Array, back_port: bool, drive: tuple[float, float] | None) -> Modes:
    """Orthonormalise the trial functions in heat capacity and diagonalise conduction on them."""
    points, weights, edges = _quadrature(stack, shifts, back=back_port, faces=drive is not None)
    index = np.repeat(np.arange(len(points)), [len(x) for x in points])
    weight = np.concatenate(weights)
    mass = weight * stack.capacity[index]
    span = _orthonormal(_span(stack, shifts, points, back_port, drive), mass)
    gradient = [np.sqrt(weight * stack.conductivity[index])[:, None] * span.gradients]
    gradient.append(np.sqrt(weight * stack.perfusion[index])[:, None] * span.values)
    if np.isfinite(stack.back):
        gradient.append(np.sqrt(stack.back) * span.back[None, :])
    _, roots, rows = np.linalg.svd(np.concatenate(gradient), full_matrices=False)
    span = span.times(rows[::-1].T)
    depths = np.concatenate([x + face for x, face in zip(points, stack.faces, strict=False)])
    back = np.zeros_like(span.back) if stack.endless else span.back
    found = (roots[::-1] ** 2, span.contact, back, mass @ span.values, depths, mass, span.values, edges)
    for array in found:
        array.setflags(write=False)
    return Modes(*found)


def _orthonormal(span: _Span, mass: Array) -> _Span:
    """Return an orthonormal basis of the span without its weakest directions; the second pass mends rounding."""
    span = span.scaled(np.sqrt(np.maximum(mass @ span.values**2, 1e-300)))
    root = np.sqrt(mass)[:, None]
    _, sizes, rows = np.linalg.svd(root * span.values, full_matrices=False)
    kept = sizes > _RANK * sizes[0]
    span = span.times(rows[kept].T / sizes[kept])
    return span.times(np.linalg.inv(np.linalg.qr(root * span.values, mode="r")))


def _span(
    stack: Stack, shifts: Array, points: list[Array], back_port: bool, drive: tuple[float, float] | None
) -> _Span:
    span = _fields(stack, shifts, points, np.ones_like(shifts))
    if not stack.endless and stack.back == 0.0:
        span = span.join(_constant(points))
    if back_port:
        span = span.join(_mirrored(stack, shifts, points))
    if drive is not None:
        slow = shifts[shifts < _DEEP_RATE]
        driven = _fields(stack, slow, points, np.zeros_like(slow), *drive)
        # Only differences meet a held back's condition that the deviation vanishes there.
        span = span.join(driven.times(np.diff(np.eye(len(slow)), axis=1)))
    return span


def _fields(
    stack: Stack, s: Array, points: list[Array], flux: Array, arterial: float = 0.0, back: float = 0.0
) -> _Span:
    found = waves(stack, s, arterial=arterial, back=back)
    entering = found.entering(flux)
    values, gradients = [], []
    for i, (x, k) in enumerate(zip(points, stack.conductivity, strict=True)):
        values.append(found.temperature_within(i, x, entering[i]))
        gradients.append(found.flux_within(i, x, entering[i]) / -k)
    last, end = len(points) - 1, stack.thickness[-1:]
    behind = np.zeros_like(s) if stack.endless else found.temperature_within(last, end, entering[last])[0]
    front = found.temperature_within(0, np.zeros(1), entering[0])[0]
    return _Span(np.concatenate(values), np.concatenate(gradients), front, behind)


def _constant(points: list[Array]) -> _Span:
    count = sum(len(x) for x in points)
    return _Span(np.ones((count, 1)), np.zeros((count, 1)), np.ones(1), np.ones(1))


def _mirrored(stack: Stack, shifts: Array, points: list[Array]) -> _Span:
    """Return the fields of a flux through the back face, the contact being closed."""
    if stack.endless or np.isinf(stack.back):
        raise ValueError("back: only an insulated or convective back can be a flux port")
    turned = Stack(stack.thickness[::-1], stack.conductivity[::-1], stack.capacity[::-1], stack.perfusion[::-1], 0.0)
    mirrored = [(length - x)[::-1] for x, length in zip(points, stack.thickness, strict=True)][::-1]
    # A convective back shunts the port: the span is the same, as the shunted field is a multiple of this one.
    span = _fields(turned, shifts, mirrored, np.ones_like(shifts))
    return _Span(span.values[::-1], -span.gradients[::-1], span.back, span.contact)


def _quadrature(stack: Stack, shifts: Array, *, back: bool, faces: bool) -> tuple[list[Array], list[Array], Array]:
    """Return Gauss points and weights per layer and the panels' edges [m].

    Panels grow with diffusion time from the contact, from a driven ``back`` and, if asked, from all ``faces``.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_PANEL_POINTS)
    slowness = np.sqrt(stack.capacity / stack.conductivity)
    far = 40.0 / np.sqrt(shifts[0])
    ends = np.cumsum(np.where(np.isinf(stack.thickness), far, stack.thickness * slowness))
    anchors = [(0.0, 1.0 / np.sqrt(shifts[-1]))]
    anchors += [(float(ends[-1]), anchors[0][1])] if back else []
    anchors += [(float(end), 1.0 / np.sqrt(_DEEP_RATE)) for end in ends] if faces else []
    points, masses, edges = [], [], [np.zeros(1)]
    for start, end, scale, length in zip(
        np.concatenate(([0.0], ends[:-1])), ends, slowness, stack.thickness, strict=True
    ):
        panels = _panels(start, end, anchors) - start
        local = panels / scale if np.isinf(length) else panels / (end - start) * length
        edges.append(edges[-1][-1] + local[1:])
        width = np.diff(local)[:, None]
        points.append((local[:-1, None] + 0.5 * width * (nodes + 1.0)).ravel())
        masses.append((0.5 * width * weights).ravel())
    return points, masses, np.concatenate(edges)


def _panels(start: float, end: float, anchors: list[tuple[float, float]]) -> Array:
    edges = [start]
    while edges[-1] < end:
        here = edges[-1]
        reach = [
            max(here - place if place <= here else (place - here) / (1.0 + _PANEL_GROWTH), finest)
            for place, finest in anchors
        ]
        edges.append(here + _PANEL_GROWTH * min(reach))
    found = np.array(edges)
    return np.asarray(start + (found - start) * (end - start) / (found[-1] - start))
