"""The default limits of safety (temperature, dose, force, speed, time, watchdog), and those in force for one device.

The defaults are for healthy adults touching with a fingertip.  Their basis is in ``docs/reference/safety-limits.md``,
by the numbers T1, K1, W1 and so on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from itouch.plugin import Role

# --- heat (T) -----------------------------------------------------------------------------------------------------
#: T1, T2: lowest and highest plate temperature [K]: where the drive is cut down, where it trips, the absolute limit.
PLATE_TEMPERATURE = (288.15, 313.15)
PLATE_TRIP = (285.15, 315.15)
PLATE_ABSOLUTE = (281.15, 318.15)
#: T3: thermal dose of a session [s of CEM43] that gives a warning, and that trips.
DOSE_WARNING, DOSE = 60.0, 120.0
#: T4: time [s] of one contact after which the plate withdraws, the longest that a scene may ask for, and that trips.
CONTACT_TIME, CONTACT_TIME_LONGEST, CONTACT_TIME_TRIP = 10.0, 60.0, 60.0
#: T4c: temperature [K] below which a plate is cold, longest time [s] in contact with a cold plate in a session, and the
#: same temperature without the 1 K that is added for the sensor.  In the study that the limits for cold come from (Geng
#: et al. 2006) nobody was exposed for longer than 120 s, and pain began at a contact temperature of 15 degC.
COLD_FROM, COLD_TIME, COLD_ABSOLUTE = 289.15, 120.0, 288.15
#: T5: rate [K/s] of the plate in contact, as a mean over half a second, that cuts the drive down; twice as much trips.
PLATE_RATE = 10.0
#: T6: mean over a second of |flux| [W/m2] that cuts the drive down; 4/3 of it trips.
FLUX = 15e3
#: T7: temperature of the heat sink [K]: where the drive is cut down, where it trips, and the absolute limit.
SINK, SINK_TRIP, SINK_ABSOLUTE = 323.15, 328.15, 333.15
# --- motion and force (K) -----------------------------------------------------------------------------------------
#: K1: greatest force of an arm on the operator [N].
FORCE = 3.0
#: K1: distance [m] from a fingertip to the nearest of the finger's joints: a torque counts as a force at this lever.
#: The bone of an index finger's distal phalanx is 15.8 mm long, with 3.8 mm of soft tissue before it (Buryanov and
#: Kotiuk 2010).
FINGER_LEVER = 0.020
#: K1: greatest torque of an arm on the operator [N m]: it loads no joint more than the greatest force does.
TORQUE = FORCE * FINGER_LEVER
#: K2: speed of the finger on an arm [m/s] from which forces fade, and that trips.
ARM_SPEED, ARM_SPEED_TRIP = 0.8, 1.2
#: K3: greatest increase of |force| [N/s], and ramp-in [s] after enabling hardware and after every re-arming.
FORCE_SLEW, RAMP = 1000.0, 1.0
#: K4: force of the plate on the finger [N]: where the plate yields, where it trips, and the absolute limit.
PLATE_FORCE, PLATE_FORCE_TRIP, PLATE_FORCE_ABSOLUTE = 2.0, 5.0, 10.0
#: K5: distance [m] below which a surface is near the finger; its speed [m/s] towards a near finger, and otherwise.
NEAR = 0.020
SPEED_NEAR, SPEED = 0.10, 0.25
SPEED_NEAR_TRIP, SPEED_TRIP = 0.15, 0.30
#: K6: distance [m] of a surface from its command that stops its approach, that trips, and how long it must last [s].
TRACKING, TRACKING_TRIP, TRACKING_TIME = 0.003, 0.005, 0.1
# --- watchdogs (W) ------------------------------------------------------------------------------------------------
#: W1: greatest age of a reading [s], by what the device commands.
WATCHDOG = {Role.FORCE_ON_OPERATOR: 0.020, Role.SURFACE_POSE: 0.100}
WATCHDOG_OTHER = 0.500
#: W1: readings whose age counts from when they were measured, where the wire tells that, not from when they came: those
#: that show what can hurt a finger within the time that a watchdog waits, or that let a device run.
TIMELY = frozenset({Role.TRACKED_POSE, Role.CONTACT_FORCE, Role.SKIN_CONTACT_TEMPERATURE, Role.HEAT_FLUX, Role.DEADMAN})
#: W4: how often a device may be re-armed within a minute.
REARMS = 5
#: W3: how long [s] one signal of the dead-man's switch is good.
HOLD = 0.080

DEFAULT, CEILING = "the default", "the device's ceiling"


def told_from(dose: float) -> float:
    """Return the thermal dose [s] from which it is told, of the most that a session may have [s]: never only after."""
    return min(DOSE_WARNING, 0.5 * dose)


@dataclass(frozen=True, slots=True)
class DeviceLimits:
    """The limits in force for one device, SI; None where the device has nothing to limit.

    ``sources`` tells for each field what has set it.
    """

    force: float | None = None
    torque: float | None = None
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
    cold_time: float | None = None
    finger_force: float = FORCE
    finger_torque: float = TORQUE
    ramp: float = 0.0
    sources: Mapping[str, str] = field(default_factory=dict, compare=False)

    def table(self) -> dict[str, float | tuple[float, float]]:
        """Return the limits that there are, by name."""
        named = {name: getattr(self, name) for name in NAMES}
        return {name: value for name, value in named.items() if value is not None}

    @property
    def temperature_trip(self) -> tuple[float, float]:
        """Plate temperatures [K] below and above which it trips: as far beyond the limits as the default trips are."""
        low, high = self.temperature or PLATE_TEMPERATURE
        return (
            max(PLATE_TRIP[0], low - (PLATE_TEMPERATURE[0] - PLATE_TRIP[0])),
            min(PLATE_TRIP[1], high + (PLATE_TRIP[1] - PLATE_TEMPERATURE[1])),
        )

    @property
    def plate_force_trip(self) -> float:
        """Force [N] of the plate on the finger that trips: the limit times the ratio of the defaults."""
        return (PLATE_FORCE if self.plate_force is None else self.plate_force) * PLATE_FORCE_TRIP / PLATE_FORCE

    @property
    def contact_time_trip(self) -> float:
        """Time [s] of one contact that trips: the plate should have withdrawn long before."""
        wanted = CONTACT_TIME if self.contact_time is None else self.contact_time
        return min(CONTACT_TIME_TRIP, wanted * CONTACT_TIME_TRIP / CONTACT_TIME)


#: Names of the limits in ``DeviceLimits.table``.
NAMES = (
    "force", "torque", "speed", "current", "temperature", "plate_force", "contact_time", "plate_rate", "flux", "dose",
    "cold_time", "watchdog",
)  # fmt: skip
