"""The display's electronics: voltages at the chip's pins from a plate's temperatures and flux."""

from __future__ import annotations

import math
from collections.abc import Mapping

from itouch_thermal.chip.simulated import Circuit, circuit

#: Inputs by what is connected to them, and the reference [V].
PLATE, SINK, FLUX, CURRENT, GUARD = range(5)
INPUTS = {"plate": PLATE, "sink": SINK, "flux": FLUX, "current": CURRENT, "guard": GUARD}
REFERENCE = 5.0
KELVIN = 273.15


def thermistor(kelvin: float, numbers: Mapping[str, float]) -> float:
    """Return the voltage [V] of a thermistor to ground that a resistor connects to the reference."""
    ratio = math.exp(numbers["NTC_B_K"] * (1.0 / kelvin - 1.0 / 298.15))
    part = numbers["NTC_OHM_25"] * ratio
    return REFERENCE * part / (part + numbers["SERIES_OHM"])


def amplified(flux: float, numbers: Mapping[str, float]) -> float:
    """Return the voltage [V] of the film's amplifier at a flux [W/m2]; it saturates at its supplies."""
    return min(REFERENCE, max(0.0, 0.5 * REFERENCE + flux / numbers["FLUX_PER_V"]))


def at_pins(
    numbers: Mapping[str, float],
    *,
    plate: float,
    sink: float,
    guard: float,
    flux: float,
    seebeck: float,
    **values: float,
) -> Circuit:
    """Return the circuit at these temperatures [K] and this flux [W/m2], with a module of ``seebeck`` [V/K].

    ``values`` are further values of the circuit, such as ``supply`` [V] or ``resistance`` [ohm].
    """
    volts = [0.0] * 5
    volts[PLATE], volts[SINK], volts[GUARD] = (thermistor(t, numbers) for t in (plate, sink, guard))
    volts[FLUX] = amplified(flux, numbers)
    return circuit(volts, thermal=seebeck * (sink - plate), sense=numbers["SENSE_V_PER_A"], **values)
