"""How long the plate takes from one start temperature to another, in closed loop and at the least."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from itouch.plugin import Field, Record, Touch
from itouch_thermal.display import plant
from itouch_thermal.display.column import P_BACK, P_DECAY, P_PORT, P_PUMP, REACH, Array, column, plate_capacity
from itouch_thermal.display.device import DisplayTwin, ThermalDisplay
from itouch_thermal.display.params import DisplayParams, Mismatch
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.heat import FINGER
from itouch_thermal.rendering.closedloop import AMBIENT, BAND, CORE, PERIOD

#: The plate has arrived when face and base stay this close to the new temperature [K].
CLOSE = 0.05


def least_time(display: DisplayParams, begin: float, end: float) -> float:
    """Return the least time [s] to bring face and base from one even temperature [K] to another.

    The greatest flux all the way and, at the end, the greatest the other way for as long as serves best: with one
    slow and one fast mode that matter, time-optimal pumping changes sign once.
    """
    parts = column(FINGER, CORE, 306.15, display.plate, PERIOD, REACH / 1e-3)
    change = abs(end - begin)
    capacity = plate_capacity(display.plate)
    pushed = round(change * capacity / display.flux_limit / PERIOD)
    best = np.inf
    for extra in range(60):
        for back in range(extra + 1):
            time = _arrival(parts.plate, pushed + extra, back, display.flux_limit, change)
            best = min(best, time)
    return float(best)


def _arrival(rows: Array, forward: int, back: int, flux: float, change: float) -> float:
    modes, last = np.zeros(rows.shape[1]), 0
    for i in range(forward + back + 40):
        pump = flux if i < forward else -flux if i < forward + back else 0.0
        modes = rows[P_DECAY] * modes + rows[P_PUMP] * pump
        if max(abs(rows[P_PORT] @ modes - change), abs(rows[P_BACK] @ modes - change)) > CLOSE:
            last = i + 1
    return last * PERIOD if last < forward + back + 40 else np.inf


def switching_time(display: DisplayParams, begin: float, end: float, *, seed: int = 1) -> float:
    """Return the time [s] that `model` takes on a plant from the command until face and base have arrived."""
    twin, believed = DisplayTwin(display), replace(display, mismatch=Mismatch())
    state = Record.of(twin.fields())
    twin.reset(state, np.random.default_rng(seed))
    law = ModelLaw(believed, FINGER, CORE, 306.15, 2e-3, AMBIENT, PERIOD, band=BAND, ceiling=display.max_current)
    memory = Record.of(law.fields())
    law.reset(memory)
    reads, commands = ThermalDisplay.channels(display)
    reading = Record.of(Field(c.name, "f8", c.size) for c in reads)
    command = Record.of(Field(c.name, "f8", c.size) for c in commands)
    touch, settle, sent, last = Touch(ambient=AMBIENT), 4000, 0.0, 0
    for k in range(2 * settle):
        twin.read(state, reading)
        law.track(
            memory, sent, reading["heat_flux"].item(), reading["plate_temperature"].item(),
            reading["sink_temperature"].item(),
        )  # fmt: skip
        sent = law.approach(memory, begin if k < settle else end)[0]
        command["current"] = sent
        twin.step(state, command, touch, PERIOD)
        face, base = state["memory"][plant.PLATE], state["memory"][plant.BACK]
        if k >= settle and max(abs(face - end), abs(base - end)) > CLOSE:
            last = k - settle + 1
    return last * PERIOD
