"""The default modality of encountered surfaces: it brings the flat top of what a device carries to a finger."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from itouch.plugin import (
    Bound,
    Field,
    Modality,
    ParameterError,
    Record,
    Role,
    SurfaceFields,
    World,
    WorldDevice,
    WorldSurface,
    schema,
)
from itouch.plugin.bound import bound_once
from itouch.plugin.carried_surfaces import ROOM, SLOPE_AHEAD
from itouch_encountered.choosing import FAR, FAR_UNCALIBRATED
from itouch_encountered.feed_forward import INERTIA_FIRST
from itouch_encountered.motion import Numbers, Seen, carry, landing_speed
from itouch_encountered.over_wire import LAG_FIRST, Wire, look_over_wire
from itouch_encountered.surface_fields import FIELDS, OVER_WIRE

#: A contact that passed to the arm because of its tilt is taken back when the tilt is below the limit by this [rad].
TILT_BACK = math.radians(2.0)
#: How far the surface's force stays below the arm's force limit [N] behind a wire, where the finger goes on unseen
#: until a command acts; elsewhere it is `ROOM`.
ROOM_WIRED = 0.25


@dataclass(frozen=True, slots=True)
class EncounteredParams:
    """The probe whose finger meets the surface; the device is the one that this probe names in ``surface-to``."""

    probe: str = schema.ref("probe", doc="the finger that the surface is brought to")


class EncounteredModel(NamedTuple):
    """What is fixed before a run: names of devices and of their fields in State, and constants.

    ``channel``: the command that is written; ``pose`` and ``load``: the fields with the device's pose and contact force
    (empty: not measured); ``place``: the index of the pose among the device's readings.
    """

    name: str
    probe: str
    device: str
    channel: str
    pose: str
    load: str
    numbers: Numbers
    place: int

    @property
    def fields(self) -> tuple[Field, ...]:
        """The modality's own fields: more of them behind a wire."""
        return (*FIELDS, *OVER_WIRE) if self.numbers.wire else FIELDS


class Encountered(Modality):
    """Keeps a flat surface where the finger meets the virtual one, and withdraws it where the slope is too steep."""

    Params = EncounteredParams
    subscribes_to = frozenset()  # if it heard events, Python would call it in each tick of a contact
    probe_attributes = frozenset({"clearance", "plate-angle"})

    def compile(self, name: str, params: Any, world: World) -> EncounteredModel:
        """Look up the probe's surface and its device, and compute the constants of the motion.

        Raises
        ------
        ValueError
            If the probe has no ``surface-to`` (`ParameterError`), or the device has no command for a surface's pose, or
            no reading of it.
        """
        surface, radius = world.surfaces.get(params.probe), world.probes[params.probe]
        if surface is None:
            raise ParameterError("probe", f"'{params.probe}' has no surface-to")
        device = world.devices[surface.device]
        goal, pose = device.command(Role.SURFACE_POSE), device.read_field(Role.TRACKED_POSE)
        if goal is None or not pose:
            raise ValueError(f"device '{device.name}' brings no surface")
        load = device.read_field(Role.CONTACT_FORCE)
        force = _limit(world.devices[surface.arm], "force") if surface.arm else math.inf
        speed = _limit(device, "speed")
        room = ROOM_WIRED if device.wire else ROOM
        numbers = _numbers(surface, radius, world.servo_period, force - room, speed, bool(load))._replace(
            wire=device.wire, softly=landing_speed(surface.pad_stiffness, surface.pad_damping)
        )  # fmt: skip
        place = next(i for i, channel in enumerate(device.reads) if channel.role is Role.TRACKED_POSE)
        return EncounteredModel(name, params.probe, device.name, goal.name, pose, load, numbers, place)

    def fields(self, model: EncounteredModel) -> tuple[Field, ...]:
        """Declare what is reported of the surface, and what is remembered from tick to tick."""
        return model.fields

    def commands(self, model: EncounteredModel) -> tuple[str, ...]:
        """Name the command that is written: the pose of the device's surface."""
        return (f"{model.device}.{model.channel}",)

    def surface_fields(self, model: EncounteredModel) -> SurfaceFields:
        """Declare that it brings the device's surface, and which of its fields report on that."""
        late = ("pressed_now", "since") if model.numbers.wire else ()
        return SurfaceFields(
            model.probe, model.device, "takes", "at_finger", "distance", "gap", "coming", "lost", "yields", *late
        )

    def reads(self, model: EncounteredModel) -> tuple[str, ...]:
        """Return the names of the State fields that it reads."""
        return tuple(dict.fromkeys(name for name in (*_seen(model), *_over_wire(model)) if name))

    def reset(self, model: EncounteredModel, state: Record) -> None:
        """Begin as if the surface were where it should be, with the first guesses of the device's inertia and lag."""
        for field in model.fields:
            state[f"{model.name}.{field.name}"] = 0.0
        state[f"{model.name}.takes"] = state[f"{model.name}.arrived"] = 1.0
        state[f"{model.name}.inertia"] = INERTIA_FIRST
        state[f"{model.name}.lag"] = LAG_FIRST if model.numbers.wire else -model.numbers.period

    def update(self, model: EncounteredModel, state: Record, period: float) -> None:
        """Run the compiled calls of `bound_update` one after another."""
        for step in bound_once(self.bound_update, model, state, period):
            step()

    def bound_update(self, model: EncounteredModel, state: Record, period: float) -> tuple[Bound, ...]:
        """Return all work of a tick as compiled calls: `carry`, behind a wire after `look_over_wire`."""
        nothing = np.zeros(6)
        seen = Seen(*(state.get(name, nothing) for name in _seen(model)))
        own = state.flat(f"{model.name}.{model.fields[0].name}", f"{model.name}.{model.fields[-1].name}")
        goes = Bound(carry, model.numbers, seen, state[f"{model.device}.command.{model.channel}"], own)
        if not model.numbers.wire:
            return (goes,)
        views = {name: state.get(name, nothing) for name in _over_wire(model)}
        measured = f"{model.device}.measured"
        views[measured] = state[measured][model.place : model.place + 1]
        return Bound(look_over_wire, model.numbers, Wire(*views.values()), own), goes


def _seen(model: EncounteredModel) -> tuple[str, ...]:
    """Return the names of the State fields in `Seen`, in its order; an empty one: the device doesn't measure it."""
    probe, device = model.probe, model.device
    return (
        f"{device}.frame", model.pose, f"{device}.sent.{model.channel}", f"{probe}.surface.borne",
        f"{probe}.surface.loud", *(f"{probe}.{name}" for name in ("hip", "normal", "surface_height")),
        *(
            f"{probe}.surface.{name}"
            for name in (
                "upright", "climb", "turns", "hastens", "rises", "level", "sink", "acceleration", "off", "goes_x",
                "goes_y", "slope_x", "slope_y", "pressed", "present",
            )
        ),
        f"{probe}.object", f"{device}.surface.withdrawn", "ready",
    )  # fmt: skip


def _over_wire(model: EncounteredModel) -> tuple[str, ...]:
    """Return the names of the State fields in `Wire`, in its order; without a wire: none."""
    if not model.numbers.wire:
        return ()
    probe, device = model.probe, model.device
    return (
        "tick", *(f"{device}.{name}" for name in ("measured", "gone", "goings")), model.pose, model.load or "no load",
        f"{device}.frame", f"{probe}.hip",
        *(f"{probe}.surface.{name}" for name in ("slope_x", "slope_y", "lifts", "loud")),
    )  # fmt: skip


def _limit(device: WorldDevice, name: str) -> float:
    """Return a device's limit if it is a single number; otherwise, or if there is none, infinity."""
    limit = device.limits.get(name, math.inf)
    return math.inf if isinstance(limit, tuple) else limit


def _numbers(
    surface: WorldSurface, radius: float, period: float, force: float, speed: float, has_load: bool
) -> Numbers:  # fmt: skip
    """Return the constants of the motion.

    ``force``: the most that the arm's limit leaves the surface [N]; ``speed``: the device's limit [m/s].
    """
    return Numbers(
        radius, surface.clearance, math.cos(surface.plate_angle), math.cos(max(0.0, surface.plate_angle - TILT_BACK)),
        period, surface.greatest_force, max(0.0, min(surface.greatest_force, force)), surface.pad_stiffness,
        has_load, speed * period, FAR if surface.touch_off else FAR_UNCALIBRATED,
        max(1, round(SLOPE_AHEAD / period)), *surface.face,
    )  # fmt: skip
