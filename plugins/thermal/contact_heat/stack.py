"""The layers of a side as arrays, outermost first."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from contact_heat.layers import Back, Layer, Side

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Stack:
    """The layers of a side as arrays, outermost first; shape (layers,).

    ``back`` is the admittance of the back face [W/m2K]: infinite if held, 0 if insulated or endless.
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
        """Depths of the outer face of every layer and of the back [m], shape (layers + 1,)."""
        return np.concatenate(([0.0], np.cumsum(self.thickness)))

    def locate(self, depth: float) -> tuple[int, float]:
        """Return the layer at a depth and the depth within it [m]; the back face belongs to the last layer."""
        index = int(self.layers_at(np.array([depth]))[0])
        return index, min(depth - float(self.faces[index]), float(self.thickness[index]))

    def layers_at(self, depths: Array) -> NDArray[np.intp]:
        """Return the layers at depths [m], same shape; the back face belongs to the last layer."""
        found = np.searchsorted(self.faces, depths, side="right") - 1
        return np.minimum(found, len(self.thickness) - 1)


def stack_of(side: Side) -> Stack:
    """Return the arrays of a side."""
    return layer_stack(side.layers, side.back)


@lru_cache(maxsize=4096)
def layer_stack(layers: tuple[Layer, ...], back: Back | None) -> Stack:
    """Return the arrays of layers and their back; None for an endless last layer."""
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


def imbalance(side: Side) -> tuple[float, float] | None:
    """Return arterial and back temperature [K] relative to a uniform start; None if in equilibrium, or if steady."""
    if side.initial.kind != "uniform":
        return None
    start = side.initial.temperature or 0.0
    perfused = any(layer.perfusion > 0.0 for layer in side.layers)
    arterial = side.arterial - start if perfused and side.arterial is not None else 0.0
    back = 0.0 if side.back is None or side.back.temperature is None else side.back.temperature - start
    return None if arterial == back == 0.0 else (arterial, back)
