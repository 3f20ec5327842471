"""The limits in force: the hardware's ceiling, then what the scene tightens, then the defaults; nothing loosens them.

The defaults are for healthy adults touching with a fingertip.  Their basis is in ``docs/reference/safety-limits.md``,
where T, K and W number them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from itouch.plugin import Channel
from itouch.scene import Scene
from itouch.scene.elements import DeviceElement
from itouch.schema import Problem
from itouch.world import limitcheck

# --- heat (T) -----------------------------------------------------------------------------------------------------
#: T1, T2: lowest and highest plate temperature [K]: where the drive is cut down, where it trips, and what never passes.
PLATE_TEMPERATURE = (288.15, 313.15)
PLATE_TRIP = (285.15, 315.15)
PLATE_ABSOLUTE = (281.15, 318.15)
#: T3: thermal dose of a session [s of CEM43] that is told, and that trips.
DOSE_WARNING, DOSE = 60.0, 120.0
#: T4: time [s] of one contact after which the plate withdraws, the longest that a scene may ask for, and the trip.
CONTACT_TIME, CONTACT_TIME_LONGEST, CONTACT_TIME_TRIP = 10.0, 60.0, 60.0
#: T5: rate [K/s] of the plate in contact, as a mean over half a second, that cuts the drive down; twice as much trips.
PLATE_RATE = 10.0
#: T6: mean over a second of |flux| [W/m2] that cuts the drive down; 4/3 of it trips.
FLUX = 15e3
#: T7: heat sink [K]: where the drive is cut down, where it trips, and what never passes.
SINK, SINK_TRIP, SINK_ABSOLUTE = 323.15, 328.15, 333.15
# --- motion and force (K) -----------------------------------------------------------------------------------------
#: K1: greatest force of an arm on the operator [N].
FORCE = 3.0
#: K2: speed of the finger on an arm [m/s] from which forces that drive it fade, and that trips.
ARM_SPEED, ARM_SPEED_TRIP = 0.8, 1.2
#: K3: greatest increase of |force| [N/s], and ramp-in [s] after enabling hardware and after every re-arming.
FORCE_SLEW, RAMP = 1000.0, 1.0
#: K4: force of the plate on the finger [N]: where the plate yields, where it trips, and what never passes.
PLATE_FORCE, PLATE_FORCE_TRIP, PLATE_FORCE_ABSOLUTE = 2.0, 5.0, 10.0
#: K5: distance [m] below which a surface is near the finger; its speed [m/s] towards a near finger, and otherwise.
NEAR = 0.020
SPEED_NEAR, SPEED = 0.10, 0.25
SPEED_NEAR_TRIP, SPEED_TRIP = 0.15, 0.30
#: K6: distance [m] of a surface from its command that stops its approach, that trips, and for how long [s].
TRACKING, TRACKING_TRIP, TRACKING_TIME = 0.003, 0.005, 0.1
# --- watchdogs (W) ------------------------------------------------------------------------------------------------
#: W1: greatest age of a reading [s], by what the device commands.
WATCHDOG = {"wrench": 0.020, "pose_target": 0.100, "current": 0.500, "temperature_target": 0.500}
WATCHDOG_OTHER = 0.500
#: W3: how long [s] one word of the dead-man's switch holds.
HOLD = 0.080

DEFAULT, CEILING = "the default", "the device's ceiling"


@dataclass(frozen=True, slots=True)
class DeviceLimits:
    """The limits in force for one device, SI; None where the device has nothing to limit.

    ``sources`` says for each field who has set it.
    """

    force: float | None = None
    speed: float | None = None
    speed_near: float | None = None
    current: float | None = None
    temperature: tuple[float, float] | None = None
    watchdog: float = WATCHDOG_OTHER
    plate_force: float | None = None
    contact_time: float | None = None
    plate_rate: float | None = None
    flux: float | None = None
    dose: float | None = None
    ramp: float = 0.0
    sources: Mapping[str, str] = field(default_factory=dict, compare=False)

    def table(self) -> dict[str, float | tuple[float, float]]:
        """Return the limits that there are, by name."""
        named = {name: getattr(self, name) for name in NAMES}
        return {name: value for name, value in named.items() if value is not None}

    @property
    def temperature_trip(self) -> tuple[float, float]:
        """Lowest and highest plate temperature [K] before a trip: as far beyond the limits as the default trips are."""
        low, high = self.temperature or PLATE_TEMPERATURE
        return (
            max(PLATE_TRIP[0], low - (PLATE_TEMPERATURE[0] - PLATE_TRIP[0])),
            min(PLATE_TRIP[1], high + (PLATE_TRIP[1] - PLATE_TEMPERATURE[1])),
        )

    @property
    def plate_force_trip(self) -> float:
        """Force [N] of the plate on the finger that trips, in the ratio of the defaults."""
        return (PLATE_FORCE if self.plate_force is None else self.plate_force) * PLATE_FORCE_TRIP / PLATE_FORCE

    @property
    def contact_time_trip(self) -> float:
        """Time [s] of one contact that trips: the plate was to withdraw long before."""
        wanted = CONTACT_TIME if self.contact_time is None else self.contact_time
        return min(CONTACT_TIME_TRIP, wanted * CONTACT_TIME_TRIP / CONTACT_TIME)


#: The limits of ``DeviceLimits.table``.
NAMES = (
    "force", "speed", "current", "temperature", "plate_force", "contact_time", "plate_rate", "flux", "dose", "watchdog",
)  # fmt: skip

Ceiling = tuple[Any, str]


def ceilings(reads: tuple[Channel, ...], commands: tuple[Channel, ...]) -> dict[str, Ceiling]:
    """Return what holds before the scene says anything, with who set it: the smaller of default and hardware."""
    by_name = {channel.name: channel for channel in commands}
    found: dict[str, Ceiling] = {}
    if "wrench" in by_name:
        found["force"] = _least(FORCE, by_name["wrench"].magnitude)
    if "pose_target" in by_name:
        slew = by_name["pose_target"].slew
        found["speed"] = _least(SPEED, min(slew[:3]) if slew else None)
        found["plate_force"], found["contact_time"] = (PLATE_FORCE, DEFAULT), (CONTACT_TIME, DEFAULT)
    if "current" in by_name and math.isfinite(max(by_name["current"].high, default=math.inf)):
        found["current"] = (by_name["current"].high[0], CEILING)
    if "temperature_target" in by_name or any(channel.name == "plate_temperature" for channel in reads):
        found["temperature"], found["dose"] = (PLATE_TEMPERATURE, DEFAULT), (DOSE, DEFAULT)
        found["plate_rate"] = (PLATE_RATE, DEFAULT)
    if any(channel.name == "heat_flux" for channel in reads):
        found["flux"] = (FLUX, DEFAULT)
    patience = min((WATCHDOG.get(channel.name, WATCHDOG_OTHER) for channel in commands), default=WATCHDOG_OTHER)
    found["watchdog"] = (patience, DEFAULT)
    return found


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
    values["ramp"], sources["ramp"] = _ramp(scene, device)
    problems = list(limitcheck.device_problems(scene, device, before))
    return DeviceLimits(**values, sources=sources), problems


def _asked(scene: Scene, device: DeviceElement, name: str) -> Iterator[Ceiling]:
    """Yield what device and scene ask for, with where they do."""
    for element in (device.limits, scene.safety):
        wanted = getattr(element, name, None)
        if wanted is not None:
            yield wanted, _said_by(scene, element, name)


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
    """Return how long a contact may last: a scene may ask for less, and for as much as 60 s."""
    wanted = scene.safety.contact_time
    if wanted is None:
        return ceiling
    return min(wanted, CONTACT_TIME_LONGEST - 1.0), _said_by(scene, scene.safety, "contact_time")


def _ramp(scene: Scene, device: DeviceElement) -> Ceiling:
    """Return the ramp-in after enabling: at least that of the default on hardware; on twins what the scene says."""
    wanted, least = scene.safety.ramp, 0.0 if device.twin else RAMP
    if wanted is not None and wanted >= least:
        return wanted, _said_by(scene, scene.safety, "ramp")
    return least, DEFAULT


def check_safety(scene: Scene) -> Iterator[Problem]:
    """Find limits of ``<safety>`` that are looser than the defaults."""
    yield from limitcheck.safety_problems(
        scene,
        {
            "force": FORCE, "speed": SPEED, "watchdog": WATCHDOG_OTHER, "plate_force": PLATE_FORCE,
            "contact_time": CONTACT_TIME_LONGEST, "plate_rate": PLATE_RATE, "flux": FLUX, "dose": DOSE,
            "temperature": PLATE_TEMPERATURE,
        },
    )  # fmt: skip
