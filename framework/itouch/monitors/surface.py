"""A surface carried to a finger: how fast, how hard, how long, and whether its sensors can be right (T4, K4-K6)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from itouch.monitors import limits as default
from itouch.monitors.trips import Trip
from itouch.plugin import Field, Moment, Monitor, Record, Role, Rule, Watched

if TYPE_CHECKING:
    from itouch.monitors import carried

#: Force [N] that counts as a touch of the plate; gap [m] that does, too, once the height is known.
TOUCH_FORCE, TOUCH_GAP = 0.03, 2e-4
#: Gap [m] that counts where nothing measures the force: then the height is known from the mount only.
TOUCH_GUESS = 1e-3
#: A force [N] that cannot be where the finger is so far [m] from the plate, and for how long [s] it may seem so; wider
#: before the height is calibrated.
DOUBT_FORCE, DOUBT_GAP, DOUBT_GAP_UNCALIBRATED, DOUBT_TIME = 0.5, 0.004, 0.015, 0.1
#: Arm [m] with which a torque counts as a force (K4).
LEVER = 0.1
#: Seconds between two of the slower checks, and time [s] that a surface's speed is taken over (K5).
SLOW, SPEED_TIME = 0.010, 0.050
#: A little less: times are sums of periods.
_DUE, _WINDOW = SLOW - 1e-7, SPEED_TIME - 1e-7
#: Places that are remembered: those of a bit more than the window.
SLOTS = 16
_TRIPS = (Trip.PLATE_FORCE, Trip.TRACKING, Trip.CONTACT_TIME, Trip.SURFACE_SPEED, Trip.SENSOR_DISAGREE)
_RULES = {
    Trip.PLATE_FORCE: "K4", Trip.TRACKING: "K6", Trip.CONTACT_TIME: "T4", Trip.SURFACE_SPEED: "K5",
    Trip.SENSOR_DISAGREE: "T8",
}  # fmt: skip


class Surface(Monitor):
    """Watches one carried surface."""

    name = "surface"
    placed: ClassVar[bool] = True
    moments: ClassVar[tuple[str, ...]] = ("counted", "near_since", "looked", "track")
    trips: ClassVar[Mapping[int, str]] = {int(trip): trip.label for trip in _TRIPS}

    def __init__(self, device: Watched) -> None:
        super().__init__(device)
        pose, load = device.reading(Role.TRACKED_POSE), device.reading(Role.CONTACT_FORCE)
        self._pose, self._load = (channel.name if channel is not None else "" for channel in (pose, load))
        locked = load.locked if load is not None else ()
        self._torques = [axis for axis in range(3, load.size if load is not None else 3) if axis not in locked]
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
        """The surface's target, if it is known where the surface is."""
        return (self._target,) if self._pose else ()

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (
            Field("contact_time", low=0.0, unit="s", doc="how long it has been touched; falls while it is not (T4)"),
            Field("withdrawn", "i8", unit="1", doc="1 while it is withdrawn because of T4"),
            Field("counted", unit="s", doc="when that clock was looked at last"),
            Field("strayed_for", low=0.0, unit="s", doc="for how long it has been astray (K6)"),
            Field("doubted", low=0.0, unit="s", doc="for how long a force without a finger has been felt (T8)"),
            Field("near_since", unit="s", doc="since when the finger has been near; NaN: it is not (K5)"),
            Field("looked", unit="s", doc="when it was looked at last; NaN: after a pause"),
            Field("places", "i8", low=0, unit="1", doc="how many places are remembered"),
            Field(
                "track", "f8", (SLOTS, 7), unit="mixed", doc="times [s], places of the surface and of the finger [m]"
            ),
            Field("figure", "f8", 2, unit="mixed", doc="the figures of the last trip"),
        )

    def reset(self, state: Record) -> None:
        """Begin a session."""
        state["counted"][...] = math.nan
        self.forget(state)

    def forget(self, state: Record) -> None:
        """Forget what was measured, not for how long it was touched."""
        state["strayed_for"][...] = state["doubted"][...] = 0.0
        state["near_since"][...] = state["looked"][...] = math.nan
        state["places"][...] = 0

    @property
    def paces(self) -> tuple[float, float, float, float]:
        """The distance [m] from its command that stops it, that at which a finger is near, and its speeds [m/s]."""
        return default.TRACKING, default.NEAR, self._near, self._speed

    def closing(self, gap: float, strayed: float) -> float:
        """Return how fast [m/s] the surface may approach the finger now (K5); not while it is astray (K6)."""
        from itouch.monitors.carried import pace  # the compiler is loaded when a device runs

        return pace(gap, strayed, *self.paces)

    def follow(self, state: Record, target: float, lifted: bool) -> float:
        """Return the height [m] to command: the bottom of the travel while it is withdrawn (T4).

        It touches again when the finger has lifted, and the clock of T4 has fallen below half of its clamp.
        """
        if not state["withdrawn"].item():
            return target
        if lifted and state["contact_time"].item() < 0.5 * self._clamp:
            state["withdrawn"][...] = 0
            return target
        return self._box[0][2] if self._box is not None else 0.0

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Check one tick."""
        astray = self._astray(state, moment)
        load = self.felt(reading)
        if astray or load > self._force_trip:
            state["figure"][0] = moment.strayed if astray else load
            return -float(Trip.TRACKING if astray else Trip.PLATE_FORCE)
        looked = state["looked"].item()
        if moment.now - looked < _DUE:
            return 1.0
        passed = moment.now - looked if looked == looked else 0.0
        state["looked"][...] = moment.now
        near = TOUCH_GAP if moment.calibrated else 0.0 if self._load else TOUCH_GUESS
        touched = load > TOUCH_FORCE or (near > 0.0 and moment.gap < near)
        moment.touched, moment.force = touched, load if self._load else math.nan
        found = self._moves(state, reading, moment) or self._doubt(state, load, passed, moment)
        return found or 1.0

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
        counted = state["counted"].item()
        if now - counted < _DUE:
            return 1.0
        seconds = now - counted if counted == counted else 0.0
        state["counted"][...] = now
        passed = max(0.0, state["contact_time"].item() + (seconds if touched else -seconds))
        state["contact_time"][...] = passed
        if passed > self._longest:
            state["figure"][0] = passed
            return -float(Trip.CONTACT_TIME)
        if passed > self._clamp:
            state["withdrawn"][...] = 1
        return 1.0

    def load(self, reading: Record) -> carried.Load:
        """Return what its sensor reads of the force on it, as compiled code takes it."""
        from itouch.monitors.carried import Load

        sensed = reading[self._load] if self._load else np.zeros(0)
        return Load(sensed, np.array(self._torques if self._load else (), np.int64), np.array([LEVER]))

    def felt(self, reading: Record) -> float:
        """Return the force [N] on the surface in whatever direction; a torque counts as a force, too."""
        from itouch.monitors.carried import felt

        return felt(self.load(reading))

    @property
    def most(self) -> tuple[float, float, float]:
        """The distance [m] and force [N] beyond which more than a glance is needed, and the time [s] between looks."""
        return default.TRACKING_TRIP, float(self._force_trip), _DUE

    def _astray(self, state: Record, moment: Moment) -> bool:
        """Tell whether the surface has been away from its command for too long (K6)."""
        if not moment.strayed > default.TRACKING_TRIP:
            if state["strayed_for"].item():
                state["strayed_for"][...] = 0.0
            return False
        state["strayed_for"][...] = passed = state["strayed_for"].item() + moment.seconds
        return bool(passed > default.TRACKING_TIME + 1e-9)

    def _moves(self, state: Record, reading: Record, moment: Moment) -> float:
        """Trip on a speed, a mean over 50 ms, that no command can have asked for (K5)."""
        near = state["near_since"].item()
        if not moment.gap < default.NEAR:
            state["near_since"][...] = near = math.nan
        elif near != near:
            state["near_since"][...] = near = moment.now
        if not self._pose:
            return 0.0
        here = (moment.time, *reading[self._pose][:3].tolist(), *moment.finger)
        before = self._before(state, here)
        if before is None:
            return 0.0
        window = here[0] - before[0]
        way = [a - b for a, b in zip(here[1:4], before[1:4], strict=True)]
        speed, closing = math.hypot(*way) / window, way[2] / window
        if speed > default.SPEED_TRIP:
            state["figure"][:] = (speed, 0.0)
            return -float(Trip.SURFACE_SPEED)
        # what was far when the window began may have come near at the speed that is allowed there
        if near != near or moment.now - near < window - 1e-7:
            return 0.0
        if closing > default.SPEED_NEAR_TRIP:
            state["figure"][:] = (closing, 1.0)
            return -float(Trip.SURFACE_SPEED)
        past = math.hypot(*(way[i] - (here[4 + i] - before[4 + i]) for i in range(2))) / window
        if moment.touched and min(past, math.hypot(way[0], way[1]) / window) > default.SPEED_NEAR_TRIP:
            state["figure"][:] = (past, 2.0)
            return -float(Trip.SURFACE_SPEED)
        return 0.0

    @staticmethod
    def _before(state: Record, here: tuple[float, ...]) -> list[float] | None:
        """Note where surface and finger are, and return where they were at least 50 ms ago; None if not known."""
        count, track = state["places"].item(), state["track"]
        if count and here[0] - track[(count - 1) % SLOTS, 0] < _DUE:
            return None
        if count and here[0] - track[(count - 1) % SLOTS, 0] > 4 * SPEED_TIME:
            count = 0
        track[count % SLOTS] = here
        state["places"][...] = count + 1
        known = track[np.arange(max(0, count + 1 - SLOTS), count + 1) % SLOTS]
        older = known[known[:, 0] <= here[0] - _WINDOW]
        return older[-1].tolist() if len(older) else None

    def _doubt(self, state: Record, load: float, passed: float, moment: Moment) -> float:
        """Trip if force sensor and tracked finger disagree: a force without a finger (T8)."""
        far = moment.gap > (DOUBT_GAP if moment.calibrated else DOUBT_GAP_UNCALIBRATED)
        if load <= DOUBT_FORCE or not far:
            state["doubted"][...] = 0.0
            return 0.0
        state["doubted"][...] = doubted = state["doubted"].item() + passed
        if doubted <= DOUBT_TIME + 1e-9:
            return 0.0
        state["figure"][:] = (load, moment.gap)
        return -float(Trip.SENSOR_DISAGREE)

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Say which limit was passed, by how much."""
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
        if self._load:
            found.append(Rule("T8", "force without a finger", "", "0.5 N with the finger 4 mm away for 0.1 s"))
        if self._box is not None:
            corners = zip(*self._box, strict=True)
            box = " × ".join(f"{low * 1e3:g}..{high * 1e3:g}" for low, high in corners)
            found.append(Rule("K6", "travel", f"{box} mm", "", "", default.CEILING))
        return tuple(found)
