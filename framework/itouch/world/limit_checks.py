"""What is wrong with the limits that a scene asks for: looser than default or device, or without a channel to limit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from itouch.plugin import HURTING, Channel
from itouch.scene import Scene
from itouch.scene.elements import DeviceElement
from itouch.schema import Problem
from itouch.schema.fields import xml_name

_UNITS = {
    "force": "N", "torque": "N m", "speed": "m/s", "current": "A", "watchdog": "s", "plate_force": "N",
    "contact_time": "s", "plate_rate": "K/s", "flux": "W/m^2", "dose": "s", "cold_time": "s",
}  # fmt: skip
_OF_DEVICES = ("force", "torque", "speed", "current", "temperature")


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
    """Find limits of ``<safety>`` that are looser than the defaults."""
    for name, unit in _UNITS.items():
        wanted, most = getattr(scene.safety, name, None), defaults.get(name)
        if wanted is not None and most is not None and wanted > most:
            what = f"<safety {xml_name(name)}>: {wanted:g} {unit} is above the default of {most:g} {unit}"
            yield _loose(scene, scene.safety, name, what)
    if scene.safety.temperature is not None:
        yield from _temperature(scene, scene.safety, "<safety>", defaults["temperature"])


def _temperature(scene: Scene, element: Any, what: str, allowed: tuple[float, float]) -> Iterator[Problem]:
    low, high = element.temperature
    if low >= high:
        sentence = f"{what}: the lowest temperature is not below the highest"
        yield Problem("bad-value", sentence, scene.places.of(element, "temperature"), "write lowest, then highest")
    elif low < allowed[0] or high > allowed[1]:
        low_c, high_c = (value - 273.15 for value in allowed)
        sentence = f"{what}: the temperatures go beyond the default of {low_c:g} to {high_c:g} degC"
        yield _loose(scene, element, "temperature", sentence)


def _loose(scene: Scene, element: Any, name: str, sentence: str) -> Problem:
    return Problem(
        "loosened-limit", sentence, scene.places.of(element, name), "a scene may tighten limits, never loosen"
    )
