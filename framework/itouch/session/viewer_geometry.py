"""What 3-D viewers that open a recording draw of a model: solids, the frames to which they are fixed, forces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from itouch.contact import Box, Capsule, Cylinder, Plane, Sphere
from itouch.plugin import Record, Role
from itouch.recording.views import UNPAINTED, WORLD, Force, Frame, Solid, TemperatureLabel, View, packed
from itouch.session.row_layout import recordable
from itouch.world import Model
from itouch.world.rig import DeviceModel

#: Half side [m] of the square that stands for an infinite plane, its thickness [m], and that of a device's face [m].
_PLANE, _THIN, _FACE = 0.3, 5e-4, 4e-3
#: Greatest number of points of a mesh that is drawn; a larger mesh is drawn as its bounding box.
_MOST_POINTS: Final = 60_000
_DEVICE, _FINGER = (0.45, 0.5, 0.6, 1.0), (0.34, 0.71, 0.91, 0.55)


def view_of(model: Model, state: Record) -> View:
    """Return what is drawn of a session, with the names of the fields of State that move it."""
    frames, solids = [], []
    moves = recordable(state, "objects.pose") if len(model.objects) else False
    for index, name in enumerate(model.objects):
        frame = f"object/{name}" if moves else WORLD
        pose = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) if moves else tuple(state["objects.pose"][index].tolist())
        if moves:
            frames.append(Frame(frame, WORLD, "objects.pose", 7 * index, 7))
        solids += list(_object(model, index, frame, pose))
    for device in model.devices.values():
        frames += list(_frames(model, device, state))
        face = device.surface_half_extents
        if face is not None:
            size, low = (2 * face[0], 2 * face[1], _FACE), (0.0, 0.0, -_FACE / 2, 1.0, 0.0, 0.0, 0.0)
            solids.append(Solid(f"{device.name}/face", _mount(device.name), "box", size, _DEVICE, low))
    forces = []
    for probe in model.probes:
        frames += [Frame(f"{probe.name}/{part}", WORLD, f"{probe.name}.{part}", 0, 3) for part in ("hip", "proxy")]
        radius = max(probe.scene.radius, 0.002)
        solids.append(Solid(probe.name, f"{probe.name}/proxy", "ball", (radius,), _FINGER))
        solids.append(Solid(f"{probe.name}/centre", f"{probe.name}/hip", "ball", (0.3 * radius,), (0.95, 0.45, 0.2, 1)))
        forces.append(Force(f"{probe.name}/force", f"{probe.name}/proxy", f"{probe.name}.contact_force"))
    return View(tuple(frames), tuple(solids), tuple(forces), tuple(_temperature_labels(model, state)))


def _mount(device: str) -> str:
    return f"device/{device}"


def _frames(model: Model, device: DeviceModel, state: Record) -> Iterator[Frame]:
    """Yield the frame of a device, from mount, calibration and carrier, and the frame in which it carries others."""
    parent = _carried(device.carrier) if device.carrier else WORLD
    yield Frame(_mount(device.name), parent, f"{device.name}.calibration", 0, 7, tuple(np.ravel(device.mount).tolist()))
    pose = device.field(Role.TRACKED_POSE)
    if pose in state and device.command(Role.SURFACE_POSE) is not None:
        yield Frame(_carried(device.name), _mount(device.name), pose, 0, 3)


def _carried(device: str) -> str:
    return f"device/{device}/carried"


def _temperature_labels(model: Model, state: Record) -> Iterator[TemperatureLabel]:
    for device in model.devices.values():
        field = device.field(Role.SKIN_CONTACT_TEMPERATURE)
        if field and field in state and np.size(state[field]) == 1:
            yield TemperatureLabel(f"{device.name}/temperature", _mount(device.name), field)


def _object(model: Model, index: int, frame: str, pose: tuple[float, ...]) -> Iterator[Solid]:
    """Yield the solids of an object of the scene."""
    name, shape = model.objects[index], model.shapes[index]
    element = model.scene.objects[index]
    colour, note = _colour(model, element.material), f"material {element.material}" if element.material else ""

    def solid(part: str, kind: str, sizes: tuple[float, ...], where: tuple[float, ...], **more: Any) -> Solid:
        return Solid(f"object/{name}{part}", frame, kind, sizes, colour, where, note=note, **more)

    if isinstance(shape, Box):
        yield solid("", "box", tuple(2 * half for half in shape.half_extents), pose)
    elif isinstance(shape, Sphere):
        yield solid("", "ball", (shape.radius,), pose)
    elif isinstance(shape, (Cylinder, Capsule)):
        yield solid("", "rod", (shape.radius, shape.half_length), pose)
        if isinstance(shape, Capsule) and pose[:3] == (0.0, 0.0, 0.0):
            for word, end in (("/top", shape.half_length), ("/bottom", -shape.half_length)):
                yield solid(word, "ball", (shape.radius,), (0.0, 0.0, end, 1.0, 0.0, 0.0, 0.0))
    elif isinstance(shape, Plane):
        yield solid("", "box", (2 * _PLANE, 2 * _PLANE, _THIN), (*pose[:2], pose[2] - _THIN / 2, *pose[3:]))
    else:
        points, corners = shape.surface.vertices, shape.surface.faces
        if len(points) <= _MOST_POINTS:
            yield solid("", "skin", (), pose, **packed(points, corners))
        else:
            low, high = points.min(0), points.max(0)
            middle = tuple(((low + high) / 2).tolist())
            yield solid("", "box", tuple((high - low).tolist()), (*middle, 1.0, 0.0, 0.0, 0.0))


def _colour(model: Model, material: str) -> tuple[float, ...]:
    found = next((m for m in model.scene.materials if m.name == material), None)
    return (*(found.visual.color if found is not None and found.visual is not None else UNPAINTED), 1.0)
