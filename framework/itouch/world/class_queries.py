"""Queries of a device class about itself: what it answers is checked once, before anything relies on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from itouch.plugin import Channel, Device
from itouch.schema.plugin_errors import ReturnedError

#: Times that a device class declares, which are 0 or more seconds.
_TIMES = ("period", "delay", "exchange_time", "command_wait")
#: What it declares of its mechanics: numbers of 0 or more, or None.
_MECHANICS = ("max_stiffness", "damping")


def channels_of(cls: type[Device], params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
    """Return what a device reads and obeys.

    Raises
    ------
    ReturnedError
        If it says anything else than two tuples of channels.
    """
    told: Any = cls.channels(params)
    wanted = "(reads, commands), each a tuple of Channel, is wanted: (pose(),) with one, () with none"
    if not isinstance(told, tuple | list) or len(told) != 2:
        raise _wrong(cls.channels, told, wanted)
    for one in told:
        if not isinstance(one, tuple | list) or not all(isinstance(channel, Channel) for channel in one):
            raise _wrong(cls.channels, one, wanted)
    return tuple(told[0]), tuple(told[1])


def bound_of(cls: type[Device], bound: object) -> None:
    """Check what ``bind`` has returned.

    Raises
    ------
    ReturnedError
        If it is None: a ``return`` is missing.
    """
    if bound is None:
        raise _wrong(cls.bind, bound, "what driver and twin are made from is wanted, such as its params")


def duration_of(cls: type[Device], bound: Any) -> float:
    """Return how long the own motion of a device's twin lasts [s]; 0: it has none.

    Raises
    ------
    ReturnedError
        If it says anything else than a time that ends.
    """
    return _seconds(cls.motion_duration, cls.motion_duration(bound), "a time in seconds is wanted, 0 without a motion")


def surface_half_extents_of(cls: type[Device], params: Any) -> tuple[float, float] | None:
    """Return the half extents [m] of the face of a device, or None.

    Raises
    ------
    ReturnedError
        If it says anything else.
    """
    told: Any = cls.surface_half_extents(params)
    if told is None:
        return None
    sizes = [_number(one) for one in told] if isinstance(told, tuple | list | np.ndarray) else []
    if len(sizes) != 2 or not all(0.0 < size < math.inf for size in sizes):
        raise _wrong(cls.surface_half_extents, told, "two half extents in metres are wanted, or None")
    return sizes[0], sizes[1]


def unavailable_reason_of(cls: type[Device], bound: Any) -> str:
    """Return why a device cannot be opened; empty: nothing is known.

    Raises
    ------
    ReturnedError
        If it says anything else than a text.
    """
    told: Any = cls.unavailable_reason(bound)
    if not isinstance(told, str):
        raise _wrong(cls.unavailable_reason, told, "a text is wanted, empty if nothing is known to be missing")
    return told


def wires_of(cls: type[Device], params: Any) -> tuple[str, ...]:
    """Return the wires that belong to a device alone.

    Raises
    ------
    ReturnedError
        If it says anything else than a tuple of texts.
    """
    return texts_of(
        cls.wires, cls.wires(params), "a tuple of texts such as ('/dev/ttyUSB0',) is wanted, () without a wire"
    )


def check_numbers(cls: type[Device], params: Any) -> None:
    """Check the times and mechanics that a device declares, and after what time it lets go without commands.

    Raises
    ------
    ReturnedError
        If one of them is no such number.
    """
    for name in _TIMES:
        told = getattr(cls, name)
        if not 0.0 <= _number(told) < math.inf:
            raise ReturnedError(None, f"its {name} is {told!r:.40}; a time in seconds is wanted, 0 or more")
    for name in _MECHANICS:
        told = getattr(cls, name)
        if told is not None and not _number(told) >= 0.0:
            raise ReturnedError(None, f"its {name} is {told!r:.40}; a number is wanted, 0 or more, or None")
    _seconds(cls.exchange_time_for, cls.exchange_time_for(params), "a time in seconds is wanted")
    lets_go: Any = cls.watchdog_for(params)
    if lets_go is not None and not 0.0 < _number(lets_go) < math.inf:  # else nothing would ever stop it
        wanted = "the seconds after which it makes itself safe are wanted, None if it does not"
        if cls.watchdog_for.__func__ is Device.watchdog_for.__func__:  # type: ignore[attr-defined]
            raise ReturnedError(None, f"its watchdog is {lets_go!r:.40}; {wanted}")
        raise _wrong(cls.watchdog_for, lets_go, wanted)
    bool(cls.second_opener_for(params))


def texts_of(method: Callable[..., Any], told: Any, wanted: str) -> tuple[str, ...]:
    """Return texts that a plugin's ``method`` has returned; a single text is not taken for its letters.

    Raises
    ------
    ReturnedError
        If it is anything else.
    """
    if isinstance(told, str) or not isinstance(told, Iterable):
        raise _wrong(method, told, wanted)
    texts = tuple(told)
    if not all(isinstance(one, str) for one in texts):
        raise _wrong(method, told, wanted)
    return texts


def _seconds(method: Callable[..., Any], told: Any, wanted: str) -> float:
    seconds = _number(told)
    if not 0.0 <= seconds < math.inf:
        raise _wrong(method, told, wanted)
    return seconds


def _number(told: Any) -> float:
    """Return a number as it is, and NaN for anything else; a bool is no number of seconds or metres."""
    real = isinstance(told, int | float | np.integer | np.floating) and not isinstance(told, bool)
    return float(told) if real else math.nan


def _wrong(method: Callable[..., Any], told: object, wanted: str) -> ReturnedError:
    return ReturnedError(method, f"it returned {told!r:.120}; {wanted}")
