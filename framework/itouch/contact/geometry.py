"""The read-only tables that the kernels work on, built once from shapes and materials."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from itouch.contact import layout
from itouch.contact.shapes import Shape
from itouch.contact.vectors import Floats


@dataclass(frozen=True, slots=True)
class Friction:
    """Coulomb friction of one object, and whether a surface without inside is touched from both sides.

    ``dynamic`` must not exceed ``static``; both are >= 0. ``shading`` smooths a mesh's force by its vertex normals.
    """

    static: float = 0.0
    dynamic: float = 0.0
    two_sided: bool = False
    shading: bool = False

    def __post_init__(self) -> None:
        for name, value in (("static", self.static), ("dynamic", self.dynamic)):
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"Friction: {name} is {value!r}; it must be a finite number >= 0")
        if self.dynamic > self.static:
            raise ValueError(f"Friction: dynamic is {self.dynamic!r}; it must not exceed static, {self.static!r}")


@dataclass(frozen=True, slots=True)
class Geometry:
    """Shapes of all objects as flat read-only arrays; make one with :meth:`build`.

    Attributes
    ----------
    world
        One row per object, shape (n, layout.WORLD_WIDTH).
    mesh
        Every mesh's triangles and hierarchy, flat; None without a mesh (the kernels then hold no mesh code).
    """

    world: Floats
    mesh: Floats | None

    @classmethod
    def build(cls, shapes: Sequence[Shape], surfaces: Sequence[Friction] = ()) -> "Geometry":
        """Build the tables.

        Parameters
        ----------
        shapes
            One per object, each in its object's frame.
        surfaces
            One per object; none at all means no friction anywhere.

        Raises
        ------
        ValueError
            When the two sequences differ in length.
        """
        if surfaces and len(surfaces) != len(shapes):
            raise ValueError(f"surfaces has {len(surfaces)} entries; it needs one per shape, {len(shapes)}")
        world = np.zeros((len(shapes), layout.WORLD_WIDTH))
        for i, shape in enumerate(shapes):
            surface = surfaces[i] if surfaces else Friction()
            world[i, layout.WORLD_KIND] = shape.kind
            world[i, layout.WORLD_SIZE : layout.WORLD_SIZE + 3] = shape.sizes()
            world[i, layout.WORLD_BOUND] = shape.bound()
            world[i, layout.WORLD_STATIC_FRICTION] = surface.static
            world[i, layout.WORLD_DYNAMIC_FRICTION] = surface.dynamic
            world[i, layout.WORLD_TWO_SIDED] = surface.two_sided
            world[i, layout.WORLD_SHADING] = surface.shading
            world[i, layout.WORLD_SOLID] = 1.0
        world.flags.writeable = False
        return cls(world=world, mesh=None)

    @property
    def count(self) -> int:
        """Number of objects."""
        return int(self.world.shape[0])

    def memory_size(self) -> int:
        """Numbers that one probe remembers between steps."""
        return layout.MEMORY_POSES + 7 * self.count

    def new_memory(self) -> Floats:
        """Return the zeroed memory of one probe: its first step is a reset."""
        return np.zeros(self.memory_size())

    def new_result(self) -> Floats:
        """Return the result of one probe as before any step: no contact, nothing near."""
        result = np.zeros(layout.RESULT_SIZE)
        result[[layout.RESULT_PRIMARY, layout.RESULT_NEAREST]] = -1.0
        result[layout.RESULT_DISTANCE] = np.inf
        return result
