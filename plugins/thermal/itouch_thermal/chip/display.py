"""A whole reference display in simulation: the chip with its firmware, and a plate with module, sink and finger."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from itouch.plugin import Field, Record, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch_thermal.chip.pins import INPUTS, at_pins
from itouch_thermal.chip.program import Built, built, config
from itouch_thermal.chip.simulated import Chip, Run
from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.display.display_twin import DisplayTwin
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.display.plant import PUMP, SINK

STEP, SOAK_STEP = 1e-3, 10e-3
#: The display described in the documentation, as its twin: a 40 mm module, slow thermistors, a 12 V supply.
REFERENCE = DisplayParams(
    max_current=3.0, seebeck=0.052, resistance=1.95, conductance=0.54, plate_lag=0.2, sink_lag=2.0, delay=0.0
)


def plain(params: DisplayParams) -> DisplayParams:
    """Return the plant behind the chip: delay, limits, noise and resolution are the chip's, not the twin's."""
    return replace(
        params, delay=0.0, slew=0.0, max_current=50.0, current_bits=32, flux_noise=0.0, flux_resolution=0.0,
        plate_noise=0.0, plate_resolution=0.0, sink_noise=0.0, sink_resolution=0.0,
        labjack=None, mecom=None, line=None, datasheet=None,
    )  # fmt: skip


class SimulatedDisplay:
    """A chip and a plate, advanced in steps of a millisecond.

    Parameters
    ----------
    params
        The true plant.
    begin
        Initial temperatures [K] of plate and sink.
    room
        Temperature [K] of the air.
    guard_lag
        Time constant [s] of the plate's second thermistor.
    seed
        Seed of the noise at the converter.
    program
        The program in the chip; by default the reference firmware.
    """

    def __init__(
        self,
        params: DisplayParams = REFERENCE,
        *,
        begin: tuple[float, float] = (296.15, 296.15),
        room: float = 296.15,
        guard_lag: float = 0.2,
        seed: int = 0,
        program: Built | None = None,
    ) -> None:
        self.params = plain(params)
        self.numbers = config()
        self.touch = TwinInputs(ambient=room)
        self._twin = DisplayTwin(self.params)
        self._twin.set_environment(room, None)
        reads, commands = ThermalDisplay.channels(self.params)
        self._state = Record.of(self._twin.fields())
        self._reading, self._command = (
            Record.of(Field(c.name, "f8", c.size) for c in side) for side in (reads, commands)
        )
        self._twin.reset(self._state, np.random.default_rng(seed))
        self._twin.warm(self._state, *begin)
        self._bound = BoundTwin(self._twin)
        self._guard, self._guard_lag = begin[0], guard_lag
        self.chip = Chip(program or built(), seed=seed)
        #: Voltages forced on inputs, by name: an open or shorted wire, a stuck sensor.
        self.forced: dict[str, float] = {}
        #: Offset of each thermistor [K], by input.
        self.offsets: dict[str, float] = {}
        #: Supply of the bridge [V], and resistance [ohm] of module and leads in addition to the twin's.
        self.supply, self.leads, self.sense = self.numbers["SUPPLY_V"], 0.0, self.numbers["SENSE_V_PER_A"]
        self.milliseconds = 0
        self.last = Run(0.0, 0.0, 0.0, 0.0, 0, b"")
        #: Called after each millisecond.
        self.taps: list[Callable[[SimulatedDisplay], None]] = []

    @property
    def plate(self) -> float:
        """The plate's true surface temperature [K]."""
        return float(self._state["true_plate"].item())

    @property
    def sink(self) -> float:
        """The sink's true temperature [K]."""
        return float(self._state["memory"][SINK])

    @property
    def flux(self) -> float:
        """The true flux out of the finger [W/m2]."""
        return float(self._state["true_flux"].item())

    @property
    def pumped(self) -> float:
        """Flux that the module pumps out of the plate at its present current [W/m2], net of its legs' conduction."""
        return float(self._state["memory"][PUMP])

    def close(self) -> None:
        """Discard the chip."""
        self.chip.close()

    def step(self, heard: bytes = b"") -> bytes:
        """Run for a millisecond with the bytes received; return the bytes that the chip sends."""
        self._bound.read(self._state, self._reading)
        shown = {
            "plate": self._reading["plate_temperature"].item(), "sink": self._reading["sink_temperature"].item(),
            "guard": self._guard,
        }  # fmt: skip
        shown = {name: value + self.offsets.get(name, 0.0) for name, value in shown.items()}
        circuit = at_pins(
            self.numbers, flux=self._reading["heat_flux"].item(), seebeck=0.0, supply=self.supply,
            resistance=self.params.resistance * (1.0 + self.params.mismatch.resistance) + self.leads, **shown,
        )  # fmt: skip
        circuit.thermal = self.params.seebeck * (1.0 + self.params.mismatch.seebeck) * (self.sink - self.plate)
        circuit.sense = self.sense
        for name, volts in self.forced.items():
            circuit.volts[INPUTS[name]] = volts
        self.last = self.chip.run(circuit, heard)
        self._command["current"] = self.last.current
        self._bound.step(self._state, self._command, self.touch, STEP)
        self._guard += (1.0 - math.exp(-STEP / self._guard_lag)) * (self.plate - self._guard)
        self.milliseconds += 1
        for tap in self.taps:
            tap(self)
        return self.last.said

    def soak(self, seconds: float) -> tuple[float, float]:
        """Let plate and sink come to rest without current; return the plate's lowest and highest temperature [K]."""
        self._command["current"] = 0.0
        low = high = self.plate
        for _ in range(round(seconds / SOAK_STEP)):
            self._bound.step(self._state, self._command, self.touch, SOAK_STEP)
            low, high = min(low, self.plate), max(high, self.plate)
        return low, high
