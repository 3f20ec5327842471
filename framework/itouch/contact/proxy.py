"""The proxy by itself: one probe on stationary surfaces, positions in, forces out."""

import math
from collections.abc import Iterable
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from itouch.contact import layout as at
from itouch.contact.geometry_tables import Friction, Geometry
from itouch.contact.mesh_surface import Surface, checked_numbers
from itouch.contact.shapes import Mesh, Shape
from itouch.contact.step import follow_path, step
from itouch.contact.vectors import Floats


def _checked(name: str, value: float) -> float:
    """Return an argument as a float; raises ValueError unless it is a finite number >= 0."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number >= 0.0):
        raise ValueError(f"{name} is {value!r}; it must be a finite number >= 0")
    return number


def _shapes(surfaces: Surface | Shape | Iterable[Surface | Shape]) -> list[Shape]:
    """Return surfaces as shapes; raises ValueError when there is none, or one is neither a surface nor a shape."""
    known = (Surface, *get_args(Shape))
    try:
        given: list[Any] = [surfaces] if isinstance(surfaces, known) else list(surfaces)  # type: ignore[arg-type]
    except TypeError:
        raise ValueError(f"surfaces is {surfaces!r}; it must be a surface, or several") from None
    if not given:
        raise ValueError("surfaces is empty; a proxy needs at least one surface")
    for index, surface in enumerate(given):
        if not isinstance(surface, known):
            raise ValueError(f"surfaces[{index}] is of type {type(surface).__name__}; it must be a Surface or a shape")
    return [Mesh(surface) if isinstance(surface, Surface) else surface for surface in given]


class Proxy:
    """The god-object of a spherical probe on stationary surfaces, with friction.

    Parameters
    ----------
    surfaces
        One or several surfaces or shapes, all in world coordinates.
    radius
        Radius of the probe's sphere [m]; 0 is a point.
    stiffness
        Stiffness of the spring between proxy and HIP [N/m].
    static_friction, dynamic_friction
        Coulomb coefficients; dynamic must not exceed static.
    shading
        Turn the force of meshes to their vertex normals, so that facets feel smooth.

    Raises
    ------
    ValueError
        If a number is out of its range, or there is no surface.
    """

    __slots__ = ("_arguments", "_hip", "_memory", "_result", "geometry", "radius", "stiffness")

    def __init__(
        self,
        surfaces: Surface | Shape | Iterable[Surface | Shape],
        *,
        radius: float = 0.0,
        stiffness: float = 1000.0,
        static_friction: float = 0.0,
        dynamic_friction: float = 0.0,
        shading: bool = False,
    ) -> None:
        shapes = _shapes(surfaces)
        radius, stiffness = _checked("radius", radius), _checked("stiffness", stiffness)
        static, dynamic = _checked("static_friction", static_friction), _checked("dynamic_friction", dynamic_friction)
        if dynamic > static:
            raise ValueError(f"dynamic_friction is {dynamic!r}; it must not exceed static_friction, {static!r}")
        friction = Friction(static, dynamic, shading=shading)
        self.geometry = Geometry.build(shapes, [friction] * len(shapes))
        self.radius, self.stiffness = radius, stiffness
        self._memory, self._result = self.geometry.new_memory(), self.geometry.new_result()
        self._hip = np.zeros(3)
        poses = np.tile(np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), (len(shapes), 1))
        twists, stiffnesses = np.zeros((len(shapes), 6)), np.full(len(shapes), self.stiffness)
        self._arguments = (self.geometry.world, self.geometry.mesh, poses, twists, stiffnesses)

    def step(self, hip: ArrayLike) -> Floats:
        """Move the HIP (3,) [m]; returns the force on the operator (3,) [N]. The first step equals ``reset(hip)``.

        As a tracker may lose its finger in a session, a HIP that is not finite is no error: it gives no force and no
        contact, and leaves the proxy where it is.
        """
        try:
            place = np.asarray(hip, dtype=np.float64)
        except (TypeError, ValueError):
            place = checked_numbers("hip", hip)
        if place.shape != (3,):
            raise ValueError(f"hip has shape {place.shape}; it must be (3,)")
        self._hip[:] = place
        step(*self._arguments, self._hip, self.radius, 0.0, self._memory, self._result)
        return self._result[:3].copy()

    def follow(self, hips: ArrayLike) -> Floats:
        """Step along a path (n, 3) [m] in compiled code, from the present state; returns the forces (n, 3) [N].

        A HIP that is not finite is as in ``step``.
        """
        path = checked_numbers("hips", hips)
        if path.ndim != 2 or path.shape[1] != 3:
            raise ValueError(f"hips has shape {path.shape}; it must be (n, 3)")
        forces = np.empty_like(path)
        follow_path(*self._arguments, path, self.radius, self._memory, self._result, forces)
        return forces

    def reset(self, hip: ArrayLike) -> Floats:
        """Forget the past: the proxy starts at the HIP (3,) [m], or, inside a solid, at the nearest free point.

        Returns the force on the operator (3,) [N].
        """
        self._memory[:] = 0.0
        return self.step(hip)

    @property
    def position(self) -> Floats:
        """Centre of the proxy (3,) [m]."""
        return self._result[at.RESULT_PROXY : at.RESULT_PROXY + 3].copy()

    @property
    def normal(self) -> Floats:
        """Direction of the normal force (3,), out of what is touched; zero without contact."""
        return self._result[at.RESULT_NORMAL : at.RESULT_NORMAL + 3].copy()

    @property
    def in_contact(self) -> bool:
        """Whether the probe touches anything."""
        return bool(self._result[at.RESULT_COUNT] > 0.0)
