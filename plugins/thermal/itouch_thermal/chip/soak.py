"""Heat soak: where a plate goes when its current is cut at the limits of plate and sink."""

from __future__ import annotations

import numpy as np

from itouch.plugin import Field, Record, TwinInputs
from itouch_thermal.display.device import DisplayTwin, ThermalDisplay
from itouch_thermal.display.params import DisplayParams

STEP = 10e-3


def highest(params: DisplayParams, plate: float, sink: float, *, room: float = 303.15, seconds: float = 120.0) -> float:
    """Return the highest temperature [K] of a plate after a cut at these temperatures [K] of plate and sink."""
    twin = DisplayTwin(params)
    twin.set_environment(room, None)
    _, commands = ThermalDisplay.channels(params)
    state, command = Record.of(twin.fields()), Record.of(Field(c.name, "f8", c.size) for c in commands)
    twin.reset(state, np.random.default_rng(0))
    twin.warm(state, plate, sink)
    touch, found = TwinInputs(ambient=room), plate
    for _ in range(round(seconds / STEP)):
        twin.step(state, command, touch, STEP)
        found = max(found, float(state["true_plate"].item()))
    return found
