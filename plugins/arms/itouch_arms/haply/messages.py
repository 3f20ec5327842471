"""The messages of the Inverse Service's simulation channel (3.1 to 3.5), and what the status of an arm means, in words.

The service sends an inventory when a client connects, then exactly one state update for each message that it receives.
Positions are metres, forces newtons, in the arm's own frame: x right, y away from the operator, z up.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from itouch.plugin.impedance import Vector
from itouch_arms.errors import ArmError, NotCalibrated, ProtocolError, Refused

ARMS = "inverse3"
GRIPS = ("wireless_verse_grip", "verse_grip", "custom_verse_grip")
#: The cursor of such an arm is never farther than this from its base [m].
FARTHEST = 1.0
_AXES = "xyz"

Message = Mapping[str, Any]


class State(NamedTuple):
    """The state of one arm in a state update: its cursor's position [m], and whether a grip's button is pressed."""

    position: Vector
    pressed: bool


def read(text: str) -> Message:
    """Parse a message.

    Raises
    ------
    ProtocolError
        If it is none.
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"the Inverse Service sent something that is not JSON: {text[:40]!r}") from error
    if not isinstance(found, dict):
        raise ProtocolError(f"the Inverse Service sent something that is not an object: {text[:40]!r}")
    return found


def is_update(message: Message) -> bool:
    """Tell whether a message mentions arms; all other messages are skipped."""
    return ARMS in message


def arms(message: Message) -> list[Message]:
    """Return the arms that a message lists.

    Raises
    ------
    ProtocolError
        If they are not a list of objects with a ``device_id``.
    """
    return _listed(message, ARMS)


def arm(message: Message, device: str) -> Message | None:
    """Return the entry of one arm in a message; None if the message does not list it."""
    return next((one for one in arms(message) if one["device_id"] == device), None)


def _listed(message: Message, kind: str) -> list[Message]:
    found = message.get(kind) or []
    if not isinstance(found, list) or not all(isinstance(one, dict) and "device_id" in one for one in found):
        raise ProtocolError(f"'{kind}' is not a list of devices")
    return found


def check(one: Message) -> None:
    """Check that an arm can give forces and that its positions can be relied on.

    Raises
    ------
    ArmError
        If it has no power, reports an error, is not calibrated, or another program has changed its axes.
    """
    name = one["device_id"]
    status, config = _part(one, "status"), _part(one, "config")
    if status.get("power_supply") is False:
        raise Refused(f"the Inverse3 {name} has no power: plug its power supply in")
    if status.get("error"):
        raise Refused(f"the Inverse3 {name} reports an error: {status['error']}")
    axes = _part(config, "basis").get("permutation", "XYZ")
    if axes != "XYZ":
        raise Refused(f"another program has given the Inverse3 {name} the axes '{axes}': set its basis to XYZ")
    if status.get("calibrated") is False:
        raise NotCalibrated(
            f"the Inverse3 {name} is not calibrated: move it as its manual says until its light is steady"
        )


def state_of(message: Message, one: Message, button: str, last: Vector | None) -> State | None:
    """Return the state of an arm; None if the update does not hold its position.

    Coordinates that the position leaves out are taken from ``last``.

    Raises
    ------
    ProtocolError
        If the position is malformed or out of the arm's reach.
    """
    found = _part(one, "state").get("cursor_position")
    if found is None:
        return None
    if not isinstance(found, dict):
        raise ProtocolError(f"'cursor_position' is {json.dumps(found)[:40]}, not x, y and z")
    place = [_number(found.get(axis, math.nan if last is None else last[i]), axis) for i, axis in enumerate(_AXES)]
    if max(map(abs, place)) > FARTHEST:
        raise ProtocolError(f"the cursor is at {place} m, where no such arm reaches")
    return State((place[0], place[1], place[2]), button != "none" and _pressed(message, button))


def _pressed(message: Message, button: str) -> bool:
    for kind in GRIPS:
        for grip in _listed(message, kind):
            state = _part(grip, "state")
            if _part(state, "buttons").get(button) is True or (button == "button" and state.get("button") is True):
                return True
    return False


def _part(one: Message, name: str) -> Message:
    found = one.get(name)
    if found is None:
        return {}
    if not isinstance(found, dict):
        raise ProtocolError(f"'{name}' is {json.dumps(found)[:40]}, not an object")
    return found


def _number(value: Any, axis: str) -> float:
    try:
        number = math.nan if isinstance(value, (bool, str)) else float(value)
    except (TypeError, OverflowError):  # an integer of hundreds of digits is valid JSON, too
        number = math.nan
    if not math.isfinite(number):
        raise ProtocolError(f"'{axis}' of the cursor is {json.dumps(value)[:40]}, no finite number")
    return number


def force(device: str, value: Sequence[float], *, profile: str = "") -> str:
    """Return the message that commands a force on the operator [N]; a profile also names the session."""
    x, y, z = value
    asked = {"device_id": device, "commands": {"set_cursor_force": {"values": {"x": x, "y": y, "z": z}}}}
    session = {"session": {"configure": {"profile": {"name": profile}}}} if profile else {}
    return json.dumps({**session, ARMS: [asked]}, separators=(",", ":"))


def chosen(message: Message, wanted: str) -> Message:
    """Return the arm to use: the one with the wanted number, or the only one if ``wanted`` is "any".

    Raises
    ------
    ArmError
        If there is no such arm, or there are several and none is named.
    """
    from itouch_arms.errors import NotFound

    found = arms(message)
    names = ", ".join(str(one["device_id"]) for one in found)
    if wanted != "any":
        for one in found:
            if one["device_id"] == wanted:
                return one
        raise NotFound(f"the Inverse Service has no Inverse3 with the number '{wanted}'; it has {names or 'none'}")
    if not found:
        raise NotFound("the Inverse Service has no Inverse3: plug it in and power it")
    if len(found) > 1:
        raise ArmError(f'the Inverse Service has several arms ({names}): write device="NUMBER"')
    return found[0]
