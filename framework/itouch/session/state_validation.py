"""Whether a stored State can be one: what is an index, a count or a choice is in range, and nothing has yet to come."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.world import Model
from itouch.world.state import layout

#: Greatest count: one more must still be a number.
_MOST = 1 << 62
#: Times are rounded sums of periods: so much later [s] is not later.
_ROUNDED = 1e-6


def validate_state(model: Model, state: Record) -> None:
    """Check every field by the range that it was declared with, that every count can go on, and that nothing is later.

    What supervises a device goes by when it looked last: a moment that is yet to come would let it look away till then.

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


def _not_later(model: Model, state: Record) -> None:
    for name, device in model.devices.items():
        tick = int(state["tick"])
        now = tick + int(state[f"{name}.missed"])
        ticks = {f"{name}.{field}": tick for field in ("tripped", "measured", "rearmed")} | {f"{name}.heard": now}
        ticks |= {f"{name}.{monitor.name}.checked": now for monitor in device.monitors}
        seconds = now * model.period + _ROUNDED
        times = {f"{name}.{monitor.name}.{field}": seconds for monitor in device.monitors for field in monitor.moments}
        for field, latest in (ticks | times).items():
            values = state[field]
            later = (values[..., 0] if values.ndim > 1 else values) > latest
            if later.any():
                raise ValueError(f"{field} is later than the session, which is at {latest:g}")


def _within(name: str, values: NDArray[Any], low: NDArray[Any], high: NDArray[Any]) -> None:
    limited = np.isfinite(low) | np.isfinite(high)
    inside = (values >= low) & (values <= high)
    if (inside | ~limited).all():
        return
    index = np.unravel_index(int(np.argmax(limited & ~inside)), values.shape)
    place = name + (f"[{', '.join(str(i) for i in index)}]" if index else "")
    raise ValueError(f"{place} = {values[index].item()!r} is out of range: {low[index]:g} to {high[index]:g}")
