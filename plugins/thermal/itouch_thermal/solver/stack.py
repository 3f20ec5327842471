"""A side as plain arrays, and its stationary temperature profiles.

Through a layer of thickness L with ``m = sqrt(w/k)`` the stationary deviation from the arterial temperature is
a combination of ``cosh`` and ``sinh``, without perfusion it is linear.  At every face the layers behind it impose one
linear relation ``a T + b q = g`` between temperature and inward flux; it is carried outwards layer by layer with all
terms divided by ``exp(m L)``, so that nothing overflows and held, insulated and endless backs are one case.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from itouch_thermal.solver.layers import Back, Layer, Side

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Stack:
    """The layers of a side as arrays, outermost first; shape (layers,).

    ``back`` is the admittance of the back face [W/m2K]: infinite when held, 0 when insulated or endless.
    """

    thickness: Array
    conductivity: Array
    capacity: Array
    perfusion: Array
    back: float

    @property
    def endless(self) -> bool:
        """Whether the last layer is semi-infinite."""
        return bool(np.isinf(self.thickness[-1]))

    @property
    def faces(self) -> Array:
        """Depth of the outer face of every layer and of the back [m], shape (layers + 1,)."""
        return np.concatenate(([0.0], np.cumsum(self.thickness)))

    def locate(self, depth: float) -> tuple[int, float]:
        """Return the layer at a depth and the depth within it [m]; the back face belongs to the last layer."""
        faces = self.faces
        last = len(self.thickness) - 1
        index = min(int(np.searchsorted(faces, depth, side="right")) - 1, last)
        return index, min(depth - float(faces[index]), float(self.thickness[index]))


def stack_of(side: Side) -> Stack:
    """Return the arrays of a side."""
    return layer_stack(side.layers, side.back)


@lru_cache(maxsize=4096)
def layer_stack(layers: tuple[Layer, ...], back: Back | None) -> Stack:
    """Return the arrays of layers on a back, None for an endless last layer."""
    thickness = np.array([np.inf if layer.thickness is None else layer.thickness for layer in layers])
    conductivity, capacity, perfusion = (
        np.array([getattr(layer, name) for layer in layers], dtype=np.float64)
        for name in ("conductivity", "heat_capacity", "perfusion")
    )
    for column in (thickness, conductivity, capacity, perfusion):
        column.setflags(write=False)
    return Stack(thickness, conductivity, capacity, perfusion, _admittance(back))


def _admittance(back: Back | None) -> float:
    if back is None or back.kind == "insulated":
        return 0.0
    if back.kind == "temperature":
        return float("inf")
    return float(back.coefficient or 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """A stationary temperature field: face temperatures [K] and the flux into the side at the contact [W/m2].

    ``faces`` has one temperature per face, shape (layers + 1,); behind an endless layer it is the far temperature.
    """

    stack: Stack
    arterial: float
    faces: Array
    flux: float

    @property
    def surface(self) -> float:
        """Temperature of the contact face [K]."""
        return float(self.faces[0])

    def temperature(self, depths: Array) -> Array:
        """Temperature [K] at depths [m], same shape."""
        return np.array([self._at(*self.stack.locate(float(depth)))[0] for depth in np.ravel(depths)])

    def flux_at(self, depth: float) -> float:
        """Inward flux [W/m2] at a depth [m]."""
        return self._at(*self.stack.locate(depth))[1]

    def _at(self, index: int, x: float) -> tuple[float, float]:
        k, w = float(self.stack.conductivity[index]), float(self.stack.perfusion[index])
        length = float(self.stack.thickness[index])
        outer, inner = float(self.faces[index]), float(self.faces[index + 1])
        if w == 0.0:
            slope = 0.0 if np.isinf(length) else (inner - outer) / length
            return outer + slope * x, -k * slope
        m, p = float(np.sqrt(w / k)), self.arterial
        if np.isinf(length):
            decay = (outer - p) * float(np.exp(-m * x))
            return p + decay, k * m * decay
        head, tail = (outer - p) / _unit_sinh(m * length), (inner - p) / _unit_sinh(m * length)
        fall, rise = float(np.exp(-m * x)), float(np.exp(-m * (length - x)))
        value = head * fall * _unit_sinh(m * (length - x)) + tail * rise * _unit_sinh(m * x)
        slope = tail * rise * _unit_cosh(m * x) - head * fall * _unit_cosh(m * (length - x))
        return p + value, -k * m * slope


def _unit_sinh(x: float) -> float:
    """``sinh(x) exp(-x)``."""
    return -0.5 * float(np.expm1(-2.0 * x))


def _unit_cosh(x: float) -> float:
    """``cosh(x) exp(-x)``."""
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


def imbalance(side: Side) -> tuple[float, float] | None:
    """Return arterial and back temperature [K] relative to a uniform start; None if it is in balance or steady."""
    if side.initial.kind != "uniform":
        return None
    start = side.initial.temperature or 0.0
    perfused = any(layer.perfusion > 0.0 for layer in side.layers)
    arterial = side.arterial - start if perfused and side.arterial is not None else 0.0
    back = 0.0 if side.back is None or side.back.temperature is None else side.back.temperature - start
    return None if arterial == back == 0.0 else (arterial, back)


def resting_profile(side: Side) -> Profile:
    """Return the stationary field of a side without flux through the contact.

    Where any uniform field is stationary, it is the one at the side's initial surface temperature.
    """
    a, _, _ = _relations(stack_of(side), _back_temperature(side), side.arterial or 0.0)[0]
    if a == 0.0:
        return _uniform(side, initial_profile(side).surface)
    return stationary(side, (0.0, 1.0, 0.0))


def stationary(side: Side, surface: tuple[float, float, float]) -> Profile:
    """Return the stationary field under a surface condition ``a T + b q = g`` with q the inward flux.

    Temperatures are taken relative to the back's or the arterial one, so that no digit is lost to the offset
    of the kelvin scale.
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
    flux = (a * g0 - a0 * g) / determinant
    for index, relation in enumerate(relations[1:]):
        faces.append(_inner_face(stack, index, arterial, faces[-1], relation))
    return Profile(stack, arterial + origin, np.array(faces) + origin, flux)


def _origin(side: Side, surface: tuple[float, float, float]) -> float:
    """Return a temperature of the problem's own, to measure the others from."""
    if side.back is not None and side.back.temperature is not None:
        return side.back.temperature
    if side.arterial is not None:
        return side.arterial
    return surface[2] / surface[0] if surface[0] else 0.0


def _uniform(side: Side, temperature: float) -> Profile:
    stack = stack_of(side)
    return Profile(stack, temperature, np.full(len(stack.thickness) + 1, temperature), 0.0)


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
    """Solve for the temperature of a layer's inner face, given the outer one and the relation behind."""
    if np.isinf(stack.thickness[index]):
        return arterial if stack.perfusion[index] > 0.0 else outer
    cosh, resistance, _, unit = _transfer(stack, index)
    a, b, g = relation
    p = arterial if stack.perfusion[index] > 0.0 else 0.0
    return (b * ((outer - p) * unit + p * cosh) - resistance * g) / (b * cosh - resistance * a)
