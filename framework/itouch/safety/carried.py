"""A surface carried to a finger: how fast, how hard, how long, and whether its sensors can be right (T4, K4-K6).

``Carried`` watches one table on its part of State.  It sees what the table reads and where the tracked finger is.
"""

from __future__ import annotations

import math

from itouch.plugin import Record
from itouch.safety.trips import Trip, TripError
from itouch.world import limits as default
from itouch.world.rig import DeviceModel
from itouch.world.supervision import SLOW, SPEED_WINDOW

#: Force [N] and gap [m] that count as a touch of the plate.
TOUCH_FORCE, TOUCH_GAP = 0.05, 2e-4
#: A force [N] that cannot be where the finger is so far [m] from the plate, and for how long [s] it may seem so; wider
#: before the height is calibrated.
DOUBT_FORCE, DOUBT_GAP, DOUBT_GAP_UNCALIBRATED, DOUBT_TIME = 0.5, 0.004, 0.015, 0.1


class Carried:
    """Watches one carried surface; everything that it remembers is State."""

    def __init__(self, model: DeviceModel, state: Record, reading: Record, period: float) -> None:
        self._limits, self._period = model.limits, period
        self._every = max(1, round(max(SLOW, model.cls.period) / period))
        name = model.name
        self._pose = reading["pose"]
        self._load = reading["wrench"][2:3] if "wrench" in reading else None
        self._strayed, self._clamped = state[f"{name}.strayed"], state[f"{name}.clamped"]
        self._track, self._tracked, self._compared = (state[f"{name}.{n}"] for n in ("track", "tracked", "compared"))
        self.contact_time, self.withdrawn = state[f"{name}.contact_time"], state[f"{name}.withdrawn"]
        self._doubted, self._near_since = state[f"{name}.doubted"], state[f"{name}.near_since"]
        self._force_trip = model.limits.plate_force_trip
        channel = model.command("pose_target")
        self._bottom = channel.low[2] if channel is not None and channel.low else 0.0

    def closing(self, gap: float, strayed: float) -> float:
        """Return how fast [m/s] the surface may approach the finger now (K5); not while it is astray (K6)."""
        if strayed > default.TRACKING:
            self._clamped += 1
            return 0.0
        limits = self._limits
        return (limits.speed_near if gap < default.NEAR else limits.speed) or 0.0

    def follow(self, target: float, lifted: bool) -> float:
        """Return the height [m] to command: the bottom of the travel while it is withdrawn, until the finger lifts."""
        if not self.withdrawn.item():
            return target
        if lifted:
            self.withdrawn[...] = 0
            return target
        self._clamped += 1
        return self._bottom

    def check(self, tick: int, strayed: float, gap: float, calibrated: bool) -> bool | None:
        """Check one tick of an enabled surface.

        Parameters
        ----------
        tick
            The number of the tick.
        strayed
            Distance [m] between the surface and its command.
        gap
            Distance [m] between finger pad and plate as they are tracked; negative while they press.
        calibrated
            Whether the plate's height is known by touch-off.

        Returns
        -------
        bool or None
            Whether the finger touches the plate, every 10 ms; None in between.

        Raises
        ------
        TripError
            Naming the limit and the value.
        """
        self._near_command(strayed)
        load = abs(self._load.item()) if self._load is not None else 0.0
        if load > self._force_trip:
            raise TripError(Trip.PLATE_FORCE, f"presses with {load:.1f} N")
        if tick % self._every:
            return None
        touched = load > TOUCH_FORCE or (calibrated and gap < TOUCH_GAP)
        self._count_contact(touched)
        self._speed(tick, gap)
        self._doubt(load, gap, calibrated)
        return touched

    def _near_command(self, strayed: float) -> None:
        if strayed <= default.TRACKING_TRIP:
            if self._strayed.item():
                self._strayed[...] = 0
            return
        count = self._strayed.item() + 1
        self._strayed[...] = count
        if count * self._period > default.TRACKING_TIME:
            raise TripError(Trip.TRACKING, f"is {strayed * 1e3:.1f} mm from its command")

    def _count_contact(self, touched: bool) -> None:
        """Withdraw after the longest contact; trip if the plate is still touched long after (T4)."""
        if not touched:
            self.contact_time[...] = 0.0
            return
        passed = self.contact_time.item() + self._every * self._period
        self.contact_time[...] = passed
        if passed > self._limits.contact_time_trip:
            raise TripError(Trip.CONTACT_TIME, f"has been touched for {passed:.1f} s")
        if passed > (self._limits.contact_time or default.CONTACT_TIME):
            self.withdrawn[...] = 1

    def _speed(self, tick: int, gap: float) -> None:
        """Trip on a speed, a mean over 50 ms, that no command can have asked for (K5)."""
        self._note_near(tick, gap)
        known = self._tracked.item() if tick - self._compared.item() == self._every else 0  # 0: after a pause
        here, window = self._pose[:3].tolist(), SPEED_WINDOW * self._every * self._period
        self._track[known % (SPEED_WINDOW + 1)] = here
        self._tracked[...] = known + 1
        self._compared[...] = tick
        if known < SPEED_WINDOW:
            return
        before = self._track[(known - SPEED_WINDOW) % (SPEED_WINDOW + 1)].tolist()
        speed, closing = math.dist(here, before) / window, (here[2] - before[2]) / window
        if speed > default.SPEED_TRIP:
            raise TripError(Trip.SURFACE_SPEED, f"moves at {speed:.2f} m/s")
        # what was far when the window began may have come near at the speed that is allowed there
        near = self._near_since.item()
        if near >= 0 and tick - near >= SPEED_WINDOW * self._every and closing > default.SPEED_NEAR_TRIP:
            raise TripError(Trip.SURFACE_SPEED, f"closes in on the finger at {closing:.2f} m/s")

    def _note_near(self, tick: int, gap: float) -> None:
        near = self._near_since.item()
        if gap >= default.NEAR:
            self._near_since[...] = -1
        elif near < 0:
            self._near_since[...] = tick

    def _doubt(self, load: float, gap: float, calibrated: bool) -> None:
        """Trip if force sensor and tracked finger disagree: a force without a finger (T8)."""
        far = gap > (DOUBT_GAP if calibrated else DOUBT_GAP_UNCALIBRATED)
        if load <= DOUBT_FORCE or not far:
            self._doubted[...] = 0.0
            return
        passed = self._doubted.item() + self._every * self._period
        self._doubted[...] = passed
        if passed > DOUBT_TIME:
            cause = f"feels {load:.1f} N with the finger {gap * 1e3:.0f} mm away: one of the sensors must be wrong"
            raise TripError(Trip.SENSOR_DISAGREE, cause)

    def forget(self) -> None:
        """Forget what was measured."""
        self._strayed[...] = 0
        self._compared[...] = self._near_since[...] = -1
        self.contact_time[...] = self._doubted[...] = 0.0
        self.withdrawn[...] = 0
