"""Touch-off: at start the plate rises until it is felt, at three points or more; that gives the table's true height.

While the force grows from a touch to 0.3 N, the height of the plate against the finger is fitted over the force; where
the line meets zero force the plate just touched, however soft the finger pad is.  Only the height can be found with a
flat plate; the result is the State field ``DEVICE.calibration``.
"""

from __future__ import annotations

import enum
import math

from itouch.loop import render
from itouch.loop.frames import Vector
from itouch.loop.runner import DeviceFaultError, Runner
from itouch.loop.touch import Toucher
from itouch.plugin import Record, Role
from itouch.safety import Trip

#: Speed of the rising plate [m/s], force that ends it and force from which samples count [N].
RISE, FORCE, SAMPLE = 0.005, 0.3, 0.05
#: How far below the finger the slow rise begins, and how far the plate drops between points, where the skin has time to
#: lose what it was warmed [m].
MARGIN, DROP = 0.0079, 0.003
#: Distance of the touched points from the plate's centre [m].
SPREAD = 0.006
#: How far below the end of its travel the plate should meet the finger: mounts are wrong, and hands give way [m].
ROOM = 0.012
_ARRIVED = 3e-4


class TouchOffPhase(enum.IntEnum):
    """Where a touch-off stands."""

    PLACE = 0
    RISE = 1
    RELEASE = 2
    DONE = 3


class TouchOff:
    """Finds the height of one table's mount on its part of State."""

    def __init__(self, table: Runner, toucher: Toucher, offset: Vector, state: Record, period: float) -> None:
        self._table, self._toucher, self._offset, self._period = table, toucher, offset, period
        self._radius = toucher.probe.scene.radius
        name = table.model.name
        part = f"{name}.touch_off"
        self.stage, self.point = state[f"{part}.stage"], state[f"{part}.point"]
        self._sums, self._offsets = state[f"{part}.sums"], state[f"{part}.offsets"]
        self._target, self._calibration = state[f"{part}.target"], state[f"{name}.calibration"]
        self._tick = state["tick"]
        self._count = table.model.touch_off
        self._pose, self._felt = table.read_as(Role.TRACKED_POSE), table.read_as(Role.CONTACT_FORCE)
        self._goal = table.commanded(Role.SURFACE_POSE)
        channel = table.model.command(Role.SURFACE_POSE)
        self._low, self._high = (channel.low[2], channel.high[2]) if channel else (0.0, 0.0)

    @property
    def done(self) -> bool:
        """Whether the height is known."""
        return int(self.stage) == TouchOffPhase.DONE

    def reset(self) -> None:
        """Begin anew."""
        self.stage[...] = TouchOffPhase.PLACE
        self.point[...] = 0
        self._target[...] = math.nan

    def highest_finger(self) -> float:
        """Return the greatest height [m] of the finger's centre at which the plate can still press on it."""
        x, y, z = self._offset
        return self._table.base_frame().point((x, y, z + self._high))[2] + self._radius - ROOM

    def update(self) -> None:
        """Command the table for this tick.

        Raises
        ------
        DeviceFaultError
            If the plate was not felt up to the end of its travel.
        """
        position = self._pose.tolist()
        force = abs(self._felt[2].item())
        under = self._under()
        if math.isnan(float(self._target)):
            self._target[...] = min(max(self._low, under[2] - MARGIN), self._high)
        stage = TouchOffPhase(int(self.stage))
        if stage is TouchOffPhase.PLACE:
            self._place(position, under, force)
        elif stage is TouchOffPhase.RISE:
            self._rise(force)
        else:
            self._release(position)
        goal = (under[0], under[1], float(self._target))
        self._goal[:] = (*goal, 1.0, 0.0, 0.0, 0.0)
        self._table.closing = self._table.model.limits.speed_near or 0.0

    def _under(self) -> tuple[float, float, float]:
        """Return where the table must go, in its frame, for this point of the plate to touch the finger."""
        x, y, z = self._toucher.figures[:3].tolist()
        offset = self._offset
        there = self._table.base_frame().into((x, y, z - self._radius))
        angle = math.pi / 2 + 2 * math.pi * int(self.point) / self._count
        return (
            there[0] - offset[0] + SPREAD * math.cos(angle),
            there[1] - offset[1] + SPREAD * math.sin(angle),
            there[2] - offset[2],
        )

    def _place(self, position: list[float], under: tuple[float, float, float], force: float) -> None:
        if force > FORCE / 3:  # touched already: the mount is higher than it says
            self._target[...] = max(self._low, float(self._target) - DROP * 50 * self._period)
            return
        goal = (under[0], under[1], float(self._target))
        if all(abs(p - g) < _ARRIVED for p, g in zip(position, goal, strict=False)):
            self._sums[:] = 0.0
            self.stage[...] = TouchOffPhase.RISE

    def _rise(self, force: float) -> None:
        if force > SAMPLE:
            figures = self._toucher.figures
            height = figures[render.PLATE_TOP].item() - (figures[2].item() - self._radius)
            n, f, h, fh, ff = self._sums.tolist()
            self._sums[:] = (n + 1, f + force, h + height, fh + force * height, ff + force * force)
        if force >= FORCE:
            self._offsets[int(self.point)] = _at_zero_force(self._sums.tolist())
            self._target[...] = float(self._target) - DROP
            self.stage[...] = TouchOffPhase.RELEASE
            return
        if float(self._target) >= self._high:
            cause = "was raised to the end of its travel and felt no finger (touch-off); begin the motion lower"
            raise DeviceFaultError(self._table.model.name, int(self._tick), Trip.CALIBRATION, cause)
        self._target[...] = min(self._high, float(self._target) + RISE * self._period)

    def _release(self, position: list[float]) -> None:
        if abs(position[2] - float(self._target)) > _ARRIVED:
            return
        if int(self.point) + 1 < self._count:
            self.point += 1
            self.stage[...] = TouchOffPhase.PLACE
            return
        height = float(self._offsets.mean())
        self._calibration[2] -= height
        self.stage[...] = TouchOffPhase.DONE


def _at_zero_force(sums: list[float]) -> float:
    """Return the height at zero force of the line through the samples."""
    n, f, h, fh, ff = sums
    spread = n * ff - f * f
    if n < 5 or spread <= 1e-9:
        return h / n
    slope = (n * fh - f * h) / spread
    return (h - slope * f) / n
