"""What each command is when its device must be safe: a drive is off, a surface retracts, whatever was left open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from itouch.plugin import HOLD, HURTING, RETRACT, Channel, Role
from itouch.schema import Place, Problem
from itouch.world import limits as default
from itouch.world.limits import DeviceLimits

#: Roles whose command acts by its size: nothing is what is safe.
_ACTING = HURTING - {Role.SURFACE_POSE, Role.TEMPERATURE_TARGET}


def with_safe_values(commands: Sequence[Channel], limits: DeviceLimits) -> tuple[Channel, ...]:
    """Return the commands of a device, each with what it is when the device must be safe.

    A drive that is held would go on heating or pressing after a trip: it is off, or as little as its range allows.  A
    temperature that is held goes to the middle of the limits, unless something switches the output off.  A surface
    whose plugin says nothing retracts.
    """
    switched = any(channel.role is Role.OUTPUT_SWITCH for channel in commands)
    return tuple(_resolved(channel, limits, switched) for channel in commands)


def _resolved(channel: Channel, limits: DeviceLimits, switched: bool) -> Channel:
    held = channel.safe is None or channel.safe is HOLD
    if channel.role in _ACTING and not isinstance(channel.safe, tuple):
        return replace(channel, safe=_least(channel))
    if channel.role is Role.TEMPERATURE_TARGET and held and not switched:
        low, high = limits.temperature or default.PLATE_TEMPERATURE
        return replace(channel, safe=(0.5 * (low + high),) * channel.size)
    if channel.role is Role.SURFACE_POSE and channel.safe is None and channel.low:
        return replace(channel, safe=RETRACT)
    return channel


def _least(channel: Channel) -> tuple[float, ...]:
    """Return what of the range of a channel is nearest to nothing."""
    if not channel.low or not channel.high:
        return (0.0,) * channel.size
    return tuple(min(max(0.0, low), high) for low, high in zip(channel.low, channel.high, strict=True))


def acting_at_rest(name: str, commands: Sequence[Channel], place: Place | None) -> Iterator[Problem]:
    """Find drives whose plugin calls another value safe than none."""
    for channel in commands:
        if channel.role in _ACTING and isinstance(channel.safe, tuple) and channel.safe != _least(channel):
            shown = " ".join(f"{value:g}" for value in channel.safe)
            sentence = f"device '{name}': command '{channel.name}' calls {shown} {channel.unit} safe, but that acts"
            advice = "its author must make it 0, or the least that it can be"
            yield Problem("plugin-failed", sentence, place, advice)
