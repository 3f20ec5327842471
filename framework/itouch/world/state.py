"""The layout of State: one packed record of everything that changes, put together from what each part declares."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace

from itouch.contact.surfaces import EFFECTS_MEMORY
from itouch.plugin import Field, Record
from itouch.world import marks
from itouch.world.failing import failing
from itouch.world.model import Model
from itouch.world.rig import DeviceModel
from itouch.world.supervision import supervision

#: The range of what must be a number.
_FINITE = (-sys.float_info.max, sys.float_info.max)
#: How many contact events are remembered in State.
EVENTS = 64
#: One remembered event.
EVENT_DTYPE = [
    ("kind", "i8"),
    ("tick", "i8"),
    ("probe", "i8"),
    ("object", "i8"),
    ("point", "f8", 3),
    ("normal", "f8", 3),
    ("distance", "f8"),
    ("speed", "f8"),
    ("tangential_velocity", "f8", 3),
    ("penetration", "f8"),
    ("force", "f8"),
    ("time_to_contact", "f8"),
    ("area", "f8"),
]


def layout(model: Model) -> tuple[Field, ...]:
    """Return all fields of the State of a model, in order."""
    count = len(model.objects)
    fields: list[Field] = [
        Field("tick", "i8", low=0), Field("seed", "u8"), Field("ready", "i8", low=0, high=1), Field("hold", "i8")
    ]  # fmt: skip
    fields += [Field("objects.pose", "f8", (count, 7)), Field("objects.twist", "f8", (count, 6))]
    if model.moving:
        fields.append(Field("objects.ticks", "i8", low=0))
    if model.motions.bodies is not None:
        fields.append(Field("objects.physics", "f8", model.motions.bodies.state_size))
    for device in model.devices.values():
        with failing(f"device '{device.name}'", "its twin's fields", model.place_of(device.name)):
            fields += _device(device)
    for probe in model.probes:
        fields += _prefixed(probe.name, _probe(count))
        low, high = model.geometry.memory_range()
        fields.append(Field(f"{probe.name}.memory", "f8", model.memory_size, low, high))
        fields.append(Field(f"{probe.name}.result", "f8", model.result_size))
        if any(effects.any for effects in probe.effects):
            fields.append(Field(f"{probe.name}.effects", "f8", EFFECTS_MEMORY))
        if probe.operator is not None:
            fields += _prefixed(f"{probe.name}.hand", _HAND)
    for modality in model.modalities:
        with failing(f"modality '{modality.name}'", "fields", model.place_of(modality.name)):
            fields += _prefixed(modality.name, modality.instance.fields(modality.model))
    fields += [Field("events.count", "i8", low=0), Field("events.table", EVENT_DTYPE, EVENTS), *marks.FIELDS]
    return tuple(fields)


def _prefixed(prefix: str, fields: Iterable[Field]) -> list[Field]:
    return [replace(field, name=f"{prefix}.{field.name}") for field in fields]


#: The figures that one tick writes, in the order of ``itouch.loop.render``.
_FIGURES = (
    Field("hip", "f8", 3),
    Field("velocity", "f8", 3),
    Field("proxy", "f8", 3),
    Field("force", "f8", 3),
    Field("normal", "f8", 3),
    Field("point", "f8", 3),
    Field("penetration"),
    Field("normal_force"),
    Field("near_distance"),
    Field("time_to_contact"),
    Field("contact_force", "f8", 3),
    Field("effect_force", "f8", 3),
    Field("area"),
    Field("plate_gap"),
    Field("surface_height"),
    Field("plate_yield"),
    Field("plate_top"),
    Field("tracking"),
)


def _probe(objects: int) -> tuple[Field, ...]:
    """Return the State of a probe in a scene of so many objects."""
    which = ("object", "near_object")
    return (
        *_FIGURES,
        *(Field(name, "i8", low=-1, high=objects - 1) for name in which),
        Field("plate", "i8"),
        Field("contact.object", "i8", low=-1, high=objects - 1),
        *_CONTACT,
    )


#: The open contact, and the true plate under a finger's twin, in the order of ``itouch.twin.mechanics``.
_CONTACT = (
    Field("contact.begin", "i8"),
    Field("contact.separated", "i8"),
    Field("contact.plate", "i8"),
    Field("contact.plate_gap"),
    Field("contact.peak_force"),
    Field("contact.peak_penetration"),
    Field("contact.peak_area"),
    Field("contact.impact_speed"),
    Field("contact.physical_begin", "i8"),
    Field("plate_touched", "i8"),
    Field("plate_force"),
    Field("plate_true_top"),
    Field("plate_distance"),
    Field("total_force"),
)

_HAND = (
    Field("position", "f8", 3),
    Field("velocity", "f8", 3),
    Field("target", "f8", 3),
    Field("ticks", "i8", low=0),
    Field("offset", "f8", 3),
    Field("steered", "i8"),
    Field("wanted", "f8", 3),
)


def _device(device: DeviceModel) -> list[Field]:
    name = device.name
    fields = [Field(f"{name}.{channel.name}", "f8", channel.size) for channel in device.reads]
    fields += [Field(f"{name}.command.{channel.name}", "f8", channel.size) for channel in device.commands]
    fields += [Field(f"{name}.sent.{channel.name}", "f8", channel.size, *_FINITE) for channel in device.commands]
    fields += _prefixed(name, supervision(device.reads, device.commands))
    fields += _stamps(device)
    if device.touch_off:
        fields += _prefixed(
            f"{name}.touch_off",
            (
                Field("stage", "i8", low=0, high=3),
                Field("point", "i8", low=0, high=device.touch_off),
                Field("sums", "f8", 5),
                Field("offsets", "f8", device.touch_off),
                Field("target"),
            ),
        )
    if device.twin:
        fields += _prefixed(f"{name}.twin", device.make_twin().fields())
    return fields


def _stamps(device: DeviceModel) -> list[Field]:
    """Return the times of what passes between loop and device: the one place where they are kept.

    ``measured`` has the tick at which each channel of the newest reading was measured, in the order of the reads; by
    ``age`` only the device's silence is counted, from when that reading came.  Behind a wire ``out`` is the newest
    command that has left, and ``left`` the tick in which it did.
    """
    name, fields = device.name, [Field(f"{device.name}.measured", "i8", max(1, len(device.reads)))]
    if device.wire:
        fields.append(Field(f"{name}.left", "i8"))
        fields += [Field(f"{name}.out.{c.name}", "f8", c.size, *_FINITE) for c in device.commands]
    return fields


def make_state(model: Model) -> Record:
    """Return a zeroed State for a model.

    Raises
    ------
    ValueError
        If two parts declare the same field.
    """
    return Record.of(layout(model))
