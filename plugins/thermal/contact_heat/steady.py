"""Stationary temperature fields of a side.

In a layer of thickness L with ``m = sqrt(w/k)`` the stationary deviation from the arterial temperature is a combination
of ``cosh`` and ``sinh``; without perfusion it is linear.  At every face the layers behind it impose one linear relation
``a T + b q = g`` between temperature and inward flux; it is propagated outwards layer by layer with all terms divided
by ``exp(m L)``, so that nothing overflows, and held, insulated and endless backs need no separate treatment.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from contact_heat.layers import Side
from contact_heat.stack import Array, Stack, stack_of

Number = TypeVar("Number", float, Array)


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """A stationary temperature field: temperatures [K] and inward fluxes [W/m2] at the faces, shape (layers + 1,).

    After an endless layer, the last temperature is the far one.
    """

    stack: Stack
    arterial: float
    faces: Array
    fluxes: Array

    @property
    def surface(self) -> float:
        """Temperature of the contact face [K]."""
        return float(self.faces[0])

    @property
    def flux(self) -> float:
        """Inward flux at the contact [W/m2]."""
        return float(self.fluxes[0])

    def temperature(self, depths: Array) -> Array:
        """Return the temperature [K] at depths [m] of any shape, as one row (n,)."""
        depths = np.ravel(depths).astype(np.float64)
        index, found = self.stack.layers_at(depths), np.empty(depths.size)
        faces, thickness = self.stack.faces, self.stack.thickness
        for layer in np.unique(index).tolist():
            inside = index == layer
            found[inside] = self._temperature(layer, np.minimum(depths[inside] - faces[layer], thickness[layer]))
        return found

    def flux_at(self, depth: float) -> float:
        """Return the inward flux [W/m2] at a depth [m]."""
        index, x = self.stack.locate(depth)
        k, m, length = self._layer(index)
        outer, p = float(self.faces[index]), self.arterial
        if m * length < 1.0 or m == 0.0:
            return float(self.fluxes[index] * np.cosh(m * x) - k * m * (outer - p) * np.sinh(m * x))
        if np.isinf(length):
            return float(k * m * (outer - p) * np.exp(-m * x))
        head, tail = self._ends(index)
        fall, rise = float(np.exp(-m * x)), float(np.exp(-m * (length - x)))
        return k * m * (head * fall * _unit_cosh(m * (length - x)) - tail * rise * _unit_cosh(m * x))

    def _layer(self, index: int) -> tuple[float, float, float]:
        k = float(self.stack.conductivity[index])
        return k, float(np.sqrt(self.stack.perfusion[index] / k)), float(self.stack.thickness[index])

    def _ends(self, index: int) -> tuple[float, float]:
        """Return the deviations of a layer's faces from the arterial temperature over ``sinh(m L) exp(-m L)``."""
        _, m, length = self._layer(index)
        outer, inner = float(self.faces[index]), float(self.faces[index + 1])
        return (outer - self.arterial) / _unit_sinh(m * length), (inner - self.arterial) / _unit_sinh(m * length)

    def _temperature(self, index: int, x: Array) -> Array | float:
        """Return the temperature [K] at depths [m] within one layer."""
        _, m, length = self._layer(index)
        outer, inner = float(self.faces[index]), float(self.faces[index + 1])
        if m == 0.0:
            return outer if np.isinf(length) else outer + (inner - outer) * (x / length)
        if np.isinf(length):
            return self.arterial + (outer - self.arterial) * np.exp(-m * x)
        head, tail = self._ends(index)
        fall, rise = np.exp(-m * x), np.exp(-m * (length - x))
        return self.arterial + head * fall * _unit_sinh(m * (length - x)) + tail * rise * _unit_sinh(m * x)


def _unit_sinh(x: Number) -> Number:
    """Return ``sinh(x) exp(-x)``."""
    found: Number = -0.5 * np.expm1(-2.0 * x)
    return found


def _unit_cosh(x: float) -> float:
    """Return ``cosh(x) exp(-x)``."""
    return 0.5 * (1.0 + float(np.exp(-2.0 * x)))


def initial_profile(side: Side) -> Profile:
    """Return the field of a side before the touch."""
    start = side.initial
    if start.kind == "uniform":
        return _uniform(side, _given(start.temperature))
    if start.surface is not None:
        return stationary(side, (1.0, 0.0, start.surface))
    film, ambient = _given(start.coefficient), _given(start.ambient)
    return stationary(side, (film, 1.0, film * ambient))


def resting_profile(side: Side) -> Profile:
    """Return the stationary field of a side at zero flux through the contact.

    If any uniform field is stationary, it is the one at the side's initial surface temperature.
    """
    a, _, _ = _relations(stack_of(side), _back_temperature(side), side.arterial or 0.0)[0]
    if a == 0.0:
        return _uniform(side, initial_profile(side).surface)
    return stationary(side, (0.0, 1.0, 0.0))


def stationary(side: Side, surface: tuple[float, float, float]) -> Profile:
    """Return the stationary field under a surface condition ``a T + b q = g`` with q the inward flux.

    Temperatures are taken relative to the back's or the arterial one, so that no digits are lost to the offset of the
    kelvin scale.
    """
    stack = stack_of(side)
    origin = _origin(side, surface)
    arterial = (origin if side.arterial is None else side.arterial) - origin
    relations = _relations(stack, _back_temperature(side) - origin, arterial)
    a, b, g = surface[0], surface[1], surface[2] - surface[0] * origin
    a0, b0, g0 = relations[0]
    determinant = a * b0 - a0 * b
    if determinant == 0.0:
        return _uniform(side, surface[2] / surface[0] if surface[0] else origin)
    faces = [(g * b0 - g0 * b) / determinant]
    fluxes = [(a * g0 - a0 * g) / determinant]
    for index, relation in enumerate(relations[1:]):
        faces.append(_inner_face(stack, index, arterial, faces[-1], relation))
        fluxes.append(_inner_flux(stack, index, arterial, fluxes[-1], relation))
    return Profile(stack, arterial + origin, np.array(faces) + origin, np.array(fluxes))


def _origin(side: Side, surface: tuple[float, float, float]) -> float:
    """Return a temperature [K] of the problem itself, from which the others are measured."""
    if side.back is not None and side.back.temperature is not None:
        return side.back.temperature
    if side.arterial is not None:
        return side.arterial
    return surface[2] / surface[0] if surface[0] else 0.0


def _uniform(side: Side, temperature: float) -> Profile:
    stack = stack_of(side)
    count = len(stack.thickness) + 1
    return Profile(stack, temperature, np.full(count, temperature), np.zeros(count))


def _given(value: float | None) -> float:
    if value is None:
        raise ValueError("initial: a value is missing")
    return value


def _back_temperature(side: Side) -> float:
    return float(side.back.temperature or 0.0) if side.back is not None else 0.0


def _relations(stack: Stack, back: float, arterial: float) -> list[tuple[float, float, float]]:
    """Return ``(a, b, g)`` of every face from the contact to the back."""
    found = [_behind(stack, back, arterial)]
    for index in range(len(stack.thickness) - 1, -1, -1):
        if not np.isinf(stack.thickness[index]):
            found.append(_through(stack, index, arterial, found[-1]))
        else:
            found.append(found[-1])
    return found[::-1]


def _behind(stack: Stack, back: float, arterial: float) -> tuple[float, float, float]:
    if stack.endless:
        y = float(np.sqrt(stack.conductivity[-1] * stack.perfusion[-1]))
        return y, -1.0, y * arterial
    if np.isinf(stack.back):
        return 1.0, 0.0, back
    return stack.back, -1.0, stack.back * back


def _transfer(stack: Stack, index: int) -> tuple[float, float, float, float]:
    """Return ``cosh``, ``sinh/(k m)``, ``k m sinh`` and 1 of a layer, each divided by ``exp(m L)``."""
    k, length = float(stack.conductivity[index]), float(stack.thickness[index])
    m = float(np.sqrt(stack.perfusion[index] / k))
    if m == 0.0:
        return 1.0, length / k, 0.0, 1.0
    sinh = _unit_sinh(m * length)
    return _unit_cosh(m * length), sinh / (k * m), sinh * k * m, float(np.exp(-m * length))


def _through(
    stack: Stack, index: int, arterial: float, inner: tuple[float, float, float]
) -> tuple[float, float, float]:
    cosh, resistance, admittance, unit = _transfer(stack, index)
    a, b, g = inner
    outer = (a * cosh - b * admittance, b * cosh - a * resistance)
    scale = abs(outer[0]) + abs(outer[1])
    source = g * unit - arterial * (a * (unit - cosh) + b * admittance)
    return outer[0] / scale, outer[1] / scale, source / scale


def _inner_face(stack: Stack, index: int, arterial: float, outer: float, relation: tuple[float, float, float]) -> float:
    """Solve for the temperature of a layer's inner face, from the outer one and the relation behind."""
    if np.isinf(stack.thickness[index]):
        return arterial if stack.perfusion[index] > 0.0 else outer
    cosh, resistance, _, unit = _transfer(stack, index)
    a, b, g = relation
    p = arterial if stack.perfusion[index] > 0.0 else 0.0
    return (b * ((outer - p) * unit + p * cosh) - resistance * g) / (b * cosh - resistance * a)


def _inner_flux(stack: Stack, index: int, arterial: float, outer: float, relation: tuple[float, float, float]) -> float:
    """Solve for the inward flux at a layer's inner face, from that at the outer one and the relation behind.

    A difference of the face temperatures would lose its digits in a thin layer.
    """
    if np.isinf(stack.thickness[index]):
        return 0.0
    cosh, _, admittance, unit = _transfer(stack, index)
    a, b, g = relation
    p = arterial if stack.perfusion[index] > 0.0 else 0.0
    divisor = a * cosh - b * admittance
    return outer if divisor == 0.0 else (a * outer * unit - (g - a * p) * admittance) / divisor
