"""The limits in force: the hardware's ceiling, the defaults, and what the scene tightens; nothing can loosen them.

The defaults are for healthy adults touching with a fingertip.  Their basis is in ``docs/reference/safety-limits.md``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from itouch.plugin import Channel
from itouch.scene import Scene
from itouch.scene.elements import DeviceElement
from itouch.schema import Problem

#: Greatest force of an arm on the operator [N].
FORCE = 3.0
#: Greatest speed [m/s] of a carried surface: towards the finger when near, and otherwise.
SPEED_NEAR, SPEED = 0.10, 0.25
#: Distance [m] from the finger below which a surface is near.
NEAR = 0.020
#: Lowest and highest commanded plate temperature [K], and where it trips.
PLATE_TEMPERATURE = (288.15, 313.15)
PLATE_TRIP = (285.15, 315.15)
#: Hottest heat sink [K] before a trip.
SINK_TRIP = 328.15
#: Force of the plate on the finger [N]: where the plate yields, and where it trips.
PLATE_FORCE, PLATE_FORCE_TRIP = 2.0, 5.0
#: Distance [m] between a surface and its command that trips, and for how long [s].
TRACKING_TRIP, TRACKING_TIME = 0.005, 0.1
#: Speed of the finger on an arm [m/s] that trips.
ARM_SPEED_TRIP = 1.2
#: Greatest increase of |force| [N/s].
FORCE_SLEW = 1000.0
#: Ramp-in [s] after enabling hardware.
RAMP = 1.0
#: Greatest age of a reading [s], by what the device commands.
WATCHDOG = {"wrench": 0.020, "pose_target": 0.100, "current": 0.500}
WATCHDOG_OTHER = 0.500


@dataclass(frozen=True, slots=True)
class DeviceLimits:
    """The limits in force for one device, SI; None where the device has nothing to limit."""

    force: float | None
    speed: float | None
    speed_near: float | None
    current: float | None
    temperature: tuple[float, float] | None
    watchdog: float

    def table(self) -> dict[str, float | tuple[float, float]]:
        """Return the limits by name."""
        named = {name: getattr(self, name) for name in ("force", "speed", "current", "temperature", "watchdog")}
        return {name: value for name, value in named.items() if value is not None}


@dataclass(frozen=True, slots=True)
class _Ceilings:
    """What holds before the scene says anything: the smaller of default and hardware, with who set it."""

    force: tuple[float, str] | None
    speed: tuple[float, str] | None
    current: tuple[float, str] | None
    temperature: tuple[float, float] | None

    @classmethod
    def of(cls, reads: tuple[Channel, ...], commands: tuple[Channel, ...]) -> _Ceilings:
        by_name = {channel.name: channel for channel in commands}
        wrench, target, current = (by_name.get(name) for name in ("wrench", "pose_target", "current"))
        plate = any(channel.name == "plate_temperature" for channel in reads)
        return cls(
            _least(FORCE, wrench.magnitude) if wrench else None,
            _least(SPEED, min(target.slew[:3]) if target.slew else None) if target else None,
            (current.high[0], "the device's ceiling") if current and current.high else None,
            PLATE_TEMPERATURE if plate or "temperature_target" in by_name else None,
        )


def _least(default: float, hardware: float | None) -> tuple[float, str]:
    if hardware is not None and hardware < default:
        return hardware, "the device's ceiling"
    return default, "the default"


def resolve(
    scene: Scene, device: DeviceElement, reads: tuple[Channel, ...], commands: tuple[Channel, ...]
) -> tuple[DeviceLimits, list[Problem]]:
    """Return the limits in force for a device, and what is wrong with those that the scene asks for."""
    ceilings = _Ceilings.of(reads, commands)
    problems = list(_loosened(scene, device, ceilings)) + list(_without_channel(scene, device, ceilings))
    safety, own = scene.safety, device.limits
    speed = _tightest(ceilings.speed, own.speed, safety.speed)
    limits = DeviceLimits(
        _tightest(ceilings.force, own.force, safety.force),
        speed,
        min(SPEED_NEAR, speed) if speed is not None else None,
        _tightest(ceilings.current, own.current, None),
        _narrowest(ceilings.temperature, own.temperature, safety.temperature),
        _watchdog(scene, commands),
    )
    return limits, problems


def _tightest(ceiling: tuple[float, str] | None, *wanted: float | None) -> float | None:
    if ceiling is None:
        return None
    return min(ceiling[0], *(value for value in wanted if value is not None), ceiling[0])


def _narrowest(ceiling: tuple[float, float] | None, *wanted: tuple[float, float] | None) -> tuple[float, float] | None:
    if ceiling is None:
        return None
    given = [ceiling, *(pair for pair in wanted if pair is not None)]
    return max(pair[0] for pair in given), min(pair[1] for pair in given)


def _watchdog(scene: Scene, commands: tuple[Channel, ...]) -> float:
    default = min((WATCHDOG.get(channel.name, WATCHDOG_OTHER) for channel in commands), default=WATCHDOG_OTHER)
    return min(default, scene.safety.watchdog or default)


def _loosened(scene: Scene, device: DeviceElement, ceilings: _Ceilings) -> Iterator[Problem]:
    for name, unit in (("force", "N"), ("speed", "m/s"), ("current", "A")):
        wanted, ceiling = getattr(device.limits, name), getattr(ceilings, name)
        if wanted is not None and ceiling is not None and wanted > ceiling[0]:
            what = f"{name} {wanted:g} {unit} is above {ceiling[1]} of {ceiling[0]:g} {unit}"
            yield _loose(scene, device.limits, name, f"device '{device.name}': {what}")
    if device.limits.temperature is not None and ceilings.temperature is not None:
        yield from _loosened_temperature(scene, device.limits, f"device '{device.name}'")


def check_safety(scene: Scene) -> Iterator[Problem]:
    """Find limits of ``<safety>`` that are looser than the defaults."""
    for name, unit, default in (("force", "N", FORCE), ("speed", "m/s", SPEED), ("watchdog", "s", WATCHDOG_OTHER)):
        wanted = getattr(scene.safety, name)
        if wanted is not None and wanted > default:
            what = f"<safety {name}>: {wanted:g} {unit} is above the default of {default:g} {unit}"
            yield _loose(scene, scene.safety, name, what)
    if scene.safety.temperature is not None:
        yield from _loosened_temperature(scene, scene.safety, "<safety>")


def _loosened_temperature(scene: Scene, element: Any, what: str) -> Iterator[Problem]:
    low, high = element.temperature
    if low >= high:
        sentence = f"{what}: the lowest temperature is not below the highest"
        yield Problem("bad-value", sentence, scene.places.of(element, "temperature"), "write lowest, then highest")
    elif low < PLATE_TEMPERATURE[0] or high > PLATE_TEMPERATURE[1]:
        low_c, high_c = (value - 273.15 for value in PLATE_TEMPERATURE)
        sentence = f"{what}: the temperatures go beyond the default of {low_c:g} to {high_c:g} degC"
        yield _loose(scene, element, "temperature", sentence)


def _loose(scene: Scene, element: Any, name: str, sentence: str) -> Problem:
    return Problem(
        "loosened-limit", sentence, scene.places.of(element, name), "a scene may tighten limits, never loosen"
    )


def _without_channel(scene: Scene, device: DeviceElement, ceilings: _Ceilings) -> Iterator[Problem]:
    for name in ("force", "speed", "current", "temperature"):
        if getattr(device.limits, name) is not None and getattr(ceilings, name) is None:
            sentence = f"device '{device.name}' has no {name} to limit"
            place = scene.places.of(device.limits, name)
            yield Problem("limit-without-channel", sentence, place, "remove the limit")
