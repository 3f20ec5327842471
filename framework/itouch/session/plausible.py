"""Whether a stored State can be one: what is used as an index or as a choice must be in range."""

from __future__ import annotations

from itouch.plugin import Record
from itouch.world import Model

#: Statuses that a device may have: CLOSED, OPEN, ENABLED, FAULT.
_STATUSES = 4


def check_plausible(model: Model, state: Record) -> None:
    """Check every field of the framework that is an index, a count or a choice.

    Raises
    ------
    ValueError
        Naming the field, what it holds, and the range.
    """
    objects = len(model.objects)
    _within(state, "tick", 0, 1 << 62)
    _within(state, "ready", 0, 1)
    for device in model.devices:
        _within(state, f"{device}.status", 0, _STATUSES - 1)
        for name in ("age", "sequence", "clamped", "dropped"):
            _within(state, f"{device}.{name}", 0, 1 << 62)
        _within(state, f"{device}.touch_off.stage", 0, 3)
        _within(state, f"{device}.touch_off.point", 0, 8)
    for probe in model.probes:
        for name in ("object", "near_object", "contact.object"):
            _within(state, f"{probe.name}.{name}", -1, objects - 1)
        _within(state, f"{probe.name}.hand.ticks", 0, 1 << 62)
    _within(state, "events.count", 0, 1 << 62)


def _within(state: Record, name: str, low: int, high: int) -> None:
    if name not in state:
        return
    for value in state[name].ravel().tolist():
        if not low <= value <= high:
            raise ValueError(f"{name} = {value!r} is out of range: {low} to {high}")
