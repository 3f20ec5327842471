"""The limits that were in force when a session was stored, and what had set them, compared with those in force here.

A session does not go on under looser limits than it was begun with; tighter ones are accepted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from itouch.session.paths import without_folders
from itouch.session.session_error import SessionError
from itouch.world import Model
from itouch.world.limit_texts import shown
from itouch.world.limits import DEFAULT

#: Limits of which a smaller value is looser: the duration of the ramp-in.
_LEAST = frozenset({"ramp"})

#: Device -> limit -> its value (a number, or lowest and highest), and what has set it.
Stated = dict[str, dict[str, list[Any]]]


def stated(model: Model, before: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the limits in force as plain data.

    Parameters
    ----------
    model
        The compiled scene.
    before
        The limits of a stored session: for a limit that is still the same, its note of what has set it is kept.
    """
    devices: Stated = {}
    for name, device in model.devices.items():
        limits = {**device.limits.table(), "ramp": device.limits.ramp}
        devices[name] = {limit: [_plain(value), _by(device.limits.sources, limit)] for limit, value in limits.items()}
    for name, limit, value, by in _listed(before or {}):
        if devices.get(name, {}).get(limit, [None])[0] == value:
            devices[name][limit][1] = by
    safety = model.scene.safety
    return {
        "devices": devices, "hold-to-run": safety.hold_to_run, "servo-overrun": safety.servo_overrun,
        "participant": safety.participant,
    }  # fmt: skip


def _by(sources: Mapping[str, str], limit: str) -> str:
    said, at, place = sources.get(limit, DEFAULT).rpartition(" at ")
    return f"{said}{at}{without_folders(place)}" if at else place


def _plain(value: Any) -> Any:
    return [float(v) for v in value] if isinstance(value, tuple) else float(value)


def _listed(limits: Mapping[str, Any]) -> Iterator[tuple[str, str, Any, str]]:
    for name, device in dict(limits.get("devices", {})).items():
        for limit, (value, by) in dict(device).items():
            ends = [float(v) for v in value] if isinstance(value, list) else float(value)
            yield str(name), str(limit), ends, str(by)


def compared(stored: Mapping[str, Any], model: Model) -> tuple[list[str], list[str]]:
    """Return the limits that are looser here than in a stored session, and those that are tighter, a sentence each.

    Raises
    ------
    SessionError
        If the stored limits make no sense.
    """
    try:
        before = {(name, limit): (value, by) for name, limit, value, by in _listed(stored)}
        held = bool(stored["hold-to-run"])
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise SessionError(f"what the session says of its limits means nothing: {error!r}") from error
    now = {(name, limit): (value, by) for name, limit, value, by in _listed(stated(model))}
    looser: list[str] = []
    tighter: list[str] = []
    for name, limit in sorted({*before, *now}):
        was, here = before.get((name, limit)), now.get((name, limit))
        if name not in model.devices or (was and here and was[0] == here[0]):
            continue
        sentence = (
            f"'{name}' {limit.replace('_', '-')}: {_said(limit, was)} when it was stored, {_said(limit, here)} here"
        )
        (looser if _is_looser(limit, was, here) else tighter).append(sentence)
    safety = model.scene.safety
    if held and not safety.hold_to_run:
        looser.append("hold-to-run: needed when it was stored, not here")
    if stored.get("servo-overrun") == "stop" != safety.servo_overrun:
        looser.append("servo-overrun: it stopped all when the session was stored, here it only warns")
    if (person := stored.get("participant")) and person != safety.participant:
        other = f"'{safety.participant}'" if safety.participant else "nobody"
        looser.append(f"participant: '{person}' when it was stored, {other} here")
    return looser, tighter


def _said(limit: str, found: tuple[Any, str] | None) -> str:
    return "no limit" if found is None else f"{shown(limit, found[0])} ({found[1]})"


def _is_looser(limit: str, was: tuple[Any, str] | None, here: tuple[Any, str] | None) -> bool:
    if was is None or here is None:
        return here is None
    if isinstance(was[0], list) and isinstance(here[0], list):
        return not (here[0][0] >= was[0][0] and here[0][1] <= was[0][1])
    if isinstance(was[0], list) or isinstance(here[0], list):
        return True
    return not (here[0] >= was[0] if limit in _LEAST else here[0] <= was[0])
