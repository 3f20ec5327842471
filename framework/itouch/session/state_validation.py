"""Whether a stored State is a possible one: indices, counts and choices are in range, no time lies in the future."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.safety import Status
from itouch.world import Model
from itouch.world.state import layout

#: Greatest count: one more must not overflow.
_MOST = 1 << 62
#: Most ticks that a session can have lasted, with those left out: 35 years at 1 kHz; far beyond, a time as a float no
#: longer tells one tick from the next, and what is counted over time would stand still.
_LONGEST = 1 << 40
#: Tolerance [s] for times, which are rounded sums of periods.
_ROUNDED = 1e-6
#: How far in the future [s] a command that is on its way may leave: more than any exchange takes.
_ON_ITS_WAY = 1.0


def validate_state(model: Model, state: Record) -> None:
    """Check every field by its declared range, that every count can go on, and that no time lies in the future.

    Monitors are asked by when they looked last: a time in the future would let them look away until then.

    Raises
    ------
    ValueError
        Naming the field, what it holds, and the range.
    """
    for field in layout(model):
        values = state[field.name]
        if values.dtype.names is not None:
            continue
        if values.dtype.kind == "i":
            _within(field.name, values, np.full(values.shape, -_MOST), np.full(values.shape, _MOST))
        low, high = (np.broadcast_to(np.asarray(bound, np.float64), values.shape) for bound in (field.low, field.high))
        _within(field.name, values, low, high)
    _not_later(model, state)
    _closed_is_off(model, state)


def _not_later(model: Model, state: Record) -> None:
    for name, device in model.devices.items():
        tick = int(state["tick"])
        now = tick + int(state[f"{name}.missed"])
        if now > _LONGEST:
            raise ValueError(f"tick and {name}.missed say that the session has lasted {now} ticks: none can have")
        ticks = {f"{name}.{field}": tick for field in ("tripped", "measured", "rearmed")} | {f"{name}.heard": now}
        ticks |= {f"{name}.{monitor.name}.checked": now for monitor in device.monitors}
        leaves = tick + round(_ON_ITS_WAY / model.period)
        ticks |= {field: leaves for field in (f"{name}.left", f"{name}.gone") if field in state}
        seconds = now * model.period + _ROUNDED
        times = {
            f"{name}.{monitor.name}.{field}": seconds for monitor in device.monitors for field in monitor.time_fields
        }
        for field, latest in (ticks | times).items():
            values = state[field]
            later = (values[..., 0] if values.ndim > 1 else values) > latest
            if later.any():
                raise ValueError(f"{field} is later than it can be in this session: {latest:.10g} at the latest")


def _closed_is_off(model: Model, state: Record) -> None:
    """Check that the commands sent last to a closed twin, which no monitor watches, are safe.

    Not in a session that has not begun, and not of surfaces, whose command is a pose.
    """
    for name, device in model.devices.items():
        if not device.twin or int(state["tick"]) == 0 or int(state[f"{name}.status"]) != Status.CLOSED:
            continue
        for channel in device.commands:
            sent = f"{name}.sent.{channel.name}"
            if isinstance(channel.safe, tuple) and state[sent].any() and tuple(state[sent].tolist()) != channel.safe:
                raise ValueError(f"{name}.status is {Status.CLOSED:d} (CLOSED), but {sent} is not off")


def _within(name: str, values: NDArray[Any], low: NDArray[Any], high: NDArray[Any]) -> None:
    limited = np.isfinite(low) | np.isfinite(high)
    inside = (values >= low) & (values <= high)
    if (inside | ~limited).all():
        return
    index = np.unravel_index(int(np.argmax(limited & ~inside)), values.shape)
    place = name + (f"[{', '.join(str(i) for i in index)}]" if index else "")
    raise ValueError(f"{place} = {values[index].item()!r} is out of range: {low[index]:g} to {high[index]:g}")
