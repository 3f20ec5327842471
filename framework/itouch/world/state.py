"""The layout of State: one packed record of everything that changes, put together from what each part declares."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace

from itouch.contact.surface_effects import EFFECTS_MEMORY
from itouch.moved import HasOldNames
from itouch.plugin import Field, Record, Role
from itouch.plugin.declaration_rules import faults_of
from itouch.schema import Problem, SceneError
from itouch.schema.hold_until import Until
from itouch.world import mark_fields
from itouch.world.model import Model, ProbeModel
from itouch.world.rig import FRAME, GONE, DeviceModel
from itouch.world.state_fields import (
    CELLS,
    HAND,
    coupling_fields,
    probe_fields,
    rising_fields,
    skin_fields,
    stiffness_fields,
    wait_fields,
)
from itouch.world.supervision import supervision

#: The range of what must be a finite number.
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

_FRAME = Field(
    FRAME, "f8", 12, unit="mixed",
    doc="where the device's frame is in the world, after touch-off and on its carrier: origin [m], rotation matrix row "
    "by row",
)  # fmt: skip

_EVENTS = (
    f"the last {EVENTS}: kind (0 near, 1 begin, 2 move, 3 end), tick, probe, object, point [m], normal, distance [m], "
    "speed [m/s], tangential_velocity [m/s], penetration [m], force [N], time_to_contact [s], area [m2]"
)
#: Fields of the session: its time, its seed, and what holds for all devices.
_SESSION = (
    Field("tick", "i8", low=0, unit="tick", doc="ticks since the start; a tick lasts 1 / `<rates servo>`"),
    Field("seed", "u8", unit="1", doc="seed of all noise"),
    Field(
        "ready", "i8", low=0, high=1, unit="1", doc="1 when calibration at the start is done and the motion has begun"
    ),
    Field("hold", "i8", unit="tick", doc="until when the dead-man's switch counts as held"),
    Field("stopping", "i8", low=0, high=1, unit="1", doc="1 while the safe sequence is under way"),
)
_CONTACT_EVENTS = (
    Field(
        "events.count", "i8", low=0, unit="1",
        doc="contact events so far; the newest is at (count - 1) mod 64 of the table",
    ),
    Field("events.table", EVENT_DTYPE, EVENTS, unit="mixed", doc=_EVENTS),
)  # fmt: skip


def layout(model: Model) -> tuple[Field, ...]:
    """Return all fields of the State of a model, in order."""
    fields: list[Field] = [*_SESSION, *_objects(model)]
    for device in model.devices.values():
        fields += _device(device, device.name in model.framed)
    for probe in model.probes:
        fields += _probe(model, probe)
    for modality in model.modalities:
        fields += _prefixed(modality.name, modality.declared)
    fields += [*_CONTACT_EVENTS, *mark_fields.FIELDS]
    return tuple(fields)


def _objects(model: Model) -> list[Field]:
    """Return the fields of the objects: where they are, and what moves them."""
    count, where = len(model.objects), "position and quaternion w x y z of each object in the world"
    fields = [
        Field("objects.pose", "f8", (count, 7), unit="m", doc=where),
        Field("objects.twist", "f8", (count, 6), unit="m/s", doc="linear and angular velocity of each object"),
    ]
    if model.moving:
        what = "how long the scripts of moving objects have run"
        fields.append(Field("objects.ticks", "i8", low=0, unit="tick", doc=what))
    if model.motions.bodies is not None:
        what = "state of the rigid bodies, as MuJoCo integrates it"
        fields.append(Field("objects.physics", "f8", model.motions.bodies.state_size, unit="mixed", doc=what))
    return fields


def _probe(model: Model, probe: ProbeModel) -> list[Field]:
    """Return the fields of a probe: what it renders and remembers, and the hand and finger that lead it."""
    name = probe.name
    fields = _own(name, probe_fields(len(model.objects), carried=name in model.surfaces))
    low, high = model.geometry.memory_range()
    what = "what the contact search remembers from one tick to the next"
    fields.append(Field(f"{name}.memory", "f8", model.memory_size, low, high, unit="mixed", doc=what))
    what = "what the contact search found in this tick"
    fields.append(Field(f"{name}.result", "f8", model.result_size, unit="mixed", doc=what))
    if any(effects.any for effects in probe.effects):
        what = "what the effects of the surfaces remember"
        fields.append(Field(f"{name}.effects", "f8", EFFECTS_MEMORY, unit="mixed", doc=what))
    if model.contact_of(name) is not None:
        fields += _own(name, stiffness_fields(len(model.objects)))
    if probe.relied is not None:
        fields += _own(name, coupling_fields(len(model.objects)))
    surface = model.surfaces.get(name)
    if surface is not None and model.devices[surface.device].wire:
        fields += _own(name, rising_fields())
    if probe.operator is not None:
        fields += _own(f"{name}.hand", HAND)
        if waits := sum(isinstance(target.hold, Until) for target in probe.operator.motion.targets):
            fields += _own(f"{name}.hand", wait_fields(waits))
        if beside := model.beside(probe):
            what = "what arm and plate of each other probe on its finger push it with, world frame"
            fields.append(Field(f"{name}.pushed", "f8", (beside, 3), unit="N", doc=what, show="no"))
        if worn := model.worn(probe):
            fields += _own(name, skin_fields(len(worn), CELLS))
    return fields


def declared(model: Model) -> Mapping[str, Field]:
    """Return the declaration of every field of State, by name, in order; it is put together once for each model."""
    if not model.declared:
        model.declared.append({field.name: field for field in layout(model)})
    found: Mapping[str, Field] = model.declared[0]
    return found


def truth(model: Model, device: str, role: Role) -> str:
    """Return the field in which a device's twin keeps the true value of a role, beside its sensors; empty: none."""
    own, faults = f"{device}.twin.", f"{device}.twin.fault."
    named = (name for name, field in declared(model).items() if field.role is role and name.startswith(own))
    return next((name for name in named if not name.startswith(faults)), "")


def undeclared(model: Model) -> tuple[str, ...]:
    """Return what the scene's plugins do not declare of their channels and fields, or declare in an outdated way.

    Each sentence comes once.
    """
    found: list[str] = []
    for device in model.devices.values():
        said = [*faults_of(device.reads, "reading"), *faults_of(device.commands, "command")]
        said += faults_of(device.fields_of(device.make_twin()), "field") if device.twin else ()
        parts: list[type[HasOldNames] | None] = [device.cls, device.cls.Twin, device.cls.Emulator]
        parts += [type(monitor) for monitor in device.monitors]
        said += [sentence for part in parts if part is not None for sentence in part.deprecations]
        found += [f"device plugin '{device.plugin}': {sentence}" for sentence in said]
    for modality in model.modalities:
        said = [*faults_of(modality.declared, "field"), *type(modality.instance).deprecations]
        found += [f"modality plugin '{modality.plugin}': {sentence}" for sentence in said]
    return tuple(dict.fromkeys(found))


def _prefixed(prefix: str, fields: Iterable[Field]) -> list[Field]:
    return [replace(field, name=f"{prefix}.{field.name}") for field in fields]


def _own(prefix: str, fields: Iterable[Field]) -> list[Field]:
    """Return the framework's own fields with a prefix; of these only those that say where are plotted."""
    return [replace(field, show=field.show or "no") for field in _prefixed(prefix, fields)]


def _device(device: DeviceModel, framed: bool) -> list[Field]:
    name = device.name
    fields = [Field.of(channel, f"{name}.{channel.name}") for channel in device.reads]
    for channel in device.commands:
        requested = f"requested: {channel.doc}" if channel.doc else ""
        fields.append(Field.of(channel, f"{name}.command.{channel.name}", doc=requested, show="no"))
    for channel in device.commands:
        sent = replace(Field.of(channel, f"{name}.sent.{channel.name}"), low=_FINITE[0], high=_FINITE[1])
        fields.append(sent)
    fields += _own(name, supervision(device.monitors))
    fields += _own(name, _stamps(device))
    if framed:
        fields += _own(name, (_FRAME,))
    if device.touch_off:
        fields += _own(
            f"{name}.touch_off",
            (
                Field("stage", "i8", low=0, high=3, unit="1", doc="0 place, 1 rise, 2 release, 3 done"),
                Field("point", "i8", low=0, high=device.touch_off - 1, unit="1", doc="which point is being felt"),
                Field("sums", "f8", 5, unit="mixed", doc="sums of the readings at the point that is being felt"),
                Field("offsets", "f8", device.touch_off, unit="m", doc="what was found at each point"),
                Field("target", unit="m", doc="height that the surface is driven to"),
                Field("aside", "f8", 2, unit="m", doc="where the finger is to be on the surface, from its middle"),
                Field("noise", unit="N^2", doc="mean square of what the sensor reads where nothing touches"),
                Field("squares", unit="m^2", doc="sum of the squares of heights at the point that is being felt"),
            ),
        )
    if device.twin:
        fields += _prefixed(f"{name}.twin", device.fields_of(device.make_twin()))
    return fields


def _stamps(device: DeviceModel) -> list[Field]:
    """Return the times of what passes between loop and device: the one place where they are kept.

    ``measured`` has the tick at which each channel of the newest reading was measured, in the order of the reads; by
    ``age`` only the device's silence is counted, from when that reading came.  Behind a wire ``out`` is the newest
    command that has left, and ``left`` the tick in which it did; of a surface the last ones are kept, so that a reading
    is compared with what was commanded when it was measured.
    """
    measured = "tick at which each channel of the newest reading was measured, in the order of the reads"
    fields = [Field("measured", "i8", max(1, len(device.reads)), unit="tick", doc=measured)]
    if device.wire:
        fields.append(Field("left", "i8", unit="tick", doc="when the newest command left"))
        if any(channel.role is Role.SURFACE_POSE for channel in device.commands):
            places = "ticks from which the newest commands have acted, and where they sent the surface [m]"
            fields.append(Field("gone", "f8", (GONE, 4), *_FINITE, unit="mixed", doc=places))
            fields.append(Field("goings", "i8", low=0, unit="1", doc="how many commands have left"))
        sent = [Field.of(c, f"out.{c.name}", doc=f"left: {c.doc}" if c.doc else "", show="no") for c in device.commands]
        fields += [replace(field, low=_FINITE[0], high=_FINITE[1]) for field in sent]
    return fields


def make_state(model: Model) -> Record:
    """Return a zeroed State for a model.

    Raises
    ------
    SceneError
        If a modality is named so that a field of it has the name of another field.
    """
    fields = layout(model)
    counts = Counter(field.name for field in fields)
    for one in model.modalities:
        twice = next((name for name in one.fields if counts[f"{one.name}.{name}"] > 1), None)
        if twice is not None:
            sentence = f"modality '{one.name}' declares '{one.name}.{twice}', which is a field of something else, too"
            raise SceneError([Problem("duplicate-name", sentence, model.place_of(one.name), "give it another name")])
    return Record.of(fields)
