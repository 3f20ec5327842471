"""The guard before each device: no command passes that is beyond ceilings, limits, slew rate or ramp-in.

First the hardware's ceiling, then the limits in force, then ramp and slew; a command that is not a number trips.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import Trip, TripError
from itouch.monitors import default_limits as default
from itouch.monitors.default_limits import DeviceLimits
from itouch.monitors.readings import not_finite
from itouch.monitors.thresholds import COLDEST_TARGET
from itouch.plugin import HURTING, RETRACT, Bound, Channel, Role
from itouch.safety import limiting

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]


#: Lowest and highest height [m] to which a safe command may send a surface; NaN: as far as its travel goes.
ANYWHERE = math.nan, math.nan


class Guard:
    """Limits one command channel; compiled code applies the limits, both in a tick and in ``limit``."""

    __slots__ = ("_limits", "bounds", "channel")

    def __init__(self, channel: Channel, limits: DeviceLimits) -> None:
        self.channel, self._limits = channel, limits
        self.bounds = _bounds(channel, limits)

    def limit(
        self, wanted: Floats, sent: Floats, share: float, period: float, closing: float, room: float = math.inf
    ) -> tuple[int, int]:
        """Limit a command, and write what may be sent.

        Parameters
        ----------
        wanted, sent
            The command requested, and the one sent last, which is overwritten: (n,) each, in the channel's unit.
        share
            0 to 1: the part of force, current or speed that is let through (by the ramp, or near a limit).
        period
            Seconds since the last command.
        closing
            Greatest speed [m/s] at which a surface may approach the finger now.
        room
            Force [N] that everything else that pushes on the finger leaves.

        Returns
        -------
        tuple
            How many limits were applied, and how many locked components were dropped.

        Raises
        ------
        TripError
            If the command is not a number.
        """
        counts = np.zeros((2, 1), np.int64)
        moving = limiting.TickLimits.of(share, closing, room)
        if self.bound(moving, wanted, sent, counts[0], counts[1], period)():
            raise self.refusal(wanted)
        return int(counts[0, 0]), int(counts[1, 0])

    def bound(
        self, moving: limiting.TickLimits, wanted: Floats, sent: Floats, clamped: Counts, dropped: Counts,
        period: float, among: int = 1,
    ) -> Bound:  # fmt: skip
        """Return ``limit`` on these views as one compiled call, which counts the limits applied and components dropped.

        The call returns 0, or another number if the command is not a number, for which `refusal` gives the trip.

        ``wanted`` and ``sent`` (n,) are in the channel's unit, ``clamped`` and ``dropped`` (1,) counts;
        ``period`` [s]; ``among``: how many channels of the device share the greatest increase of force.
        """
        growth = default.FORCE_SLEW * period / among
        return Bound(limiting.limit, self.bounds, moving, wanted, sent, clamped, dropped, period, growth)

    def refusal(self, wanted: Floats) -> TripError:
        """Return the trip of a command (n,), in the channel's unit, that is not a number."""
        return TripError(Trip.NOT_A_NUMBER, f"was commanded with {not_finite(wanted.tolist())} ({self.channel.name})")

    def safe(
        self, sent: Floats, period: float, *, backwards: bool = False, ends: tuple[float, float] = ANYWHERE
    ) -> None:
        """Write the channel's safe command: a value, or hold, or retract along -z as fast as is allowed.

        ``sent`` (n,): the command sent last, which is overwritten, in the channel's unit; ``period`` [s];
        ``backwards``: retract along +z instead, for a drive that has been seen to go the wrong way; ``ends``: lowest
        and highest height [m] to which retracting may lead, NaN: as far as the travel goes.
        """
        channel = self.channel
        safe, step = channel.safe, (self._limits.speed or 0.0) * period
        if isinstance(safe, tuple):
            sent[:] = safe
        elif safe is RETRACT and channel.low:
            stands, (lowest, highest) = sent[2].item(), ends
            if backwards:
                goal = min(channel.high[2], stands + step)
                sent[2] = goal if math.isnan(highest) else min(goal, max(highest, stands))
            else:
                goal = max(channel.low[2], stands - step)
                sent[2] = goal if math.isnan(lowest) else max(goal, min(lowest, stands))


def _bounds(channel: Channel, limits: DeviceLimits) -> limiting.Bounds:
    """Return the limits of a channel for compiled code."""
    shut = _locked_components(channel)
    both = zip(channel.low, channel.high, strict=True)
    torques = [min(abs(low), abs(high)) for low, high in both] or [0.0] * channel.size
    torques = [most if math.isfinite(most) else 0.0 for most in torques]
    turns = [rest for index, rest in shut if index >= 3]
    free = (3, 4, 5) if channel.role is Role.FORCE_ON_OPERATOR and len(turns) != channel.size - 3 else ()
    low, high = limits.temperature or default.PLATE_TEMPERATURE
    figures = (limits.force or 0.0, limits.speed or 0.0, low, high, limits.torque or 0.0)
    return limiting.Bounds(
        np.array([_kind(channel)]), np.array([index for index, _ in shut], np.int64),
        _row([rest for _, rest in shut]), _row(channel.low), _row(channel.high), _ceilings(channel, limits),
        _row(torques), _row(channel.slew), _row(figures), np.array(free, np.int64), _off(channel),
        np.zeros(channel.size),
    )  # fmt: skip


def _row(numbers: Sequence[float]) -> Floats:
    return np.array(numbers, np.float64)


def _kind(channel: Channel) -> int:
    """Return how a channel is limited, by its role."""
    kinds = {
        Role.FORCE_ON_OPERATOR: limiting.WRENCH, Role.SURFACE_POSE: limiting.POSE,
        Role.TEMPERATURE_TARGET: limiting.TEMPERATURE,
    }  # fmt: skip
    return kinds.get(channel.role, limiting.DRIVE if channel.role in HURTING else limiting.PLAIN)


def _off(channel: Channel) -> Floats:
    """Return for each component the value that switches it off: its safe value if that is no temperature, else NaN."""
    safe = channel.safe if isinstance(channel.safe, tuple) else (math.nan,) * channel.size
    return _row([value if value < COLDEST_TARGET else math.nan for value in safe])


def _ceilings(channel: Channel, limits: DeviceLimits) -> Floats:
    """Return the greatest magnitude of each component, negative and positive, shape (2, n); infinite: there is none."""
    given = channel.low, channel.high
    hardware: Floats = np.abs(np.array(given, np.float64)) if channel.high else np.full((2, channel.size), math.inf)
    if channel.role is Role.DRIVE and channel.unit == "A":
        hardware = np.minimum(hardware, limits.current or 0.0)
    return hardware


def _locked_components(channel: Channel) -> tuple[tuple[int, float], ...]:
    """Return the components that locked degrees of freedom fix, with their resting values."""
    if channel.size == 7:
        turned = [axis for axis in channel.locked if axis >= 3]
        shut = [(axis, 0.0) for axis in channel.locked if axis < 3]
        rest = [(3, 1.0), (4, 0.0), (5, 0.0), (6, 0.0)] if len(turned) == 3 else []
        return tuple(shut + rest)
    return tuple((axis, 0.0) for axis in channel.locked if axis < channel.size)
