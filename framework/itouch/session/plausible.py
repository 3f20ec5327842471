"""Whether a stored State can be one: what is used as an index, a count or a choice must be in range."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.world import Model
from itouch.world.state import layout

#: Greatest count: one more must still be a number.
_MOST = 1 << 62


def check_plausible(model: Model, state: Record) -> None:
    """Check every field by the range that it was declared with, and that every count can go on.

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


def _within(name: str, values: NDArray[Any], low: NDArray[Any], high: NDArray[Any]) -> None:
    limited = np.isfinite(low) | np.isfinite(high)
    inside = (values >= low) & (values <= high)
    if (inside | ~limited).all():
        return
    index = np.unravel_index(int(np.argmax(limited & ~inside)), values.shape)
    place = name + (f"[{', '.join(str(i) for i in index)}]" if index else "")
    raise ValueError(f"{place} = {values[index].item()!r} is out of range: {low[index]:g} to {high[index]:g}")
