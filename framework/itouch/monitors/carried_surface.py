"""A surface carried to a finger: how fast, how hard, how long, and whether its sensors can be right (T4, T8, K4-K6)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import default_limits as default
from itouch.monitors.thresholds import PLACES
from itouch.monitors.trips import Trip
from itouch.plugin import Field, Moment, Monitor, Record, Role, Rule, Watched

if TYPE_CHECKING:
    from itouch.monitors import surface_kernels

#: How long [s] a withdrawn surface may take at most to leave a finger slowly, by the clock of T4.
LEAVING = 0.5
#: Lever arm [m] by which a torque counts as a force (K4).
LEVER = 0.1
_TRIPS = (Trip.PLATE_FORCE, Trip.TRACKING, Trip.CONTACT_TIME, Trip.SURFACE_SPEED, Trip.SENSOR_DISAGREE)
_RULES = {
    Trip.PLATE_FORCE: "K4", Trip.TRACKING: "K6", Trip.CONTACT_TIME: "T4", Trip.SURFACE_SPEED: "K5",
    Trip.SENSOR_DISAGREE: "T8",
}  # fmt: skip


class Surface(Monitor):
    """Watches one carried surface."""

    name = "surface"
    needs_finger_position: ClassVar[bool] = True
    time_fields: ClassVar[tuple[str, ...]] = ("counted", "near_since", "looked", "track")
    trips: ClassVar[Mapping[int, str]] = {int(trip): trip.label for trip in _TRIPS}

    def __init__(self, device: Watched) -> None:
        super().__init__(device)
        pose = device.reading(Role.TRACKED_POSE)
        self._pose = pose.name if pose is not None else ""
        self._sensors, self._torques = _felt_by(device)
        target = device.command(Role.SURFACE_POSE)
        self._target = target.name if target is not None else ""
        limits = device.limits
        self._clamp = limits.get("contact_time") or default.CONTACT_TIME
        self._longest = limits.get("contact_time_trip") or default.CONTACT_TIME_TRIP
        self._force, self._force_trip = limits.get("plate_force"), limits.get("plate_force_trip", math.inf)
        self._speed, self._near = limits.get("speed") or 0.0, limits.get("speed_near") or 0.0
        self._box = (target.low[:3], target.high[:3]) if target is not None and target.low else None

    @classmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        """Every device that moves a surface."""
        return (cls(device),) if device.command(Role.SURFACE_POSE) is not None else ()

    @property
    def watches(self) -> tuple[str, ...]:
        """The surface's target, if a reading tells where the surface is."""
        return (self._target,) if self._pose else ()

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (
            Field("contact_time", low=0.0, unit="s", doc="how long it has been touched; falls while it is not (T4)"),
            Field("withdrawn", "i8", unit="1", doc="1 while it is withdrawn because of T4"),
            Field("counted", unit="s", doc="when that clock was looked at last"),
            Field("strayed_for", low=0.0, unit="s", doc="how long it has been away from its command (K6)"),
            Field("doubted", low=0.0, unit="s", doc="for how long a force without a finger has been felt (T8)"),
            Field("near_since", unit="s", doc="since when the finger has been near; NaN: it is not (K5)"),
            Field("looked", unit="s", doc="when it was looked at last; NaN: after a pause"),
            Field("places", "i8", low=0, unit="1", doc="how many places are remembered"),
            Field(
                "track", "f8", (PLACES, 7), unit="mixed", doc="times [s], places of the surface and of the finger [m]"
            ),
            Field("figure", "f8", 2, unit="mixed", doc="the figures of the last trip"),
        )

    def reset(self, state: Record) -> None:
        """Begin a session."""
        state["counted"][...] = math.nan
        self.clear_history(state)

    def clear_history(self, state: Record) -> None:
        """Forget what was measured, but not for how long it was touched."""
        state["strayed_for"][...] = state["doubted"][...] = 0.0
        state["near_since"][...] = state["looked"][...] = math.nan
        state["places"][...] = 0

    @property
    def paces(self) -> tuple[float, float, float, float]:
        """Distance from its command that stops it, distance at which a finger is near [m], speed near and far [m/s]."""
        return default.TRACKING, default.NEAR, self._near, self._speed

    def closing(self, gap: float, tracking_error: float) -> float:
        """Return how fast [m/s] the surface may approach the finger now (K5); not while it is astray (K6)."""
        from itouch.monitors.surface_kernels import pace  # here, so that the compiler is loaded only if a device runs

        return pace(gap, tracking_error, *self.paces)

    def follow(self, state: Record, target: float, lifted: bool, leaves: float = -math.inf) -> float:
        """Return the height [m] to command: the bottom of the travel while it is withdrawn (T4).

        The surface comes back when the finger has lifted and the clock of T4 has fallen below half the limit.

        Parameters
        ----------
        state
            Its own fields.
        target
            The height [m] that its modality commands.
        lifted
            Whether no virtual contact is left.
        leaves
            The lowest height [m] for this tick, so that it leaves the finger slowly and the arm can take its force
            over; -inf: it is not felt.  A surface that is still touched `LEAVING` after it should have gone no longer
            heeds this.
        """
        if not state["withdrawn"].item():
            return target
        if lifted and state["contact_time"].item() < 0.5 * self._clamp:
            state["withdrawn"][...] = 0
            return target
        bottom = self._box[0][2] if self._box is not None else 0.0
        if state["contact_time"].item() > self._clamp + LEAVING:
            return bottom
        return max(bottom, leaves)

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Check one tick."""
        from itouch.monitors import surface_kernels

        seen = surface_kernels.SurfaceObservation(
            float(moment.now), float(moment.time), float(moment.seconds), float(moment.tracking_error),
            float(moment.gap), bool(moment.calibrated),
        )  # fmt: skip
        finger, touch = tuple(float(one) for one in moment.finger), np.array([math.nan, math.nan])
        memory, pose = self.memory(state), self.pose(reading)
        found = surface_kernels.check(self.allowed, memory, self.load(reading), pose, finger, seen, touch)
        if touch[0] == touch[0]:
            moment.touched, moment.force = bool(touch[0]), touch[1].item()
        return found

    def count(self, state: Record, now: float, touched: bool) -> float:
        """Run the clock of T4: forwards in touch, backwards no faster than real time out of it.

        Parameters
        ----------
        state
            Its own fields.
        now
            Session time [s].
        touched
            Whether the finger touches this surface, or another one.

        Returns
        -------
        float
            1, or minus the code of a trip.
        """
        from itouch.monitors.surface_kernels import count

        return count(self.allowed, self.memory(state), float(now), bool(touched))

    @cached_property
    def allowed(self) -> surface_kernels.Allowed:
        """What the surface may do, for compiled code."""
        from itouch.monitors.surface_kernels import Allowed

        return Allowed(
            float(self._force_trip), float(self._clamp), float(self._longest), *(int(trip) for trip in _TRIPS)
        )

    @staticmethod
    def memory(state: Record) -> surface_kernels.Memory:
        """Return what it remembers, for compiled code."""
        from itouch.monitors.surface_kernels import Memory

        return Memory(*(state[name].reshape(-1) if name != "track" else state[name] for name in Memory._fields))

    def pose(self, reading: Record) -> NDArray[np.float64]:
        """Return the view of its reading of its pose, shape (7,) [m; quaternion], or (0,) if there is none."""
        return reading[self._pose] if self._pose else np.zeros(0)

    def load(self, reading: Record) -> surface_kernels.Load:
        """Return the readings of its force sensors, for compiled code."""
        from itouch.monitors.surface_kernels import Load

        sensed = reading.numbers if len(self._sensors) else np.zeros(0)
        return Load(sensed, self._sensors, self._torques, np.array([LEVER]))

    def felt(self, reading: Record, near: surface_kernels.FingerAbove | None = None) -> float:
        """Return the magnitude of the force [N] on the surface; a torque counts as a force, too.

        ``near``: the finger over it, if the noise of a loud sensor is to be averaged out.
        """
        from itouch.monitors.surface_kernels import felt, pressed_by

        return felt(self.load(reading)) if near is None else pressed_by(self.load(reading), near)

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Return which limit was passed, with the value that passed it."""
        a, b = state["figure"].tolist()
        if code == Trip.PLATE_FORCE:
            return f"presses with {a:.1f} N"
        if code == Trip.TRACKING:
            return f"is {a * 1e3:.1f} mm from its command"
        if code == Trip.CONTACT_TIME:
            return f"has been touched for {a:.1f} s"
        if code == Trip.SURFACE_SPEED:
            return ("moves at", "closes in on the finger at", "slides past the finger at")[int(b)] + f" {a:.2f} m/s"
        return f"feels {a:.1f} N with the finger {b * 1e3:.0f} mm away: one of the sensors must be wrong"

    def rule(self, code: int, reading: Record) -> str:
        """Return the rule that a trip belongs to."""
        return _RULES[Trip(code)]

    def rules(self) -> tuple[Rule, ...]:
        """Return T4 and K4 to K6, as far as the surface has sensors for them."""
        by = self.device.source
        found = [
            Rule("T4", "time in contact, less the time out of it", f"withdraws after {self._clamp:g} s",
                 f"{self._longest:g} s", "120 s", by("contact_time")),
        ]  # fmt: skip
        if self._force is not None:
            found.append(
                Rule("K4", "force of the surface on the finger, in all directions", f"yields above {self._force:g} N",
                     f"{self._force_trip:g} N", f"{default.PLATE_FORCE_ABSOLUTE:g} N", by("plate_force"))
            )  # fmt: skip
        if self._pose:
            stray = f"{default.TRACKING_TRIP * 1e3:g} mm for {default.TRACKING_TIME * 1e3:g} ms"
            found += [
                Rule("K5", "speed towards a finger nearer than 20 mm, or past one that touches", f"{self._near:g} m/s",
                     f"{default.SPEED_NEAR_TRIP:g} m/s", "", by("speed")),
                Rule("K5", "speed otherwise", f"{self._speed:g} m/s", f"{default.SPEED_TRIP:g} m/s", "", by("speed")),
                Rule("K6", "distance from its command", f"approach stops at {default.TRACKING * 1e3:g} mm", stray),
            ]  # fmt: skip
        if len(self._sensors):
            found.append(Rule("T8", "force without a finger", "", "0.5 N with the finger 4 mm away for 0.1 s"))
        if self._box is not None:
            corners = zip(*self._box, strict=True)
            box = " × ".join(f"{low * 1e3:g}..{high * 1e3:g}" for low, high in corners)
            found.append(Rule("K6", "travel", f"{box} mm", "", "", default.CEILING))
        return tuple(found)


def _felt_by(device: Watched) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices at which each force sensor begins, shape (n,), and those of its torques that count, (n, 3).

    -1: there is no such torque, or its axis is locked.
    """
    sensors: list[int] = []
    torques: list[list[int]] = []
    at = 0
    for one in device.reads:
        if one.role is Role.CONTACT_FORCE:
            sensors.append(at)
            torques.append([at + axis if axis < one.size and axis not in one.locked else -1 for axis in (3, 4, 5)])
        at += one.size
    return np.array(sensors, np.int64), np.array(torques, np.int64).reshape(-1, 3)
