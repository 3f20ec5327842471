"""How long the plate takes from one start temperature to another: in closed loop, and at least."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contact_heat.resistance import DEFAULT_RESISTANCE
from itouch.plugin import Field, Record, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch_thermal.display import plant
from itouch_thermal.display.column import (
    P_BACK,
    P_DECAY,
    P_MEAN,
    P_PORT,
    P_PUMP,
    REACH,
    Array,
    column,
    plate_capacity,
)
from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.display.display_twin import DisplayTwin
from itouch_thermal.display.params import DisplayParams, Mismatch
from itouch_thermal.display.peltier import current_for, pumped_heat
from itouch_thermal.display.switching import CLOSE
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.flux.limits import BAND
from itouch_thermal.heat import FINGER
from itouch_thermal.rendering.closedloop import AMBIENT, CORE, PERIOD


def least_time_of_plant(display: DisplayParams, begin: float, end: float) -> float:
    """Return the least time [s] in which a plant brings face and base from one uniform temperature [K] to another.

    ``display.switching.least_time`` is for the data sheet's plate at a greatest flux; this function knows the plant's
    own module, its warming sink and its mismatches.  The greatest flux is applied all the way and, at the end, its
    opposite for the best duration: with one slow and one fast mode that matter, time-optimal pumping changes sign once.
    The greatest flux is the one that may be demanded or, if that is less, the one that the plant's own module pumps at
    its greatest current.
    """
    off = display.mismatch
    parts = column(FINGER, CORE, 306.15, display.plate, PERIOD, REACH / 1e-3)
    rows, lighter = parts.plate, 1.0 / (1.0 + off.plate_effusivity)
    way = 1.0 if end < begin else -1.0
    drive, ahead, sink = _Drive(display), [np.zeros(rows.shape[1])], AMBIENT
    sinks = [sink]
    most = round(3.0 * abs(end - begin) * plate_capacity(display.plate) / lighter / display.flux_limit / PERIOD) + 60
    for _ in range(most):
        modes = ahead[-1]
        flux, sink = drive.greatest(way, begin + float(rows[P_BACK] @ modes), sink)
        ahead.append(rows[P_DECAY] * modes - lighter * rows[P_PUMP] * flux)
        sinks.append(sink)
    means = np.array([begin + float(rows[P_MEAN] @ modes) for modes in ahead])
    near = int(np.argmax(way * (means - end) <= 0.0))
    times = [
        _arrival(rows, lighter, drive, ahead[forward], sinks[forward], way, begin, end, back) + forward
        for forward in range(max(0, near - 10), min(most, near + 80), 2)
        for back in range(0, 60, 2)
    ]
    return min(times) * PERIOD


class _Drive:
    """The greatest flux that a plant's module pumps, and the warming of its sink."""

    def __init__(self, display: DisplayParams) -> None:
        off, p = display.mismatch, display
        self.display = display
        self.module = p.seebeck * (1.0 + off.seebeck), p.resistance * (1.0 + off.resistance)
        self.legs = p.conductance * (1.0 + off.conductance)

    def greatest(self, way: float, back: float, sink: float) -> tuple[float, float]:
        """Return the greatest flux [W/m2] in one direction (1: out of the plate) and the sink [K] a period later."""
        p, (seebeck, resistance) = self.display, self.module
        current = current_for(seebeck, resistance, self.legs, way * p.flux_limit * p.area, back, sink)
        current = min(p.max_current, max(-p.max_current, current))
        heat = pumped_heat(seebeck, resistance, self.legs, current, back, sink)
        electric = seebeck * (sink - back) * current + current * current * resistance
        warmed = heat + electric - (sink - AMBIENT) / p.sink_resistance
        return heat / p.area, sink + PERIOD / p.sink_capacity * warmed


def _arrival(
    rows: Array, lighter: float, drive: _Drive, modes: Array, sink: float, way: float, begin: float, end: float,
    back: int,
) -> float:  # fmt: skip
    """Return the periods until face and base stay at ``end`` if the pump is reversed for ``back`` periods."""
    last = 0
    for i in range(back + 40):
        flux = 0.0
        if i < back:
            flux, sink = drive.greatest(-way, begin + float(rows[P_BACK] @ modes), sink)
        modes = rows[P_DECAY] * modes - lighter * rows[P_PUMP] * flux
        face, base = begin + float(rows[P_PORT] @ modes), begin + float(rows[P_BACK] @ modes)
        if max(abs(face - end), abs(base - end)) > CLOSE:
            last = i + 1
    return float(last) if last < back + 40 else np.inf


def switching_time(display: DisplayParams, begin: float, end: float, *, seed: int = 1) -> float:
    """Return the time [s] that `model` needs on a plant from the command until face and base have arrived."""
    twin, believed = DisplayTwin(display), replace(display, mismatch=Mismatch())
    state = Record.of(twin.fields())
    twin.reset(state, np.random.default_rng(seed))
    law = ModelLaw(
        believed, FINGER, CORE, 306.15, DEFAULT_RESISTANCE, AMBIENT, PERIOD, band=BAND, ceiling=display.max_current
    )
    memory = Record.of(law.fields())
    law.reset(memory)
    reads, commands = ThermalDisplay.channels(display)
    reading = Record.of(Field.of(c) for c in reads)
    command = Record.of(Field.of(c) for c in commands)
    touch, settle, sent, last = TwinInputs(ambient=AMBIENT), 4000, 0.0, 0
    bound = BoundTwin(twin)
    for k in range(2 * settle):
        bound.read(state, reading)
        law.track(
            memory, sent, reading["heat_flux"].item(), reading["plate_temperature"].item(),
            reading["sink_temperature"].item(),
        )  # fmt: skip
        sent = law.approach(memory, begin if k < settle else end)[0]
        command["current"] = sent
        bound.step(state, command, touch, PERIOD)
        face, base = state["memory"][plant.PLATE], state["memory"][plant.BACK]
        if k >= settle and max(abs(face - end), abs(base - end)) > CLOSE:
            last = k - settle + 1
    return last * PERIOD
