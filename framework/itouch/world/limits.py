"""The limits in force: the hardware's ceilings and the defaults, as the scene tightens them; nothing loosens them.

The defaults are in `itouch.monitors.default_limits`; this module finds which of them apply to a device, by the roles of
its channels, what the scene makes of them, and what is wrong with the limits that it asks for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from itouch.monitors.default_limits import (
    ARM_SPEED,
    ARM_SPEED_TRIP,
    CEILING,
    COLD_ABSOLUTE,
    COLD_FROM,
    COLD_TIME,
    CONTACT_TIME,
    CONTACT_TIME_LONGEST,
    CONTACT_TIME_TRIP,
    DEFAULT,
    DOSE,
    DOSE_WARNING,
    FINGER_LEVER,
    FLUX,
    FORCE,
    FORCE_SLEW,
    HOLD,
    NAMES,
    NEAR,
    PLATE_ABSOLUTE,
    PLATE_FORCE,
    PLATE_FORCE_ABSOLUTE,
    PLATE_FORCE_TRIP,
    PLATE_RATE,
    PLATE_TEMPERATURE,
    PLATE_TRIP,
    RAMP,
    REARMS,
    SINK,
    SINK_ABSOLUTE,
    SINK_TRIP,
    SPEED,
    SPEED_NEAR,
    SPEED_NEAR_TRIP,
    SPEED_TRIP,
    TORQUE,
    TRACKING,
    TRACKING_TIME,
    TRACKING_TRIP,
    WATCHDOG,
    WATCHDOG_OTHER,
    DeviceLimits,
    told_from,
)  # fmt: skip
from itouch.plugin import HURTING, Channel, Role
from itouch.plugin.channel import ROTATIONS
from itouch.scene import Scene
from itouch.scene.elements import DeviceElement
from itouch.schema import Problem
from itouch.schema.fields import xml_name

__all__ = [
    "ARM_SPEED", "ARM_SPEED_TRIP", "CEILING", "COLD_ABSOLUTE", "COLD_FROM", "COLD_TIME", "CONTACT_TIME",
    "CONTACT_TIME_LONGEST", "CONTACT_TIME_TRIP", "DEFAULT", "DOSE", "DOSE_WARNING", "FINGER_LEVER", "FLUX",
    "FORCE", "FORCE_SLEW", "HOLD", "NAMES", "NEAR",
    "PLATE_ABSOLUTE", "PLATE_FORCE", "PLATE_FORCE_ABSOLUTE", "PLATE_FORCE_TRIP", "PLATE_RATE", "PLATE_TEMPERATURE",
    "PLATE_TRIP", "RAMP", "REARMS", "SINK", "SINK_ABSOLUTE", "SINK_TRIP", "SPEED", "SPEED_NEAR", "SPEED_NEAR_TRIP",
    "SPEED_TRIP", "TORQUE", "TRACKING", "TRACKING_TIME", "TRACKING_TRIP", "WATCHDOG", "WATCHDOG_OTHER", "DeviceLimits",
    "ceilings", "check_safety", "resolve", "told_from",
]  # fmt: skip

Ceiling = tuple[Any, str]

_UNITS = {
    "force": "N", "torque": "N m", "speed": "m/s", "current": "A", "watchdog": "s", "plate_force": "N",
    "contact_time": "s", "plate_rate": "K/s", "flux": "W/m^2", "dose": "s", "cold_time": "s",
}  # fmt: skip
_OF_DEVICES = ("force", "torque", "speed", "current", "temperature")


def ceilings(reads: tuple[Channel, ...], commands: tuple[Channel, ...]) -> dict[str, Ceiling]:
    """Return the limits that hold if the scene sets none, each with its source: the smaller of default and hardware."""
    roles, measured = {channel.role for channel in commands}, {channel.role for channel in reads}
    found: dict[str, Ceiling] = {}
    if Role.FORCE_ON_OPERATOR in roles:
        pushing = _of(commands, Role.FORCE_ON_OPERATOR)
        found["force"] = _least(FORCE, _strongest(pushing))
        if (torque := max(map(greatest_torque, pushing))) > 0.0:
            found["torque"] = _least(TORQUE, torque)
    if Role.SURFACE_POSE in roles:
        slew = _of(commands, Role.SURFACE_POSE)[0].slew
        found["speed"] = _least(SPEED, min(slew[:3]) if slew else None)
        found["contact_time"] = (CONTACT_TIME, DEFAULT)
    if Role.CONTACT_FORCE in measured and roles & {Role.SURFACE_POSE, Role.PRESSURE}:
        found["plate_force"] = (PLATE_FORCE, DEFAULT)
    drives = [channel for channel in _of(commands, Role.DRIVE) if channel.unit == "A" and channel.high]
    top = max((max(channel.high) for channel in drives), default=math.inf)
    if math.isfinite(top):
        found["current"] = (top, CEILING)
    if Role.TEMPERATURE_TARGET in roles or Role.SKIN_CONTACT_TEMPERATURE in measured:
        found["temperature"] = (PLATE_TEMPERATURE, DEFAULT)
    if Role.SKIN_CONTACT_TEMPERATURE in measured:
        found["dose"], found["cold_time"] = (DOSE, DEFAULT), (COLD_TIME, DEFAULT)
        found["plate_rate"] = (PLATE_RATE, DEFAULT)
        if Role.HEAT_FLUX in measured:
            found["flux"] = (FLUX, DEFAULT)
    patience = min((WATCHDOG.get(channel.role, WATCHDOG_OTHER) for channel in commands), default=WATCHDOG_OTHER)
    found["watchdog"] = (patience, DEFAULT)
    return found


def _of(channels: tuple[Channel, ...], role: Role) -> list[Channel]:
    return [channel for channel in channels if channel.role is role]


def _strongest(channels: list[Channel]) -> float | None:
    """Return the greatest force that any of these can exert, or None if one does not state it."""
    found = [channel.magnitude or max(channel.high, default=math.inf) for channel in channels]
    return max(found) if math.isfinite(max(found)) else None


def greatest_torque(channel: Channel) -> float:
    """Return the greatest torque [N m] about any axis that a wrench channel states; 0: none."""
    free = [axis for axis in ROTATIONS if axis < len(channel.high) and axis not in channel.locked]
    found = [min(abs(channel.low[axis]), abs(channel.high[axis])) for axis in free]
    return max((most for most in found if math.isfinite(most)), default=0.0)


def _least(default: float, hardware: float | None) -> Ceiling:
    if hardware is not None and hardware < default:
        return hardware, CEILING
    return default, DEFAULT


def resolve(
    scene: Scene, device: DeviceElement, reads: tuple[Channel, ...], commands: tuple[Channel, ...]
) -> tuple[DeviceLimits, list[Problem]]:
    """Return the limits in force for a device, and what is wrong with those that the scene asks for."""
    before = ceilings(reads, commands)
    values: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for name, ceiling in before.items():
        asked = list(_asked(scene, device, name))
        values[name], sources[name] = _narrowed(ceiling, asked) if name == "temperature" else _tightened(ceiling, asked)
    if "contact_time" in before:
        values["contact_time"], sources["contact_time"] = _contact_time(scene, before["contact_time"])
    if "speed" in values:
        values["speed_near"] = min(SPEED_NEAR, values["speed"])
    values["finger_force"], sources["finger_force"] = _tightened((FORCE, DEFAULT), list(_asked_of_all(scene, "force")))
    of_all = [(force * FINGER_LEVER, by) for force, by in _asked_of_all(scene, "force")]
    of_all += _asked_of_all(scene, "torque")
    values["finger_torque"], sources["finger_torque"] = _tightened((TORQUE, DEFAULT), of_all)
    values["ramp"], sources["ramp"] = _ramp(scene, device)
    problems = list(device_problems(scene, device, before, commands))
    if "temperature" in before:
        problems += _none_left(scene, device, before["temperature"], values["temperature"])
    return DeviceLimits(**values, sources=sources), problems


def _asked(scene: Scene, device: DeviceElement, name: str) -> Iterator[Ceiling]:
    """Yield the values of a limit that device and scene ask for, with where they do.

    A force limit of the whole finger also limits surfaces, and a force limit also limits torques, by a finger's lever.
    """
    if name == "plate_force" and scene.safety.force is not None:
        yield scene.safety.force, _said_by(scene, scene.safety, "force")
    if name == "torque":
        for element in (device.limits, scene.safety):
            if element.force is not None:
                yield element.force * FINGER_LEVER, _said_by(scene, element, "force")
    for element in (device.limits, scene.safety):
        wanted = getattr(element, name, None)
        if wanted is not None:
            yield wanted, _said_by(scene, element, name)


def _asked_of_all(scene: Scene, name: str) -> Iterator[Ceiling]:
    """Yield the value of a limit that the scene sets for all devices, with where it does."""
    wanted = getattr(scene.safety, name)
    if wanted is not None:
        yield wanted, _said_by(scene, scene.safety, name)


def _said_by(scene: Scene, element: Any, name: str) -> str:
    place = scene.places.of(element, name)
    return f"<{element.TAG}> at {place}" if place else f"<{element.TAG}>"


def _tightened(ceiling: Ceiling, asked: list[Ceiling]) -> Ceiling:
    found = ceiling
    for value, source in asked:
        if value <= found[0]:
            found = (value, source)
    return found


def _narrowed(ceiling: Ceiling, asked: list[Ceiling]) -> Ceiling:
    (low, high), source = ceiling
    for (least, most), by in asked:
        if least >= low and most <= high:
            low, high, source = least, most, by
        elif least > low or most < high:
            low, high, source = max(low, least), min(high, most), f"{source} and {by}"
    return (low, high), source


def _contact_time(scene: Scene, ceiling: Ceiling) -> Ceiling:
    """Return how long a contact may last: a scene may ask for less than the default, or for more, below 60 s."""
    wanted = scene.safety.contact_time
    if wanted is None:
        return ceiling
    return min(wanted, CONTACT_TIME_LONGEST - 1.0), _said_by(scene, scene.safety, "contact_time")


def _ramp(scene: Scene, device: DeviceElement) -> Ceiling:
    """Return the ramp-in after enabling: on hardware at least the default; on twins what the scene says, or none."""
    wanted, least = scene.safety.ramp, 0.0 if device.twin else RAMP
    if wanted is not None and wanted >= least:
        return wanted, _said_by(scene, scene.safety, "ramp")
    return least, DEFAULT


def check_safety(scene: Scene) -> Iterator[Problem]:
    """Find limits of ``<safety>`` that are looser than the defaults."""
    yield from safety_problems(
        scene,
        {
            "force": FORCE, "torque": TORQUE, "speed": SPEED, "watchdog": WATCHDOG_OTHER, "plate_force": PLATE_FORCE,
            "contact_time": CONTACT_TIME_LONGEST, "plate_rate": PLATE_RATE, "flux": FLUX, "dose": DOSE,
            "cold_time": COLD_TIME,
            "temperature": PLATE_TEMPERATURE,
        },
    )  # fmt: skip


def device_problems(
    scene: Scene, device: DeviceElement, ceilings: Mapping[str, tuple[Any, str]], commands: tuple[Channel, ...]
) -> Iterator[Problem]:
    """Find limits of a device that are looser than what holds without them, or that it has no channel for."""
    for name in _OF_DEVICES:
        wanted = getattr(device.limits, name)
        if wanted is None:
            continue
        if name not in ceilings:
            sentence = f"device '{device.name}' has no {name} to limit"
            place = scene.places.of(device.limits, name)
            yield Problem("limit-without-channel", sentence, place, _without(name, commands))
        elif name == "temperature":
            yield from _temperature(scene, device.limits, f"device '{device.name}'", ceilings[name][0])
        elif wanted > ceilings[name][0]:
            most, source = ceilings[name]
            what = f"{name} {wanted:g} {_UNITS[name]} is above {source} of {most:g} {_UNITS[name]}"
            yield _loose(scene, device.limits, name, f"device '{device.name}': {what}")


def _without(name: str, commands: tuple[Channel, ...]) -> str:
    """Return what to do about a limit that no channel of a device has: keep it, if the device may heat all the same."""
    if name == "temperature" and any(channel.role in HURTING for channel in commands):
        return (
            "keep the limit; nothing tells how hot the device is: its plugin must declare the reading of what the skin "
            "touches, temperature(NAME, Role.SKIN_CONTACT_TEMPERATURE)"
        )
    return f"the device has no command of {name}: set the limit on the device that has one"


def safety_problems(scene: Scene, defaults: Mapping[str, Any]) -> Iterator[Problem]:
    """Find limits of ``<safety>`` that are looser than the defaults: of the scene, and of a rig under it."""
    told: list[Problem] = []
    swapped = scene.swapped
    # what holds, which a script may have replaced, and what it is the tighter one of
    for safety in (scene.safety, *((swapped.safety, swapped.brought) if swapped is not None else ())):
        told += [problem for problem in _loose_safety(scene, safety, defaults) if problem not in told]
    yield from told


def _loose_safety(scene: Scene, safety: Any, defaults: Mapping[str, Any]) -> Iterator[Problem]:
    for name, unit in _UNITS.items():
        wanted, most = getattr(safety, name, None), defaults.get(name)
        if wanted is not None and most is not None and wanted > most:
            what = f"<safety {xml_name(name)}>: {wanted:g} {unit} is above the default of {most:g} {unit}"
            yield _loose(scene, safety, name, what)
    if safety.temperature is not None:
        yield from _temperature(scene, safety, "<safety>", defaults["temperature"])


def _temperature(scene: Scene, element: Any, what: str, allowed: tuple[float, float]) -> Iterator[Problem]:
    low, high = element.temperature
    if low >= high:
        sentence = f"{what}: the lowest temperature is not below the highest"
        yield Problem("bad-value", sentence, scene.places.of(element, "temperature"), "write lowest, then highest")
    elif low < allowed[0] or high > allowed[1]:
        low_c, high_c = (value - 273.15 for value in allowed)
        sentence = f"{what}: the temperatures go beyond the default of {low_c:g} to {high_c:g} degC"
        yield _loose(scene, element, "temperature", sentence)


def _none_left(
    scene: Scene, device: DeviceElement, ceiling: tuple[Any, str], band: tuple[float, float]
) -> Iterator[Problem]:
    """Find limits of the temperature that are right one by one, but together allow none."""
    given = [one for one in (device.limits, scene.safety) if one.temperature is not None]
    bands = [(*one.temperature, f"<{one.TAG}>") for one in given if one.temperature is not None]
    (least, most), source = ceiling
    if band[0] < band[1] or any(low >= high or low < least or high > most for low, high, _ in bands[:2]):
        return  # nothing is wrong, or it is told of the one that is
    if len(bands) < 2:
        bands.append((least, most, source))
    told = " and ".join(f"{low - 273.15:.4g} to {high - 273.15:.4g} degC ({by})" for low, high, by in bands)
    places = [place for one in given if (place := scene.places.of(one, "temperature"))]
    related = tuple((place, "the other") for place in places[1:])
    sentence = f"device '{device.name}': no temperature is within both {told}"
    yield Problem("bad-value", sentence, next(iter(places), None), "let them overlap", related)


def _loose(scene: Scene, element: Any, name: str, sentence: str) -> Problem:
    return Problem(
        "loosened-limit", sentence, scene.places.of(element, name), "a scene may tighten limits, never loosen"
    )
