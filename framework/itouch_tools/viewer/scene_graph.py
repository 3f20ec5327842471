"""Scene graph of one moment: a list of solids with their places and colours, from Model and State alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.contact import Box, Capsule, Cylinder, Plane, Sphere
from itouch.plugin import Record, Role, poses
from itouch.recording.views import ARROW_MAX, ARROW_PER_NEWTON, FORCE_LEAST, UNPAINTED
from itouch.world import Model
from itouch.world.rig import DeviceModel
from itouch_tools.viewer import colours, solids
from itouch_tools.viewer.colours import Colour
from itouch_tools.viewer.finishes import CarvedSurface, Finish, finishes
from itouch_tools.viewer.solids import Solid
from itouch_tools.viewer.temperatures import Range, plate_temperature, skin_temperature

Matrix = NDArray[np.float64]

#: Thickness of a plate as it is drawn, and half the side of one whose face is not stated [m].
PLATE_THICKNESS, PLATE_HALF = 4e-3, 0.03
#: Opacity of a plate while something is touched, so that the object behind it is visible.
SEEN_THROUGH = 0.45
#: The least value [m] to which a small scene reduces the greatest length of a force arrow.
ARROW_LEAST = 0.02
#: With more objects than this, no names are drawn.
NAMED = 16
#: Half the side [m] of the square that stands for an infinite plane.
PLANE_HALF = 0.3


@dataclass(frozen=True, slots=True)
class Draw:
    """One solid to draw: its key in ``SceneGraph.solids``, world matrix (4, 4), colour, opacity, and owner.

    ``owner`` is the name of the object or device that picking finds, empty for marks such as the force arrow;
    ``cast`` says whether it casts a shadow, ``through`` whether it is shown through the objects that hide it;
    ``finish`` and ``carved`` are those of its material.
    """

    solid: str
    matrix: Matrix
    colour: Colour
    opacity: float = 1.0
    owner: str = ""
    gloss: float = 0.25
    cast: bool = True
    through: bool = False
    finish: int = 0
    carved: CarvedSurface | None = None


class SceneGraph:
    """The solids of a model, and where they are in a State."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.solids: dict[str, Solid] = {
            "unit sphere": solids.sphere(1.0),
            "unit box": solids.box((0.5, 0.5, 0.5)),
            "shaft": solids.cylinder(1.0, 0.5),
            "tip": solids.cone(1.0, 1.0),
            "disc": solids.disc(1.0, 0.0, 1.0),
        }
        for name, shape in zip(model.objects, model.shapes, strict=True):
            self.solids[f"object {name}"] = solid_of(shape)
        self._corners = [_corners(self.solids[f"object {name}"], shape)
                         for name, shape in zip(model.objects, model.shapes, strict=True)]  # fmt: skip
        looks, plain = finishes(model), Finish()
        self._looks = {element.name: looks.get(element.material, plain) for element in model.scene.objects}
        self.carved = [look.carved for look in self._looks.values() if look.carved is not None]
        self.range = Range(model)
        self.tables = [d for d in model.devices.values() if d.command(Role.SURFACE_POSE) is not None]
        self.faces = {d.name: f for d in model.devices.values() if (f := d.surface_half_extents) is not None}
        self._bare = [
            d.name for d in self.tables
            if d.name not in self.faces and not any(model.devices[f].carrier == d.name for f in self.faces)
        ]  # fmt: skip
        self._arrow = 0.0

    def bounds(self, state: Record) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the lower and the upper corner (3,) [m] of a box around all objects and fingers."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for turned in self.corners(state):
            low, high = np.minimum(low, turned.min(0)), np.maximum(high, turned.max(0))
        for probe in self.model.probes:
            hip = state[f"{probe.name}.hip"]
            low, high = np.minimum(low, hip - probe.scene.radius), np.maximum(high, hip + probe.scene.radius)
        if not np.isfinite(low).all():
            return np.full(3, -0.1), np.full(3, 0.1)
        return low, high

    def corners(self, state: Record) -> Iterator[NDArray[np.float64]]:
        """Yield the corners (8, 3) [m] of a box around each object, in the order of the model."""
        for corners, pose in zip(self._corners, state["objects.pose"], strict=True):
            yield corners @ poses.matrix(pose[3:]).T + pose[:3]

    def arrow_length(self, state: Record) -> float:
        """Return the greatest length [m] of a force arrow, from the size of the scene when this was first called."""
        if self._arrow == 0.0:
            low, high = self.bounds(state)
            self._arrow = min(ARROW_MAX, max(ARROW_LEAST, 0.4 * float(np.linalg.norm(high - low))))
        return self._arrow

    def draws(self, state: Record, *, thermal: bool = False) -> list[Draw]:
        """Return all that is drawn; ``thermal`` colours objects by their temperature instead of their material."""
        self.range.hold(state, self.model)
        found = [*self._objects(state, thermal), *self._plates(state)]
        for probe in self.model.probes:
            found += self._probe(state, probe.name, probe.scene.radius)
        return found

    def _objects(self, state: Record, thermal: bool) -> Iterator[Draw]:
        ambient = self.model.scene.world.temperature
        for index, element in enumerate(self.model.scene.objects):
            kelvin = ambient if element.temperature is None else element.temperature
            look, place = self._looks[element.name], from_pose(state["objects.pose"][index])
            if thermal:
                look = Finish(self.range.colour(kelvin), carved=look.carved)
            yield Draw(f"object {element.name}", place, look.colour, owner=element.name, finish=look.kind,
                       carved=look.carved)  # fmt: skip

    def _plates(self, state: Record) -> Iterator[Draw]:
        touched = any(int(state[f"{probe.name}.object"]) >= 0 for probe in self.model.probes)
        glass = SEEN_THROUGH if touched else 1.0  # the touched object is visible through the plate that stands for it
        for name in (*self.faces, *self._bare):
            half = self.faces.get(name, (PLATE_HALF, PLATE_HALF))
            place = self.place(state, self.model.devices[name])
            pose = self.model.devices[name].field(Role.TRACKED_POSE)
            if name in self._bare and pose in state:
                place = place @ shift(state[pose][:3])
            kelvin = plate_temperature(state, self.model.devices[name])
            colour = UNPAINTED if kelvin is None else self.range.colour(kelvin)
            yield Draw("unit box", place @ shift((0, 0, -PLATE_THICKNESS / 2)) @ scale((2 * half[0], 2 * half[1],
                       PLATE_THICKNESS)), colour, glass, name, gloss=0.5, through=True)  # fmt: skip
            carrier = (0.35, 0.37, 0.42)
            size = (2 * half[0] + 0.012, 2 * half[1] + 0.012, 0.008)
            yield Draw("unit box", place @ shift((0, 0, -PLATE_THICKNESS - 0.004)) @ scale(size), carrier, glass, name)

    def place(self, state: Record, device: DeviceModel) -> Matrix:
        """Return the matrix (4, 4) of a device's frame in the world, from its mount, calibration and carrier."""
        own = from_pose(np.asarray(device.mount)) @ from_pose(state[f"{device.name}.calibration"])
        if not device.carrier:
            return own
        below = self.place(state, self.model.devices[device.carrier])
        pose = self.model.devices[device.carrier].field(Role.TRACKED_POSE)
        return below @ shift(state[pose][:3]) @ own if pose in state else below @ own

    def _probe(self, state: Record, name: str, radius: float) -> Iterator[Draw]:
        hip, proxy = state[f"{name}.hip"], state[f"{name}.proxy"]
        drawn = max(radius, 0.002)
        skin = skin_temperature(state, self.model)
        touching = int(state[f"{name}.object"]) >= 0
        pad = self.range.colour(skin) if skin is not None else colours.PROXY
        yield Draw("unit sphere", shift(proxy) @ scale((drawn,) * 3), pad, 0.55, gloss=0.6)
        yield Draw("unit sphere", shift(hip) @ scale((drawn * 0.45,) * 3), colours.HIP, gloss=0.6)
        if touching:
            point = state[f"{name}.point"]
            yield Draw("disc", along(state[f"{name}.normal"], point + 3e-4 * state[f"{name}.normal"]) @ scale(
                (0.004, 0.004, 1.0)), colours.FORCE, cast=False)  # fmt: skip
        yield from arrow(proxy, state[f"{name}.contact_force"], self.arrow_length(state) / ARROW_MAX)


def _corners(solid: Solid, shape: Any) -> NDArray[np.float64]:
    """Return the corners (8, 3) of the box around a solid; of a plane only the middle fifth counts."""
    ends = np.stack([solid.positions.min(0), solid.positions.max(0)]).astype(np.float64)
    if isinstance(shape, Plane):
        ends *= 0.2
    return np.array([[ends[i >> axis & 1, axis] for axis in range(3)] for i in range(8)])


def solid_of(shape: Any) -> Solid:
    """Return the triangles of a shape of the contact engine."""
    if isinstance(shape, Box):
        return solids.box(shape.half_extents)
    if isinstance(shape, Sphere):
        return solids.sphere(shape.radius)
    if isinstance(shape, Capsule):
        return solids.capsule(shape.radius, shape.half_length)
    if isinstance(shape, Cylinder):
        return solids.cylinder(shape.radius, shape.half_length)
    if isinstance(shape, Plane):
        flat = solids.box((PLANE_HALF, PLANE_HALF, 5e-4))
        return Solid(flat.positions - np.array([0, 0, 5e-4], np.float32), flat.normals, flat.faces)
    return solids.from_mesh(shape.surface.vertices, shape.surface.faces)


def arrow(start: NDArray[np.float64], force: NDArray[np.float64], factor: float = 1.0) -> Iterator[Draw]:
    """Yield the solids of the arrow of a force (3,) [N] that begins at a point (3,) [m]; none below `FORCE_LEAST`.

    ``factor`` makes it smaller for small scenes.
    """
    size = float(np.linalg.norm(force))
    if size < FORCE_LEAST:
        return
    length = factor * min(ARROW_MAX, ARROW_PER_NEWTON * size)
    tip = min(0.35 * length, 0.008 * factor)
    frame = along(force / size, start)
    middle = shift((0, 0, (length - tip) / 2))
    thin, wide = 0.0012 * factor, 0.003 * factor
    yield Draw("shaft", frame @ middle @ scale((thin, thin, length - tip)), colours.FORCE, cast=False)
    yield Draw("tip", frame @ shift((0, 0, length - tip)) @ scale((wide, wide, tip)), colours.FORCE, cast=False)


def from_pose(pose: NDArray[np.float64]) -> Matrix:
    """Return the matrix (4, 4) of a pose (7,): position [m], quaternion w, x, y, z."""
    matrix = np.eye(4)
    matrix[:3, :3] = poses.matrix(pose[3:].tolist())
    matrix[:3, 3] = pose[:3]
    return matrix


def shift(offset: Any) -> Matrix:
    """Return the matrix (4, 4) that moves by an offset (3,)."""
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def scale(factors: tuple[float, float, float]) -> Matrix:
    """Return the matrix (4, 4) that scales along the three axes."""
    return np.diag((*factors, 1.0))


def along(direction: NDArray[np.float64], origin: NDArray[np.float64]) -> Matrix:
    """Return a frame (4, 4) at ``origin`` (3,) [m] whose z axis points along a unit vector (3,)."""
    helper = np.array([1.0, 0.0, 0.0]) if abs(direction[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(helper, direction)
    size = float(np.linalg.norm(x))
    if size == 0.0:
        return shift(origin)
    x = x / size
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = x, np.cross(direction, x), direction, origin
    return matrix
