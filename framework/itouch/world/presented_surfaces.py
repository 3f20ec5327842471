"""Surfaces that are brought to fingers, and whether modalities' claims about theirs, or about contacts, can hold."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from itouch.contact import layout
from itouch.plugin import ContactFields, Role, SurfaceFields, WorldSurface
from itouch.plugin.carried_surfaces import ROOM
from itouch.scene import Scene
from itouch.scene.elements import Operator, PluginPart
from itouch.schema import Problem
from itouch.schema.diagnostics import did_you_mean
from itouch.schema.fields import xml_name
from itouch.world.limits import PLATE_FORCE
from itouch.world.rig import DeviceModel

#: Attributes of a probe that say how the default modality carries a surface; others may keep to them.
_OWN = ("clearance", "plate_angle")
#: Kind and size of a field that holds one number.
_ONE = (("f8", 0), ("f8", 1), ("i8", 0), ("i8", 1))
#: Stiffness [N/m] and damping [N s/m] of a finger's pad if nothing is known of it.
PAD_STIFFNESS, PAD_DAMPING = 1e3, 2.0


def touched_device_of(table: str, devices: Mapping[str, DeviceModel]) -> str:
    """Return the device on a table that the finger touches: the one that reads the temperature there, else the first.

    If the table carries nothing, it is the table itself.
    """
    carried = [device for device in devices.values() if device.carrier and device.carrier == table]
    touched = [d for d in carried if any(c.role is Role.SKIN_CONTACT_TEMPERATURE for c in d.reads)]
    return next((device.name for device in (*touched, *carried)), table)


def surfaces_of(
    scene: Scene, devices: Mapping[str, DeviceModel], operators: Mapping[str, Operator | None]
) -> dict[str, WorldSurface]:
    """Return the surface that is brought to each probe that is met by one; ``operators``: of each probe, None: none.

    A finger is what one device tracks, however many probes it has: its pad is that of the operator of any of them, and
    the surfaces that are brought to it share the force that may press on it.
    """
    found = {}
    for probe in scene.probes:
        table, arm = devices.get(probe.surface_to), devices.get(probe.force_to)
        if table is None:
            continue
        same = [other for other in scene.probes if other.pose_from == probe.pose_from]
        people = [operators.get(one.name) for one in (probe, *same)]
        pads = ((person.pad_stiffness, person.pad_damping) for person in people if person is not None)
        stiffness, damping = next(pads, (PAD_STIFFNESS, PAD_DAMPING))
        most = min(table.limits.plate_force or PLATE_FORCE, (arm.limits.force if arm is not None else None) or math.inf)
        count = len({other.surface_to for other in same if other.surface_to in devices})
        if count > 1:
            together = min(one.limits.finger_force for one in (arm, table) if one is not None)
            most = min(most, max(0.0, together - ROOM)) / count
        face = devices[touched_device_of(table.name, devices)]
        x, y, z = face.mount[:3] if face is not table else (0.0, 0.0, 0.0)
        found[probe.name] = WorldSurface(
            table.name, arm.name if arm is not None else "", (x, y, z), stiffness, damping, bool(table.touch_off), most,
            probe.clearance, probe.plate_angle,
        )  # fmt: skip
    return found


def check_carried(
    scene: Scene, part: PluginPart, carries: SurfaceFields, fields: Mapping[str, object], commands: Sequence[str],
    devices: Mapping[str, DeviceModel], every: int, probe_attributes: Collection[str],
) -> Iterator[Problem]:  # fmt: skip
    """Find what keeps a modality from carrying the surface that it says it carries.

    ``fields``: kinds and sizes; ``probe_attributes``: the attributes of the probe that it follows.
    """
    who, place = f"modality '{part.name}'", scene.places.of(part)
    probe = next((one for one in scene.probes if one.name == carries.probe), None)
    if probe is None or probe.surface_to != carries.device:
        found = "there is no such probe" if probe is None else f"its surface-to is '{probe.surface_to}'"
        sentence = f"{who} carries the surface of '{carries.device}' to probe '{carries.probe}', but {found}"
        advice = f'write surface-to="{carries.device}" at the probe that the modality names'
        yield Problem("modality", sentence, place, advice)
        return
    device = devices.get(carries.device)
    channel = device.command(Role.SURFACE_POSE) if device is not None else None
    if channel is not None and f"{carries.device}.{channel.name}" not in commands:
        sentence = f"{who} carries the surface of '{carries.device}', but does not command '{channel.name}'"
        yield Problem("modality", sentence, place, f"its commands must have {carries.device}.{channel.name}")
    for name in carries.declared:
        if fields.get(name) not in _ONE:
            sentence = (
                f"{who} says how its surface stands in field '{name}', which it does not declare as one number (f8)"
            )
            yield Problem("modality", sentence, place, f"it declares {', '.join(fields) or 'none'}")
    if every != 1:
        sentence = f"{who} carries a surface, which moves in every tick, but is updated in one of {every}"
        yield Problem("modality", sentence, place, "leave its rate out of <rates>")
    for name in _OWN:
        written = scene.places.of(probe, name)
        if written is not None and written != scene.places.of(probe):
            shown = xml_name(name)
            if shown in probe_attributes:
                continue
            sentence = f"{shown} of probe '{probe.name}' has no effect: {who} carries its surface"
            yield Problem("modality", sentence, written, f"remove {shown}", severity="warning")


def _fields_of(count: int) -> tuple[object, ...]:
    """Return the kinds and sizes of a field that holds so many numbers."""
    return ("f8", count), ("f8", (count,)), ("f8", 0 if count == 1 else count)


def check_touched(
    scene: Scene, part: PluginPart, touches: ContactFields, fields: Mapping[str, object], every: int, carries: bool
) -> Iterator[Problem]:
    """Find what keeps a modality from computing the contact that it says it computes.

    ``fields``: kinds and sizes; ``every``: in one of how many ticks it is updated; ``carries``: it also says that it
    brings a surface.
    """
    who, place = f"modality '{part.name}'", scene.places.of(part)
    names = [probe.name for probe in scene.probes]
    if touches.probe not in names:
        sentence = f"{who} computes the contact of probe '{touches.probe}', but there is no such probe"
        yield Problem("modality", sentence, place, did_you_mean(touches.probe, names, "the probes are"))
        return
    if not touches.found and not all(touches[1:5]):
        lacks = ", ".join(name for name, field in zip(touches._fields[1:5], touches[1:5], strict=True) if not field)
        sentence = f"{who} computes a contact and names no field for: {lacks}"
        yield Problem("modality", sentence, place, "its touches names those, or found")
    if touches.found and (also := [name for name in touches[1:6] if name]):
        sentence = f"{who} says what it touches twice: in field '{touches.found}', and in {', '.join(also)}"
        yield Problem("modality", sentence, place, "its touches names object, force, normal and point, or else found")
    sizes = {"object": 1, "found": layout.RESULT_SIZE}
    for kind, name in zip(touches._fields[1:7], touches[1:7], strict=True):
        if name and fields.get(name) not in _fields_of(count := sizes.get(kind, 3)):
            what = f"{count} number{'s' if count > 1 else ''} (f8)"
            sentence = f"{who} says what it touches in field '{name}', which it does not declare as {what}"
            yield Problem("modality", sentence, place, f"it declares {', '.join(fields) or 'none'}")
    if every != 1:
        sentence = f"{who} computes a contact, which changes in every tick, but is updated in one of {every}"
        yield Problem("modality", sentence, place, "leave its rate out of <rates>")
    if carries:
        sentence = f"{who} computes a contact and brings a surface, which happens at different times in a tick"
        yield Problem("modality", sentence, place, "its author makes it two modalities")


def check_alone(scene: Scene, known: Iterable[tuple[str, ContactFields]]) -> Iterator[Problem]:
    """Find probes whose contact two modalities compute; ``known``: modalities by name, with their declarations."""
    first: dict[str, str] = {}
    for name, touches in known:
        other = first.setdefault(touches.probe, name)
        if other != name:
            sentence = f"modalities '{other}' and '{name}' both compute the contact of probe '{touches.probe}'"
            part = next(part for part in scene.modalities if part.name == name)
            yield Problem("modality", sentence, scene.places.of(part), "remove one of them")
