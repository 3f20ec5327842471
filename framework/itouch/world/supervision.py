"""The supervision of a device: its monitors, found by the roles of its channels, and drives that no monitor watches.

Everything that supervision remembers is State, so that a restored session trips where it must.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from itouch.monitors import own_monitors
from itouch.monitors.default_limits import REARMS, DeviceLimits
from itouch.plugin import HURTING, NEVER_HARMLESS, Channel, Field, Monitor, Role, Rule, Watched
from itouch.plugin.quantity import PLAIN
from itouch.schema import Place, Problem
from itouch.schema.units import parse_unit

_EVERY = (
    Field("status", "i8", low=0, high=3, unit="1", doc="0 CLOSED, 1 OPEN (measures), 2 ENABLED (obeys), 3 FAULT"),
    Field("trip", "i8", unit="1", doc="number of the trip that stopped it, 0: none"),
    Field("tripped", "i8", unit="tick", doc="when it was stopped"),
    Field(
        "ramp", low=0.0, high=1.0, unit="1", doc="share of its limits that it may use; grows to 1 after it was enabled"
    ),
    Field("age", "i8", low=0, unit="tick", doc="age of the reading"),
    Field("sequence", "i8", low=0, unit="1", doc="number of the reading: changes when there is a new one"),
    Field("clamped", "i8", low=0, unit="1", doc="how often a command was limited"),
    Field("dropped", "i8", low=0, unit="1", doc="how many commanded components of locked directions were zeroed"),
    Field("calibration", "f8", 7, unit="m", doc="correction of the mount that calibration found: position, quaternion"),
    Field("touched", "i8", low=0, high=1, unit="1", doc="1 while a finger touches it, as far as is known"),
    Field("felt", unit="N", doc="force between finger and device; NaN: not measured"),
    Field("missed", "i8", low=0, unit="tick", doc="periods that a late loop has left out; time goes on in them"),
    Field("heard", "i8", low=-1, unit="tick", doc="when the newest reading came, with what the loop has left out"),
    Field("rearmed", "i8", REARMS, unit="tick", doc="when it was re-armed last, and before; -1: never"),
)

#: Fields that each monitor has besides its own.
_MONITOR = (
    Field("share", low=0.0, high=1.0, unit="1", doc="share of the drive that this monitor leaves"),
    Field(
        "checked",
        "i8",
        low=-1,
        unit="tick",
        doc="when this monitor looked last, with what the loop has left out; -1: never",
    ),
)
_WAY = (
    "in the safe sequence: the height where it was sent when all stopped, and how far down and up it is sent at most; "
    "NaN: as far as it travels"
)
_SURFACE = (
    Field("stopped", "i8", low=0, high=2, unit="1", doc="1 held, 2 driven back, in the safe sequence"),
    Field("way", "f8", 3, unit="m", doc=_WAY),
)

_TEMPERATURE = "Role.TEMPERATURE_TARGET"
#: Units of commands that can hurt if their role is not declared, with the roles that they may have.
_DANGEROUS = {
    "A": "Role.DRIVE, Role.ELECTRODE", "V": "Role.DRIVE, Role.ELECTRODE", "W": "Role.DRIVE, Role.ULTRASOUND",
    "K": _TEMPERATURE, "N": "Role.FORCE_ON_OPERATOR", "Pa": "Role.PRESSURE, Role.ULTRASOUND",
    "W/m^2": "Role.DRIVE, Role.ULTRASOUND", "N*m": "Role.FORCE_ON_OPERATOR", "A*s": "Role.ELECTRODE",
    "A/m^2": "Role.ELECTRODE", "V/m": "Role.ELECTRODE",
}  # fmt: skip
#: The same by dimension: a command in a submultiple or a multiple of a unit can hurt as well.
_DANGERS = {parse_unit(unit).dimension: roles for unit, roles in _DANGEROUS.items()}
#: What a plugin must declare so that a drive is watched.
_ADVICE = {
    Role.DRIVE: "declare the temperature of what it heats: temperature(NAME, Role.SKIN_CONTACT_TEMPERATURE)",
    Role.TEMPERATURE_TARGET: "declare what it reaches: temperature(NAME, Role.SKIN_CONTACT_TEMPERATURE)",
    Role.PRESSURE: "declare the force that it presses with: a reading with Role.CONTACT_FORCE",
    Role.SURFACE_POSE: "declare where the surface is: pose()",
}


def watched(
    name: str, plugin: str, params: Any, channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    limits: DeviceLimits, *, twin: bool,
) -> Watched:  # fmt: skip
    """Return the device as its monitors see it."""
    values: dict[str, Any] = dict(limits.table())
    values |= {"speed_near": limits.speed_near, "ramp": limits.ramp}
    values |= {"finger_force": limits.finger_force, "finger_torque": limits.finger_torque}
    values |= {"temperature_trip": limits.temperature_trip, "contact_time_trip": limits.contact_time_trip}
    if limits.plate_force is not None:
        values["plate_force_trip"] = limits.plate_force_trip
    return Watched(name, plugin, params, *channels, values, dict(limits.sources), twin)


def monitors_of(device: Watched, offered: Sequence[type[Monitor]]) -> tuple[Monitor, ...]:
    """Return the monitors of a device: the framework's, then those that plugins offer.

    Raises
    ------
    ValueError
        If two have the same name, or one names a field in ``time_fields`` that it does not have.
    """
    found = [*own_monitors(device), *(monitor for kind in offered for monitor in kind.of(device))]
    names = [monitor.name for monitor in found]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"two monitors of device '{device.name}' are named '{twice}'")
    for monitor in found:
        unknown = set(monitor.time_fields) - {field.name for field in monitor.fields()}
        if unknown:
            raise ValueError(f"monitor '{monitor.name}' has no field '{min(unknown)}', which it names in `time_fields`")
    return tuple(found)


def supervision(monitors: Sequence[Monitor]) -> tuple[Field, ...]:
    """Return the State that the supervision of a device needs."""
    fields = list(_EVERY)
    if any(monitor.device.command(Role.SURFACE_POSE) is not None for monitor in monitors):
        fields += _SURFACE
    for monitor in monitors:
        fields += [replaced(field, f"{monitor.name}.{field.name}") for field in (*_MONITOR, *monitor.fields())]
    return tuple(fields)


def replaced(field: Field, name: str) -> Field:
    """Return a field under another name."""
    return replace(field, name=name)


def rules(monitors: Sequence[Monitor]) -> Iterator[Rule]:
    """Yield the rules that a device is held to."""
    for monitor in monitors:
        yield from monitor.rules()


def supervision_problems(device: Watched, monitors: Sequence[Monitor], place: Place | None) -> Iterator[Problem]:
    """Find commands whose effect on a person nothing watches, or that are declared wrongly.

    An unmonitored drive is an error on hardware, a warning on a twin.
    """
    seen = {name for monitor in monitors for name in monitor.watches}
    for channel in device.commands:
        what = f"device '{device.name}': command '{channel.name}' [{channel.unit}]"
        roles, harmless = _danger(channel), channel.harmless.strip()
        never = channel.role in NEVER_HARMLESS or roles == _TEMPERATURE
        if channel.role is Role.SIGNAL and roles and not harmless:
            sentence = f"{what} does not say what it is for, and could hurt"
            advice = "write its unit in SI, or its role, into the plugin's channel"
            if roles in _DANGEROUS.values():
                advice = f"write role={roles.replace(', ', ' or role=')} into the plugin's channel"
            yield Problem("missing-role", sentence, place, advice)
        elif channel.harmless and never:
            called = Role.TEMPERATURE_TARGET if roles == _TEMPERATURE else channel.role
            sentence = f"{what} is called harmless, which no {called.value} can be"
            yield Problem("harmless-refused", sentence, place, "remove `harmless` from the plugin's channel")
        elif channel.role in HURTING and channel.name not in seen and not harmless:
            yield _unmonitored(device, channel, what, place)


def _danger(channel: Channel) -> str:
    """Return the roles that a command of its unit may have if it can hurt, "unknown" for an unknown one; else empty."""
    try:
        return _DANGERS.get(parse_unit(channel.unit).dimension, "")
    except ValueError:
        return "" if channel.unit in PLAIN else "unknown"


def _unmonitored(device: Watched, channel: Channel, what: str, place: Place | None) -> Problem:
    sentence = f"{what}, a {channel.role.value}, is unmonitored: no monitor watches what it does to a finger"
    advice = _ADVICE.get(channel.role, "")
    advice = f"{advice}, or a monitor of your own" if advice else "offer a monitor in the group `itouch.monitors`"
    if channel.role not in NEVER_HARMLESS:
        advice += '; harmless="because ..." only if it cannot hurt'
    return Problem("unmonitored-drive", sentence, place, advice, severity="warning" if device.twin else "error")
