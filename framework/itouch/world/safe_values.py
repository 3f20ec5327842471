"""The safe value of each command: a drive is off, a surface retracts; what a plugin has left open is filled in."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from itouch.monitors.default_limits import TIMELY
from itouch.monitors.thresholds import COLDEST_TARGET
from itouch.plugin import HURTING, RETRACT, Channel, Device, Role
from itouch.schema import Place, Problem
from itouch.world import limits as default
from itouch.world.limits import DeviceLimits

#: Roles whose commands act by their magnitude, so that zero is safe.
_ACTING = (HURTING - {Role.SURFACE_POSE, Role.TEMPERATURE_TARGET}) | {Role.OUTPUT_SWITCH}


def with_safe_values(commands: Sequence[Channel], limits: DeviceLimits) -> tuple[Channel, ...]:
    """Return the commands of a device, each with its safe value.

    A drive or a switch that were held would go on heating or pressing after a trip: its safe value is off, or as little
    as its range allows.  A temperature target goes to the middle of what limits and range leave, unless a switch turns
    the output off; one that its plugin calls safe is brought within the limits.  A surface whose plugin says nothing
    retracts.
    """
    switched = any(channel.role is Role.OUTPUT_SWITCH for channel in commands)
    return tuple(_resolved(channel, limits, switched) for channel in commands)


def _resolved(channel: Channel, limits: DeviceLimits, switched: bool) -> Channel:
    if channel.role in _ACTING and not isinstance(channel.safe, tuple):
        return replace(channel, safe=_least(channel))
    if channel.role is Role.TEMPERATURE_TARGET:
        return _resolved_target(channel, limits.temperature or default.PLATE_TEMPERATURE, switched)
    if channel.role is Role.SURFACE_POSE and channel.safe is None and channel.low:
        return replace(channel, safe=RETRACT)
    return channel


def _resolved_target(channel: Channel, limits: tuple[float, float], switched: bool) -> Channel:
    """Return a temperature target whose safe value is off, left to a switch, or within the limits."""
    bounds = [_within(limits, low, high) for low, high in _ranges(channel)]
    if isinstance(channel.safe, tuple):
        kept = (
            value if value < COLDEST_TARGET else min(max(value, low), high)
            for value, (low, high) in zip(channel.safe, bounds, strict=True)
        )
        return replace(channel, safe=tuple(kept))
    return channel if switched else replace(channel, safe=tuple(0.5 * (low + high) for low, high in bounds))


def _within(limits: tuple[float, float], low: float, high: float) -> tuple[float, float]:
    """Return the part of the limits within a range, or the end of the range that is nearest to them."""
    return min(max(limits[0], low), high), max(min(limits[1], high), low)


def _ranges(channel: Channel) -> list[tuple[float, float]]:
    if not channel.low or not channel.high:
        return [(-math.inf, math.inf)] * channel.size
    return list(zip(channel.low, channel.high, strict=True))


def _least(channel: Channel) -> tuple[float, ...]:
    """Return the values in the range of a channel that are nearest to zero."""
    return tuple(min(max(0.0, low), high) for low, high in _ranges(channel))


def acting_at_rest(name: str, commands: Sequence[Channel], place: Place | None) -> Iterator[Problem]:
    """Find drives and switches whose plugin calls a value safe that still acts."""
    for channel in commands:
        if channel.role in _ACTING and isinstance(channel.safe, tuple) and channel.safe != _least(channel):
            shown = " ".join([*(f"{value:g}" for value in channel.safe), channel.shown_unit]).rstrip()
            sentence = f"device '{name}': command '{channel.name}' calls {shown} safe, but that acts"
            advice = "its author must make it 0, or the least that it can be"
            yield Problem("plugin-failed", sentence, place, advice)


def too_slow(cls: type[Device], watchdog: float) -> str:
    """Return why readings of a device can't be as new as its watchdog [s] demands; empty: they can."""
    for what, time in (("exchanges every", cls.period), ("takes for an exchange", cls.delay)):
        if time > watchdog:
            return f"{what} {time:g} s, but a reading may be {watchdog:g} s old at most (W1)"
    return ""


def oldest(cls: type[Device], params: Any, *, twin: bool) -> float:
    """Return how old [s] a reading of a device behind a wire gets before the next one comes; 0: there is no wire.

    A twin's reading was measured when its exchange began.  That of hardware was measured in the middle of the exchange,
    unless its driver tells otherwise (`Timestamps`), and the next exchange may begin ``command_wait`` seconds later.
    """
    if not cls.blocking:
        return 0.0
    if twin:
        return cls.delay + max(cls.period, cls.delay)
    takes = max(cls.exchange_time_for(params), cls.delay)
    return 0.5 * takes + max(cls.period, takes) + cls.command_wait


def stale(
    name: str, cls: type[Device], params: Any, reads: Sequence[Channel], watchdog: float, tick: float,
    place: Place | None, *, twin: bool,
) -> Iterator[Problem]:  # fmt: skip
    """Find a device whose readings get older between two exchanges than its watchdog [s] allows (W1).

    ``tick``: period of the loop [s], to which it is known when a reading was measured.
    """
    timely = [channel.name for channel in reads if channel.role in TIMELY]
    age = oldest(cls, params, twin=twin)
    if not timely or age + tick <= watchdog + 1e-9:
        return
    every = max(cls.period, cls.delay, 0.0 if twin else cls.exchange_time_for(params)) + (
        0.0 if twin else cls.command_wait
    )
    certain = twin or every > watchdog
    sentence = (
        f"device '{name}': with an exchange every {every * 1e3:.3g} ms its readings ({', '.join(timely)}) get "
        f"{age * 1e3:.3g} ms old; the watchdog (W1) allows {watchdog * 1e3:.3g} ms: it "
        f"{'will' if certain else 'may'} be stopped as silent while it runs"
    )
    advice = "its plugin must exchange more often, or its driver must say that it measures later than halfway through"
    yield Problem("stale-readings", sentence, place, advice, severity="warning")


def unmeasured_force(
    name: str,
    reads: Sequence[Channel],
    commands: Sequence[Channel],
    place: Place | None,
    *,
    twin: bool,
    touch_off: bool,
) -> Iterator[Problem]:
    """Find a device that carries a surface to a finger and measures no force: nothing watches how hard it presses."""
    carries = any(channel.role is Role.SURFACE_POSE for channel in commands)
    if not carries or any(channel.role is Role.CONTACT_FORCE for channel in reads):
        return
    if touch_off:
        sentence = f"device '{name}' measures no force, so it cannot feel the plate by touch-off"
        advice = 'remove <calibration method="touch-off"/>, and fit its mount: `itouch-py calibrate SCENE`'
        yield Problem("no-plate-force", sentence, place, advice)
    elif not twin:
        sentence = (
            f"device '{name}' carries a surface and measures no force: nobody knows how hard it presses on the "
            "finger, and no limit of force (K4) protects it"
        )
        advice = 'limit its speed (<limits speed="0.1 m/s"/>), or use drives that measure a force'
        yield Problem("no-plate-force", sentence, place, advice, severity="warning")
