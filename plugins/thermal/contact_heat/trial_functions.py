"""Trial functions for the modes of a side: exact fields at real rates, on quadrature panels that resolve them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_heat.fields import waves
from contact_heat.stack import Array, Stack

#: Gauss points per panel.
PANEL_POINTS = 14
#: Processes deep inside that are faster than this [1/s] are not seen at the contact.
DEEP_RATE = 4000.0

_PANEL_GROWTH = 0.6
#: Differences between fields below this fraction of the fields have fewer true digits than the basis needs.
_NOISE = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Span:
    """Trial functions as columns: values and gradients at the quadrature depths, values at both faces."""

    values: Array
    gradients: Array
    contact: Array
    back: Array

    def join(self, other: Span) -> Span:
        """Return both sets of functions together."""
        pairs = zip(self._all(), other._all(), strict=True)
        return Span(*(np.concatenate(pair, axis=-1) for pair in pairs))

    def scaled(self, norms: Array) -> Span:
        """Divide each function by its norm.

        ``norms`` has shape (functions,), in the unit of the functions.
        """
        return Span(*(part / norms for part in self._all()))

    def times(self, matrix: Array) -> Span:
        """Return linear combinations of the functions, one per column of the matrix.

        ``matrix`` has shape (functions, combinations) and no unit [1].
        """
        return Span(*(part @ matrix for part in self._all()))

    def _all(self) -> tuple[Array, Array, Array, Array]:
        return self.values, self.gradients, self.contact, self.back


def trial_span(
    stack: Stack, shifts: Array, points: list[Array], back_port: bool, drive: tuple[float, float] | None
) -> Span:
    """Return the trial functions of a stack.

    Parameters
    ----------
    stack
        The side.
    shifts
        Rates at which the response to a contact flux is exact [1/s], shape (rates,).
    points
        Depths within each layer [m].
    back_port
        Whether a flux may enter through the back face.
    drive
        Arterial and back temperature [K] of a start out of equilibrium, relative to it; None for none.
    """
    span = _fields(stack, shifts, points, np.ones_like(shifts))
    if not stack.endless and stack.back == 0.0:
        span = span.join(_constant(points))
    if back_port:
        span = span.join(_mirrored(stack, shifts, points))
    if drive is not None:
        span = span.join(_driven(stack, shifts[shifts < DEEP_RATE], points, drive))
    return span


def _driven(stack: Stack, rates: Array, points: list[Array], drive: tuple[float, float]) -> Span:
    """Return the fields caused by blood and back; only differences if the back is held, as modes vanish there."""
    fields = _fields(stack, rates, points, np.zeros_like(rates), *drive)
    if np.isfinite(stack.back):
        return fields
    steps = fields.times(np.diff(np.eye(len(rates)), axis=1))
    sizes = np.abs(fields.values).max(axis=0)[1:]
    return steps.times(np.eye(len(rates) - 1)[:, np.abs(steps.values).max(axis=0) > _NOISE * sizes])


def _fields(stack: Stack, s: Array, points: list[Array], flux: Array, arterial: float = 0.0, back: float = 0.0) -> Span:
    found = waves(stack, s, arterial=arterial, back=back)
    entering = found.entering(flux)
    values, gradients = [], []
    for i, (x, k) in enumerate(zip(points, stack.conductivity, strict=True)):
        values.append(found.temperature_within(i, x, entering[i]))
        gradients.append(found.flux_within(i, x, entering[i]) / -k)
    last, end = len(points) - 1, stack.thickness[-1:]
    behind = np.zeros_like(s) if stack.endless else found.temperature_within(last, end, entering[last])[0]
    front = found.temperature_within(0, np.zeros(1), entering[0])[0]
    return Span(np.concatenate(values), np.concatenate(gradients), front, behind)


def _constant(points: list[Array]) -> Span:
    count = sum(len(x) for x in points)
    return Span(np.ones((count, 1)), np.zeros((count, 1)), np.ones(1), np.ones(1))


def _mirrored(stack: Stack, shifts: Array, points: list[Array]) -> Span:
    """Return the fields of a flux through the back face, with no flux through the contact."""
    if stack.endless or np.isinf(stack.back):
        raise ValueError("back: only an insulated or convective back can be a flux port")
    turned = Stack(stack.thickness[::-1], stack.conductivity[::-1], stack.capacity[::-1], stack.perfusion[::-1], 0.0)
    mirrored = [(length - x)[::-1] for x, length in zip(points, stack.thickness, strict=True)][::-1]
    # A convective back is a shunt across the port: the span is the same, as the shunted field is a multiple of this
    # one.
    span = _fields(turned, shifts, mirrored, np.ones_like(shifts))
    return Span(span.values[::-1], -span.gradients[::-1], span.back, span.contact)


def quadrature(stack: Stack, shifts: Array, *, back: bool, faces: bool) -> tuple[list[Array], list[Array], Array]:
    """Return Gauss points and weights for each layer, and the panels' edges [m].

    Panels grow with diffusion time from the contact, from a driven ``back`` and, if requested, from all ``faces``.

    ``shifts`` has shape (rates,) [1/s], in ascending order.
    """
    nodes, weights = np.polynomial.legendre.leggauss(PANEL_POINTS)
    slowness = np.sqrt(stack.capacity / stack.conductivity)
    far = 40.0 / np.sqrt(shifts[0])
    ends = np.cumsum(np.where(np.isinf(stack.thickness), far, stack.thickness * slowness))
    anchors = [(0.0, 1.0 / np.sqrt(shifts[-1]))]
    anchors += [(float(ends[-1]), anchors[0][1])] if back else []
    anchors += [(float(end), 1.0 / np.sqrt(DEEP_RATE)) for end in ends] if faces else []
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
