"""The tracked finger: how fast it may be driven, and how fast it may go (K2)."""

from __future__ import annotations

import math

from itouch.safety.trips import Trip, TripError
from itouch.world import limits as default


def fade(vx: float, vy: float, vz: float) -> float:
    """Return the part of the greatest force that a finger's velocity [m/s] leaves: all of it up to 0.8 m/s.

    Raises
    ------
    TripError
        Above 1.2 m/s.
    """
    square = vx * vx + vy * vy + vz * vz
    if square <= default.ARM_SPEED**2:
        return 1.0
    speed = math.sqrt(square)
    if not speed <= default.ARM_SPEED_TRIP:
        raise TripError(Trip.SPEED, f"moves at {speed:.2f} m/s")
    return (default.ARM_SPEED_TRIP - speed) / (default.ARM_SPEED_TRIP - default.ARM_SPEED)
