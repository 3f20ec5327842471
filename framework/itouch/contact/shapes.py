"""Shapes of objects (box, sphere, plane, capsule, cylinder, mesh), each about its own frame's origin, in metres."""

import math
from dataclasses import dataclass, fields
from typing import ClassVar

from itouch.contact import layout
from itouch.contact.mesh_surface import Surface


def _check_lengths(shape: object, values: tuple[float, ...], names: tuple[str, ...]) -> None:
    for name, value in zip(names, values, strict=True):
        try:
            good = math.isfinite(value) and value > 0.0
        except TypeError:
            good = False
        if not good:
            kind = type(shape).__name__
            raise ValueError(f"{kind}: {name} is {value!r}; it must be a positive finite number of metres")


@dataclass(frozen=True, slots=True)
class Plane:
    """The half space z <= 0 of its frame is solid; its surface is z = 0."""

    kind: ClassVar[int] = layout.KIND_PLANE

    def sizes(self) -> tuple[float, float, float]:
        """Three numbers for the world table."""
        return (0.0, 0.0, 0.0)

    def bound(self) -> float:
        """Radius about the origin that holds the shape [m]."""
        return math.inf


@dataclass(frozen=True, slots=True)
class Sphere:
    """Ball about the origin."""

    radius: float
    kind: ClassVar[int] = layout.KIND_SPHERE

    def __post_init__(self) -> None:
        _check_lengths(self, (self.radius,), ("radius",))

    def sizes(self) -> tuple[float, float, float]:
        """Three numbers for the world table."""
        return (self.radius, 0.0, 0.0)

    def bound(self) -> float:
        """Radius about the origin that holds the shape [m]."""
        return self.radius


@dataclass(frozen=True, slots=True)
class Box:
    """Box with the given half lengths of its edges along x, y and z."""

    half_extents: tuple[float, float, float]
    kind: ClassVar[int] = layout.KIND_BOX

    def __post_init__(self) -> None:
        try:
            count = len(self.half_extents)
        except TypeError:
            raise ValueError(f"Box: half_extents is {self.half_extents!r}; it needs 3 numbers") from None
        if count != 3:
            raise ValueError(f"Box: half_extents has {count} numbers; it needs 3")
        _check_lengths(self, tuple(self.half_extents), ("half_extents[0]", "half_extents[1]", "half_extents[2]"))

    def sizes(self) -> tuple[float, float, float]:
        """Three numbers for the world table."""
        return self.half_extents

    def bound(self) -> float:
        """Radius about the origin that holds the shape [m]."""
        return math.hypot(*self.half_extents)


@dataclass(frozen=True, slots=True)
class Capsule:
    """All points within ``radius`` of the segment from (0, 0, -half_length) to (0, 0, half_length)."""

    radius: float
    half_length: float
    kind: ClassVar[int] = layout.KIND_CAPSULE

    def __post_init__(self) -> None:
        _check_lengths(self, (self.radius, self.half_length), tuple(f.name for f in fields(self)))

    def sizes(self) -> tuple[float, float, float]:
        """Three numbers for the world table."""
        return (self.radius, self.half_length, 0.0)

    def bound(self) -> float:
        """Radius about the origin that holds the shape [m]."""
        return self.radius + self.half_length


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Cylinder along z with flat ends at z = -half_length and z = half_length."""

    radius: float
    half_length: float
    kind: ClassVar[int] = layout.KIND_CYLINDER

    def __post_init__(self) -> None:
        _check_lengths(self, (self.radius, self.half_length), tuple(f.name for f in fields(self)))

    def sizes(self) -> tuple[float, float, float]:
        """Three numbers for the world table."""
        return (self.radius, self.half_length, 0.0)

    def bound(self) -> float:
        """Radius about the origin that holds the shape [m]."""
        return math.hypot(self.radius, self.half_length)


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles; several objects may share one surface."""

    surface: Surface
    kind: ClassVar[int] = layout.KIND_MESH

    def __post_init__(self) -> None:
        if not isinstance(self.surface, Surface):
            raise ValueError(f"Mesh: surface is of type {type(self.surface).__name__}; it must be a Surface")

    def sizes(self) -> tuple[float, float, float]:
        """Three numbers for the world table."""
        return (0.0, 0.0, 0.0)

    def bound(self) -> float:
        """Radius about the origin that holds the shape [m]."""
        return self.surface.bound


Shape = Plane | Sphere | Box | Capsule | Cylinder | Mesh
"""Any shape."""
