"""Operator marks and trial markers: noted in State between two ticks, and in the recording."""

from __future__ import annotations

import json
from typing import Any

from itouch.plugin import Record
from itouch.world.mark_fields import MARKS, NAME, PAYLOAD


def encode(name: str, payload: Any) -> tuple[bytes, bytes]:
    """Return name and payload as they are stored.

    Raises
    ------
    ValueError
        If the name is empty or too long, or the payload is not JSON or too long.
    """
    if not name.isprintable() or not 0 < len(name.encode()) <= NAME:  # half of a surrogate pair has no bytes
        raise ValueError(f"a mark's name is 1 to {NAME} bytes of printable text, not {name!r}")
    try:
        text = "" if payload is None else json.dumps(payload, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the payload of mark '{name}' is not JSON: {error}") from error
    if len(text.encode()) > PAYLOAD:
        raise ValueError(f"the payload of mark '{name}' has {len(text.encode())} bytes, at most {PAYLOAD} are kept")
    return name.encode(), text.encode()


def put(state: Record, name: bytes, payload: bytes) -> int:
    """Note a mark in State; return the number of the tick that comes next."""
    count, tick = int(state["marks.count"]), int(state["tick"])
    state["marks.table"][count % MARKS] = (tick, name, payload)
    state["marks.count"] = count + 1
    return tick


def remembered(state: Record) -> list[dict[str, Any]]:
    """Return the marks that State remembers, oldest first: tick, name, payload."""
    count = int(state["marks.count"])
    found = []
    for number in range(max(0, count - MARKS), count):
        tick, name, payload = state["marks.table"][number % MARKS].tolist()
        text = payload.decode(errors="replace")
        found.append(
            {"tick": tick, "name": name.decode(errors="replace"), "payload": json.loads(text) if text else None}
        )
    return found
