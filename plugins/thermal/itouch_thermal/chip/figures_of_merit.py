"""Figures of merit of the reference display, measured with its own firmware in the simulated chip."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from itouch.plugin import Field, Record, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch_thermal.chip.display import REFERENCE, SimulatedDisplay
from itouch_thermal.chip.host import SimulatedHost
from itouch_thermal.chip.pins import KELVIN
from itouch_thermal.chip.program import built, config
from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.display.display_twin import DisplayTwin
from itouch_thermal.display.params import DisplayParams

#: Promised limits: step of the mean flux [W/m2], and program and memory size [bytes] of an ATmega328P.
STEP, FLASH, RAM = 15.0, 32256, 2048
#: Period of the bridge [s]; its filter's coil [H], capacitors [F] and their series resistance [ohm].
PERIOD, COIL, CAPACITOR, SERIES = 50e-6, 200e-6, 235e-6, 0.1
#: Time step [s] of the twin after a cut-off.
_SOAK_STEP = 10e-3


class Figure(NamedTuple):
    """A figure with its unit and its limit; None: no limit is promised."""

    name: str
    value: float
    unit: str
    most: float | None = None

    @property
    def holds(self) -> bool:
        """Whether it is within its limit."""
        return self.most is None or self.value <= self.most


def flux_per_ampere(params: DisplayParams = REFERENCE) -> float:
    """Return the heat flux that a small current pumps, per ampere [W/m2 A]."""
    return params.seebeck * 296.15 / params.area


def ripple(
    duty: float, params: DisplayParams = REFERENCE, *, slices: int = 2000, periods: int = 400
) -> tuple[float, float]:
    """Return the ripple of the module's current at a duty cycle [A, peak to peak], and its heat at the plate [W/m2].

    The bridge applies its full supply for a part of each period, before the filter; half of the ripple's heat goes to
    the plate.
    """
    supply, dt = config()["SUPPLY_V"], PERIOD / slices
    coil = cap = supply * duty
    coil /= params.resistance
    seen: list[float] = []
    for index in range(periods * slices):
        on = supply if index % slices < duty * slices else 0.0
        current = (cap + SERIES * coil) / (params.resistance + SERIES)
        coil += dt / COIL * (on - current * params.resistance)
        cap += dt / CAPACITOR * (coil - current)
        if index >= (periods - 1) * slices:
            seen.append(current)
    mean = sum(seen) / len(seen)
    heat = sum((value - mean) ** 2 for value in seen) / len(seen) * params.resistance
    return max(seen) - min(seen), 0.5 * heat / params.area


def staircase(host: SimulatedHost, *, begin: float = 0.2, step: float = 0.001, count: int = 12) -> list[float]:
    """Return the mean currents [A] of a staircase of commands, 0.6 s each; the mean is over the last 0.4 s."""
    seen: list[float] = []
    display = host.display
    tap = lambda shown: seen.append(shown.last.current)  # noqa: E731 - it is removed again
    means = []
    host.hold(begin, 0.6)
    display.taps.append(tap)
    for index in range(count):
        seen.clear()
        host.hold(begin + index * step, 0.6)
        means.append(sum(seen[200:]) / len(seen[200:]))
    display.taps.remove(tap)
    return means


def steps(means: list[float]) -> float:
    """Return the greatest step [W/m2] of a staircase of currents [A]."""
    return max(abs(b - a) for a, b in zip(means, means[1:], strict=False)) * flux_per_ampere()


def accuracy(host: SimulatedHost) -> float:
    """Return the greatest error [A] of the mean current over several commands of both signs."""
    seen: list[float] = []
    tap = lambda shown: seen.append(shown.last.current)  # noqa: E731
    host.display.taps.append(tap)
    worst = 0.0
    for amps in (0.05, -0.3, 1.0, -1.0, 2.5, -2.5):
        host.hold(amps, 0.2)
        seen.clear()
        host.hold(amps, 0.2)
        worst = max(worst, abs(sum(seen) / len(seen) - amps))
    host.display.taps.remove(tap)
    return worst


def rise_time(host: SimulatedHost) -> float:
    """Return how long [s] a step of one ampere takes, from the command until the current stays within 5 %."""
    host.hold(0.0, 0.3)
    seen: list[float] = []
    tap = lambda shown: seen.append(shown.last.current)  # noqa: E731
    host.display.taps.append(tap)
    host.hold(1.0, 0.1)
    host.display.taps.remove(tap)
    return 1e-3 * (1 + max((i for i, amps in enumerate(seen) if abs(amps - 1.0) > 0.05), default=0))


def soak_limit(numbers: Mapping[str, float], params: DisplayParams = REFERENCE) -> Iterator[tuple[float, float]]:
    """Yield sinks [K/W], one with a dead fan, and the plate's peak [degC] with each after a cut at both hot limits."""
    from itouch_thermal.chip.display import plain

    for resistance in (0.3, 0.5, 1.5, 20.0):
        plant = plain(replace(params, sink_resistance=resistance))
        yield resistance, soak_peak(plant, numbers["PLATE_HOT_C"] + KELVIN, numbers["SINK_HOT_C"] + KELVIN) - KELVIN


def soak_peak(
    params: DisplayParams, plate: float, sink: float, *, room: float = 303.15, seconds: float = 120.0
) -> float:
    """Return the plate's highest temperature [K] after a cut-off at these temperatures [K] of plate and sink."""
    twin = DisplayTwin(params)
    twin.set_environment(room, None)
    _, commands = ThermalDisplay.channels(params)
    state, command = Record.of(twin.fields()), Record.of(Field(c.name, "f8", c.size) for c in commands)
    twin.reset(state, np.random.default_rng(0))
    twin.warm(state, plate, sink)
    touch, found, bound = TwinInputs(ambient=room), plate, BoundTwin(twin)
    for _ in range(round(seconds / _SOAK_STEP)):
        bound.step(state, command, touch, _SOAK_STEP)
        found = max(found, float(state["true_plate"].item()))
    return found


def figures() -> Iterator[Figure]:
    """Yield every figure; this takes several seconds."""
    program = built()
    yield Figure("flash", program.flash, "bytes", FLASH)
    yield Figure("RAM without stack", program.ram, "bytes", RAM)
    display = SimulatedDisplay(program=program)
    host = SimulatedHost(display)
    try:
        host.begin()
        begin, started = time.process_time(), display.milliseconds
        answers = host.hold(0.0, 2.0)[25:]
        yield Figure(
            "speed on a free core, plant included",
            (display.milliseconds - started) / 1e3 / (time.process_time() - begin),
            "x real time",
        )
        yield Figure("step of the mean flux", steps(staircase(host)), "W/m2", STEP)
        worst = accuracy(host)
        yield Figure("error of the mean current, to 2.5 A", worst * 1e3, "mA")
        yield Figure("the same as a flux", worst * flux_per_ampere(), "W/m2")
        yield Figure("from order to current, 1 A within 5 %", rise_time(host) * 1e3, "ms")
        yield Figure("noise of the plate's temperature", 1e3 * _rms([a.plate for a in answers]), "mK rms")
        yield Figure("noise of the flux", _rms([a.flux for a in answers]), "W/m2 rms")
    finally:
        display.close()
    peak, heat = ripple(0.3)
    yield Figure("ripple of the current at duty 0.3", 1e3 * peak, "mA p-p")
    yield Figure("its heat at the plate", heat, "W/m2")
    for resistance, highest in soak_limit(config()):
        yield Figure(f"plate after a cut, sink {resistance:g} K/W", highest, "degC", 45.0)


def _rms(values: list[float]) -> float:
    """Return the rms deviation from a straight line."""
    n = len(values)
    mean = sum(values) / n
    slope = sum((i - (n - 1) / 2) * (v - mean) for i, v in enumerate(values)) / (n * (n * n - 1) / 12)
    return math.sqrt(sum((v - mean - slope * (i - (n - 1) / 2)) ** 2 for i, v in enumerate(values)) / n)
