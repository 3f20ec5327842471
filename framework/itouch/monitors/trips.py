"""Trips: every reason for which a device is stopped, with its number; each is put into words where it is raised."""

from __future__ import annotations

import enum
from typing import Any

from itouch.schema import ItouchError


class Trip(enum.IntEnum):
    """Why a device was stopped; latched in State."""

    NONE = 0
    NOT_A_NUMBER = 1
    SENSOR_RANGE = 2
    PLATE_TEMPERATURE = 3
    SINK_TEMPERATURE = 4
    PLATE_FORCE = 5
    TRACKING = 6
    SPEED = 7
    SILENT = 8
    DEVICE_ERROR = 9
    CALIBRATION = 10
    OVERRUN = 11
    DOSE = 12
    CONTACT_TIME = 13
    PLATE_RATE = 14
    FLUX = 15
    SENSOR_JUMP = 16
    SENSOR_FROZEN = 17
    SENSOR_DISAGREE = 18
    RUNAWAY = 19
    RELEASED = 20
    SURFACE_SPEED = 21
    MODALITY_ERROR = 22
    MONITOR = 23
    MONITOR_ERROR = 24
    COLD = 25
    FINGER_FORCE = 26
    FINGER_TORQUE = 27

    @property
    def label(self) -> str:
        """Its name in reports."""
        return self.name.lower().replace("_", "-")


#: Trips after which a device's own readings are not believed any more.
DOUBTS = frozenset({
    Trip.NOT_A_NUMBER, Trip.SENSOR_RANGE, Trip.SENSOR_JUMP, Trip.SENSOR_FROZEN, Trip.SENSOR_DISAGREE, Trip.SILENT,
    Trip.DEVICE_ERROR,
})  # fmt: skip
#: Trips that mean that a device is lost: a session may go on without an optional one.
LOSSES = frozenset({Trip.SILENT, Trip.DEVICE_ERROR})


class TripError(ItouchError):
    """A limit was passed: which one, and by what value."""

    def __init__(self, trip: Trip, sentence: str) -> None:
        super().__init__(sentence)
        self.trip = trip

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to another process whole: by default only the sentence would."""
        return type(self), (self.trip, str(self))


class DeviceFaultError(ItouchError):
    """A device that was stopped while the loop ran: which, when, and why."""

    exit_code = 1

    def __init__(self, device: str, tick: int, trip: Trip, cause: str) -> None:
        super().__init__(f"device '{device}' {cause} at tick {tick}")
        self.device, self.tick, self.trip, self.cause = device, tick, trip, cause

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to another process whole: by default only the sentence would."""
        return type(self), (self.device, self.tick, self.trip, self.cause)
