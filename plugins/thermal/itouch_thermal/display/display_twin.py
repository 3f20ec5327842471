"""The twin of the thermal display: a plate, its module, its sensors, and a finger on it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from itouch.plugin import Bound, Field, Record, Role, Twin, TwinInputs
from itouch_thermal.display import plant
from itouch_thermal.display.column import REACH, Array, Column, column
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.display.sideways import FIELDS, Sideways, table
from itouch_thermal.heat import FINGER
from itouch_thermal.laws import law_of

#: Shortest servo period [s] for which the delay line is long enough.
SHORTEST = 2e-4
#: Temperature [K] from which the plate's modes measure deviations.
REFERENCE = 296.15


class DisplayTwin(Twin):
    """A plate, its module and a finger on it: distributed layers, a bilinear module, a lumped sink."""

    def __init__(self, params: DisplayParams) -> None:
        super().__init__(params)
        self._ambient = REFERENCE
        self._built: dict[float, tuple[Column, Array]] = {}
        self._column, _ = self._for(1e-3)
        self._law = np.array(law_of(params.laws, params.contact_resistance).numbers)
        off = params.mismatch
        self._finger = np.array(
            (params.full_force, 1.0 + off.contact_resistance, params.press, params.pad[0] * (1.0 + off.contact_area),
             params.pad[1])
        )  # fmt: skip
        self._shares = table(self._column.plate.shape[1] - FIELDS - 1).copy()

    def set_environment(self, ambient: float, skin_temperature: float | None) -> None:
        """Set the room's temperature [K], and the operator's skin temperature if there is an operator."""
        self._ambient = ambient
        if skin_temperature is not None:
            self.params = replace(self.params, skin_temperature=skin_temperature)
        self._built.clear()
        self._column, _ = self._for(1e-3)

    def _for(self, period: float) -> tuple[Column, Array]:
        """Return the column and the constants for a step of a period [s]; each is built once."""
        found = self._built.get(period)
        if found is None:
            p = self.params
            parts = column(
                p.tissue or FINGER, p.core, p.skin_temperature, p.plate, period, REACH / 1e-3,
                Sideways(p.area, p.conductance / p.area),
            )  # fmt: skip
            parts = replace(parts, tissue=parts.tissue.copy(), plate=parts.plate.copy())  # the others are shared
            found = self._built[period] = (parts, constants(p, parts, self._ambient))
        return found

    def fields(self) -> tuple[Field, ...]:
        """Return the State: modes, delay line, sensors, energies, and the noise generator's word."""
        slots = 1 + round((self.params.delay + self.params.mismatch.delay) / SHORTEST)
        return (
            Field(
                "true_flux",
                unit="W/m^2",
                doc="true flux out of the finger",
                role=Role.HEAT_FLUX,
                show="no",
            ),
            Field(
                "true_skin",
                unit="K",
                doc="true temperature of the skin's surface",
                role=Role.SKIN_TEMPERATURE,
                show="no",
            ),  # fmt: skip
            Field(
                "true_plate",
                role=Role.SKIN_CONTACT_TEMPERATURE,
                unit="K",
                doc="true temperature of the plate's face",
                show="no",
            ),
            Field(
                "memory",
                "f8",
                plant.MEMORY,
                *_one(plant.MEMORY, plant.SLOT, slots - 1),
                unit="mixed",
                doc="fluxes, temperatures, filters, energies and counters of the plant",
            ),
            Field("tissue", "f8", self._column.tissue.shape[1], unit="K", doc="modes of the finger's tissue"),
            Field("plate", "f8", self._column.plate.shape[1], unit="K", doc="modes of the plate"),
            Field("line", "f8", slots, unit="A", doc="currents on their way to the module"),
            Field("noise", "u8", 1, unit="1", doc="word of the noise generator"),
        )

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Start at rest: finger in equilibrium with the air, plate and sink at the room's temperature, no current."""
        memory, p = state["memory"], self.params
        memory[:] = 0.0
        state["tissue"] = self._column.rise * (p.skin_temperature - self._column.rest)
        state["plate"] = self._column.flat * (self._ambient - REFERENCE)
        for index in (plant.PLATE, plant.SINK, plant.BACK, plant.PLATE_LAG, plant.SINK_LAG, plant.MEAN):
            memory[index] = self._ambient
        memory[plant.READ_PLATE] = memory[plant.READ_SINK] = self._ambient
        memory[plant.SKIN] = memory[plant.READ_SKIN] = p.skin_temperature
        memory[plant.READ_VALID] = 1.0
        state["line"] = 0.0
        state["noise"] = rng.integers(0, 1 << 63)
        self._publish(state)

    def warm(self, state: Record, plate: float, sink: float) -> None:
        """Set other temperatures [K] of the plate, uniform throughout, and of its sink, on a twin just reset."""
        memory, shown = state["memory"], state["plate"]
        shown += self._column.flat * (plate - self._ambient)
        for index in (plant.PLATE, plant.BACK, plant.PLATE_LAG, plant.MEAN, plant.READ_PLATE):
            memory[index] = plate
        memory[plant.SINK] = memory[plant.SINK_LAG] = memory[plant.READ_SINK] = sink
        self._publish(state)

    def _publish(self, state: Record) -> None:
        memory = state["memory"]
        state["true_flux"][...] = memory[plant.FLUX]
        state["true_skin"][...] = memory[plant.SKIN]
        state["true_plate"][...] = memory[plant.PLATE]

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound:
        """Bind the step to these views as one compiled call."""
        parts, numbers = self._for(period)
        by_current = self.params.command == "current"
        wanted = command["current"] if by_current else command["temperature_target"]
        return Bound(
            plant.display_step, plant.PlantConstants(numbers, parts.tissue, parts.plate, self._shares),
            plant.PlantState(state["memory"], state["tissue"], state["plate"], state["line"], state["noise"]),
            self._law, self._finger, wanted,
            np.ones(1) if by_current else command["output"], touch.force_and_gap, float(touch.ambient),
            state["true_flux"], state["true_skin"], state["true_plate"], touch.total_heat_flux,
        )  # fmt: skip

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Advance by one period [s] under the command that safety has let through."""
        self.bound_step(state, command, touch, period)()

    def resistance(self, force: float) -> float:
        """Return the true contact resistance [K m2/W] at a force [N] on the plate; infinite at zero force."""
        return plant.contact_resistance(self._law, self._finger, force)

    def bound_read(self, state: Record, reading: Record) -> Bound:
        """Bind the reading of these views as one compiled call."""
        current = reading["actual_current"] if self.params.command == "temperature" else np.zeros(0)
        return Bound(
            plant.sense, state["memory"], reading["skin_temperature"], reading["skin_valid"],
            reading["plate_temperature"], reading["sink_temperature"], reading["heat_flux"], current,
        )  # fmt: skip

    def read(self, state: Record, reading: Record) -> bool | None:
        """Write the sensors' readings."""
        self.bound_read(state, reading)()
        return True


def _keep(period: float, lag: float) -> float:
    return math.exp(-period / lag) if lag > 0.0 else 0.0


def constants(p: DisplayParams, parts: Column, ambient: float = REFERENCE) -> Array:
    """Return the constants of `plant.plant_step`."""
    c, off = np.zeros(plant.CONSTANTS), p.mismatch
    c[plant.C_PERIOD], c[plant.C_REST], c[plant.C_REFERENCE] = parts.period, parts.rest, REFERENCE
    c[plant.C_TISSUE_GAIN] = 1.0 / (1.0 + off.finger_effusivity)
    c[plant.C_PLATE_GAIN] = 1.0 / (1.0 + off.plate_effusivity)
    c[plant.C_TISSUE_SELF] = parts.tissue[1] @ parts.tissue[3]
    c[plant.C_SEEBECK] = p.seebeck * (1.0 + off.seebeck)
    c[plant.C_RESISTANCE] = p.resistance * (1.0 + off.resistance)
    c[plant.C_CONDUCTANCE] = p.conductance * (1.0 + off.conductance)
    c[plant.C_AREA], c[plant.C_COVER], c[plant.C_SENSOR] = p.area, p.cover, p.sensor_area
    c[plant.C_SINK_CAPACITY], c[plant.C_SINK_RESISTANCE] = p.sink_capacity, p.sink_resistance
    c[plant.C_FILM] = p.film_coefficient
    gap = p.skin_temperature - ambient
    loss = parts.resting_flux * (1.0 + off.finger_effusivity)
    c[plant.C_FINGER_FILM] = loss / gap if abs(gap) > 0.5 and loss / gap > 1.0 else 10.0
    c[plant.C_MAX_CURRENT] = p.max_current
    c[plant.C_CURRENT_STEP] = 2.0 * p.max_current / 2**p.current_bits
    slower = 1.0 + off.sensor_lag
    c[plant.C_FLUX_KEEP] = _keep(parts.period, p.flux_lag * slower)
    c[plant.C_PLATE_KEEP] = _keep(parts.period, p.plate_lag * slower)
    c[plant.C_SINK_KEEP] = _keep(parts.period, p.sink_lag)
    c[plant.C_FLUX_NOISE], c[plant.C_PLATE_NOISE] = p.flux_noise, p.plate_noise
    c[plant.C_SINK_NOISE], c[plant.C_SKIN_NOISE] = p.sink_noise, p.skin_noise
    c[plant.C_FLUX_STEP], c[plant.C_PLATE_STEP] = p.flux_resolution, p.plate_resolution
    c[plant.C_SINK_STEP], c[plant.C_SKIN_STEP] = p.sink_resolution, p.skin_resolution
    c[plant.C_FLUX_GAIN], c[plant.C_FLUX_BIAS] = 1.0 + off.flux_gain, p.flux_bias
    c[plant.C_PLATE_OFFSET], c[plant.C_CLEAR] = off.plate_offset, p.skin_clear
    c[plant.C_CEILING] = p.full_scale
    c[plant.C_SLOTS] = round((p.delay + off.delay) / parts.period)
    c[plant.C_SLEW] = p.slew * (1.0 + off.slew)
    if p.command == "temperature":
        c[plant.C_GAIN], c[plant.C_INTEGRAL] = p.target_gain, p.target_integral
    return c


def _one(size: int, index: int, most: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the ranges of numbers of which one is an index from 0 to ``most`` and the others are unlimited."""
    low, high = [-math.inf] * size, [math.inf] * size
    low[index], high[index] = 0.0, float(most)
    return tuple(low), tuple(high)
