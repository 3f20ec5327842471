"""A fault of the report in words: what happened, and what followed from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from itouch.schema.durable import GONE

#: Faults in keeping a session's data: no device has failed, and none is made safe because of them.
LOSSES = frozenset({"recording", "saving"})


def is_loss(fault: Mapping[str, Any]) -> bool:
    """Tell whether a fault is a loss of a session's data, not of a device."""
    return fault.get("trip") in LOSSES


def what(fault: Mapping[str, Any]) -> str:
    """Return what happened."""
    if is_loss(fault):
        return str(fault.get("cause", ""))
    return f"device '{fault.get('device', '')}' {fault.get('cause', '')}"


def outcome(fault: Mapping[str, Any]) -> list[str]:
    """Return what followed, as far as the report knows it: one line each."""
    if is_loss(fault):
        ends = fault.get("ends")
        after = 'ends, as <record on-failure="stop"> asks' if ends else "goes on"
        lines = [f"session: {after}; the devices are as they were"]
        again = int(fault.get("times", 1))
        return [*lines, f"again:   {again} times, last at {fault['until_s']:.3f} s"] if again > 1 else lines
    if not fault.get("trip"):
        return []
    if fault.get("optional"):
        return [f"devices: the session goes on without '{fault.get('device', '')}', which is optional"]
    safe = fault.get("safe")
    if not isinstance(safe, Mapping):
        return []
    also = ", ".join(f"'{name}' ({trip})" for name, trip in dict(fault.get("also") or {}).items())
    lines = [f"also:    {also}"] if also else []
    if safe.get("reached"):
        return [*lines, "devices: all have been made safe"]
    which = ", ".join(f"'{name}'" for name in safe.get("unsafe") or ())  # not in the reports of older recordings
    named = f" ({which} could not)" if which else ""
    return [*lines, f"devices: not all could be seen to be safe{named}: look at them before you touch anything"]


def advice(fault: Mapping[str, Any]) -> str:
    """Return what to do about a loss that has just happened."""
    if GONE in what(fault):
        kept = "what was recorded before is gone, too"
        if fault.get("ends"):
            return f"the session ends now, as its scene asks; {kept}"
        return f"{kept}; nothing more is recorded: end the session (Ctrl-C, Esc) and start again, or go on without"
    if fault.get("ends"):
        return "the session ends now, as its scene asks; what was written before is whole"
    if fault.get("trip") == "saving":
        return "free the disk or its folder: the next save is tried by itself; the snapshot before is untouched"
    if "samples are lost" in what(fault):
        return "what was written is whole but for a gap; end the session and start again, or let it go on with the gap"
    return (
        "what was written before is whole, nothing more is recorded: end the session (Ctrl-C, Esc) and start again, or "
        'let it go on without; <record on-failure="stop"> ends a session when this happens'
    )


def told(fault: Mapping[str, Any]) -> str:
    """Return a loss in one paragraph, for those who are watching the session."""
    names = {"recording": "RECORDING LOST", "saving": "SAVING FAILED"}
    head = names.get(str(fault.get("trip")), "LOST")
    return f"{head} at {float(fault.get('time_s', 0.0)):.3f} s: {what(fault)}\n  = help: {advice(fault)}"
