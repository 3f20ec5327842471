"""The read-only tables that the contact kernels work on, built once from shapes and materials."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from itouch.contact import layout
from itouch.contact.bvh import CHILD_COUNT, CHILD_REF, MAX_TRIANGLES
from itouch.contact.force_shading import vertex_normals
from itouch.contact.mesh_surface import Surface
from itouch.contact.neighbours import NEIGHBOUR
from itouch.contact.scratch import Mesh as Tables
from itouch.contact.scratch import site_rows
from itouch.contact.shapes import Mesh, Shape
from itouch.contact.vectors import Floats


@dataclass(frozen=True, slots=True)
class Friction:
    """Coulomb friction of one object, and whether its mesh is touched from both sides.

    ``dynamic`` must not exceed ``static``; both are >= 0. ``shading`` smooths a mesh's force by its vertex normals.
    """

    static: float = 0.0
    dynamic: float = 0.0
    two_sided: bool = False
    shading: bool = False

    def __post_init__(self) -> None:
        for name, value in (("static", self.static), ("dynamic", self.dynamic)):
            try:
                good = math.isfinite(value) and value >= 0.0
            except TypeError:
                good = False
            if not good:
                raise ValueError(f"Friction: {name} is {value!r}; it must be a finite number >= 0")
        if self.dynamic > self.static:
            raise ValueError(f"Friction: dynamic is {self.dynamic!r}; it must not exceed static, {self.static!r}")


def join_tables(surfaces: Sequence[Surface]) -> tuple[list[int], Tables | None]:
    """Join the tables of several surfaces; returns the row of each root, and the tables. A single one is not copied."""
    distinct: list[Surface] = []
    for surface in surfaces:
        if not any(surface is other for other in distinct):
            distinct.append(surface)
    if not distinct:
        return [], None
    if len(distinct) == 1:
        return [0] * len(surfaces), distinct[0].tables
    vertices, triangles, nodes, roots = [], [], [], []
    first_vertex = first_triangle = first_node = 0
    for surface in distinct:
        v, t, n = surface.tables
        t, n = t.copy(), n.copy()
        t[:, :3] += first_vertex
        t[:, NEIGHBOUR:][t[:, NEIGHBOUR:] >= 0] += first_triangle
        for side in range(2):
            is_leaf = n[:, CHILD_COUNT + side] > 0
            n[:, CHILD_REF + side] += np.where(is_leaf, first_triangle, first_node)
        vertices.append(v)
        triangles.append(t)
        nodes.append(n)
        roots.append(first_node)
        first_vertex, first_triangle, first_node = first_vertex + len(v), first_triangle + len(t), first_node + len(n)
    if first_triangle > MAX_TRIANGLES:
        raise ValueError(f"the meshes have {first_triangle} triangles together; at most {MAX_TRIANGLES} are allowed")
    tables = (np.concatenate(vertices), np.concatenate(triangles), np.concatenate(nodes))
    for table in tables:
        table.flags.writeable = False
    return [next(r for r, d in zip(roots, distinct, strict=True) if d is s) for s in surfaces], tables


@dataclass(frozen=True, slots=True)
class Geometry:
    """Shapes of all objects as flat read-only arrays; make one with :meth:`build`.

    Attributes
    ----------
    world
        One row per object, shape (n, layout.WORLD_WIDTH).
    mesh
        Vertices, triangles and hierarchies of all meshes; None without a mesh (the kernels then hold no mesh code).
    """

    world: Floats
    mesh: Tables | None

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
            world[i, layout.WORLD_SIDES] = layout.SOLID
            if isinstance(shape, Mesh):
                if surface.two_sided or shape.surface.two_sided:
                    world[i, layout.WORLD_SIDES] = layout.TWO_SIDED
                elif not shape.surface.is_solid:
                    world[i, layout.WORLD_SIDES] = layout.ONE_SIDED
                world[i, layout.WORLD_SKIN] = shape.surface.skin
                world[i, layout.WORLD_SHADING] = surface.shading  # of a primitive it would take features for triangles
        roots, mesh = join_tables([shape.surface for shape in shapes if isinstance(shape, Mesh)])
        if mesh is not None and world[:, layout.WORLD_SHADING].any():
            mesh = (np.hstack([mesh[0], vertex_normals(mesh[0], mesh[1])]), mesh[1], mesh[2])
            mesh[0].flags.writeable = False
        world[[isinstance(shape, Mesh) for shape in shapes], layout.WORLD_MESH] = roots
        world.flags.writeable = False
        return cls(world=world, mesh=mesh)

    @property
    def count(self) -> int:
        """Number of objects."""
        return int(self.world.shape[0])

    def memory_size(self) -> int:
        """Numbers that one probe remembers between steps."""
        return layout.MEMORY_POSES + 7 * self.count

    def memory_range(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return lower and upper bounds of the numbers in a probe's memory: infinite but for indices and counts."""
        low, high = np.full(self.memory_size(), -np.inf), np.full(self.memory_size(), np.inf)
        objects = slice(layout.MEMORY_CONTACTS, layout.MEMORY_CONTACTS + 2 * layout.MAX_CONTACTS, 2)
        low[[layout.MEMORY_SLIP, layout.MEMORY_COUNT]] = 0
        high[layout.MEMORY_SLIP] = layout.SLIP_SLIDE
        high[layout.MEMORY_COUNT] = layout.MAX_CONTACTS if self.count else 0
        low[objects], high[objects] = (
            -1,
            max(self.count - 1, 0),
        )  # entries that are not in use are 0, also without objects
        return tuple(low.tolist()), tuple(high.tolist())

    def new_memory(self) -> Floats:
        """Return the zeroed memory of one probe: its first step is a reset."""
        return np.zeros(self.memory_size())

    def new_scratch(self) -> tuple[Floats, Floats]:
        """Return what a step, or a search, needs besides its arguments; nothing in it lasts from one to the next."""
        rows = site_rows(self.count)
        return np.zeros((rows, layout.SITE_WIDTH)), np.zeros((self.count, 7))

    def new_result(self) -> Floats:
        """Return the result of one probe before its first step: no contact, nothing near."""
        result = np.zeros(layout.RESULT_SIZE)
        result[[layout.RESULT_PRIMARY, layout.RESULT_NEAREST]] = -1.0
        result[layout.RESULT_DISTANCE] = np.inf
        return result
