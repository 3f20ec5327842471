"""A probe on one or several objects in any pose, seen from the objects' own frame; and the shapes that are hard."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from itouch.contact import Friction, Geometry, Mesh, Shape, Surface
from itouch.contact import layout as at
from itouch.contact.step import step

Floats = NDArray[np.float64]
STILL = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def rotation(q: Floats) -> Floats:
    """Matrix of a unit quaternion w, x, y, z."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def random_pose(rng: np.random.Generator, size: float) -> Floats:
    """Pose with a rotation of any kind."""
    q = rng.normal(size=4)
    return np.concatenate([rng.normal(size=3) * size, q / np.linalg.norm(q)])


class Probe:
    """One probe and some objects that share one pose; places and directions are in their common frame."""

    def __init__(
        self,
        shapes: Shape | Sequence[Shape],
        *,
        radius: float,
        friction: tuple[float, float] = (0.0, 0.0),
        pose: Floats = STILL,
        near: float = 0.0,
        stiffness: float = 1.0,
    ) -> None:
        shapes = list(shapes) if isinstance(shapes, Sequence) else [shapes]
        self.geometry = Geometry.build(shapes, [Friction(*friction)] * len(shapes))
        self.radius, self.near = float(radius), float(near)
        self.matrix, self.origin = rotation(pose[3:]), pose[:3]
        self.poses = np.tile(pose, (len(shapes), 1))
        self.twists = np.zeros((len(shapes), 6))
        self.stiffness = np.full(len(shapes), stiffness)
        self.memory, self.result = self.geometry.new_memory(), self.geometry.new_result()

    def __call__(self, hip: Floats | Sequence[float]) -> Floats:
        """Step with the HIP there; returns the proxy's place."""
        world = self.matrix @ np.asarray(hip, dtype=float) + self.origin
        step(self.geometry.world, self.geometry.mesh, self.poses, self.twists, self.stiffness, world, self.radius,
             self.near, self.memory, self.result)  # fmt: skip
        return self.proxy

    @property
    def proxy(self) -> Floats:
        """Place of the proxy."""
        return np.asarray(self.matrix.T @ (self.result[at.RESULT_PROXY : at.RESULT_PROXY + 3] - self.origin))

    @property
    def force(self) -> Floats:
        """Force on the operator."""
        return np.asarray(self.matrix.T @ self.result[at.RESULT_FORCE : at.RESULT_FORCE + 3])

    @property
    def normal(self) -> Floats:
        """Direction of the normal force."""
        return np.asarray(self.matrix.T @ self.result[at.RESULT_NORMAL : at.RESULT_NORMAL + 3])

    @property
    def contacts(self) -> int:
        """Contacts of the last step."""
        return int(self.result[at.RESULT_COUNT])

    @property
    def slip(self) -> int:
        """Stick or slide."""
        return int(self.result[at.RESULT_SLIP])

    def in_cone(self, friction: float) -> bool:
        """Whether the force is inside the friction cone about the normal force."""
        push = float(self.force @ self.normal)
        sideways = float(np.linalg.norm(self.force - push * self.normal))
        return sideways <= friction * push * (1 + 1e-6) + 1e-12


def quads(*corners: Sequence[Sequence[float]]) -> tuple[Floats, NDArray[np.int32]]:
    """Triangles of several quadrilaterals, each with corners of its own."""
    vertices = np.array(corners, dtype=float).reshape(-1, 3)
    faces = [(4 * i + a, 4 * i + b, 4 * i + c) for i in range(len(corners)) for a, b, c in ((0, 1, 2), (0, 2, 3))]
    return vertices, np.array(faces, dtype=np.int32)


def box_mesh(x: float, y: float, z: float) -> tuple[Floats, NDArray[np.int32]]:
    """Twelve triangles of a box with these half extents."""
    vertices = np.array([[a, b, c] for a in (-x, x) for b in (-y, y) for c in (-z, z)])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [(s[0], s[i], s[i + 1]) for s in sides for i in (1, 2)]
    return vertices, np.array(faces, dtype=np.int32)


def grid(cells: int, side: float = 1.0) -> tuple[Floats, NDArray[np.int32]]:
    """Flat square about the origin in z = 0, front up."""
    line = np.linspace(-side / 2, side / 2, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    i, j = (index.ravel() for index in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    a, b = i * (cells + 1) + j, (i + 1) * (cells + 1) + j
    faces = np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)])
    return np.stack([x, y, 0 * x], -1).reshape(-1, 3), faces.astype(np.int32)


def needle() -> tuple[Floats, NDArray[np.int32]]:
    """Cone of height 1 with twelve sides and a base of radius 0.01."""
    angle = np.arange(12) * np.pi / 6
    ring = np.stack([0.01 * np.cos(angle), 0.01 * np.sin(angle), 0 * angle], 1)
    faces = [(i, (i + 1) % 12, 12) for i in range(12)] + [((i + 1) % 12, i, 13) for i in range(12)]
    return np.concatenate([ring, [[0, 0, 1.0], [0, 0, 0]]]), np.array(faces, dtype=np.int32)


def winding(surface: Surface, p: Floats) -> float:
    """Winding number of a closed surface about a point: 1 inside, 0 outside (van Oosterom and Strackee 1983)."""
    vertices, triangles, _ = surface.tables
    a, b, c = (vertices[triangles[:, i]] - p for i in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))
    rest = la * lb * lc + np.einsum("ni,ni->n", a, b) * lc + np.einsum("ni,ni->n", b, c) * la
    return float(2 * np.arctan2(volume, rest + np.einsum("ni,ni->n", c, a) * lb).sum() / (4 * np.pi))


def mesh(vertices: Floats, faces: NDArray[np.int32], size: float, two_sided: bool = False) -> Mesh:
    """Scaled surface as a shape."""
    return Mesh(Surface(vertices * size, faces, two_sided))
