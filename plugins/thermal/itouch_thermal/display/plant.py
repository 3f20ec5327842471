"""One step of the display's twin: finger, film, plate, module, sink, driver and sensors, on flat arrays.

``memory`` holds all state except modes; its indices are defined here.  Fluxes are in W/m2, positive out of the finger.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from contact_heat.resistance import contact_area, resistance_at
from itouch.plugin.kernels import gaussian, inlined, kernel, linked
from itouch_thermal.display.column import (
    F_BEGIN,
    F_DECAY,
    F_END,
    F_PORT,
    P_BACK,
    P_BEGIN,
    P_DECAY,
    P_END,
    P_HALF,
    P_MEAN,
    P_PORT,
    P_PUMP,
    P_SENSE,
    P_SPILL,
)
from itouch_thermal.display.peltier import pumped_heat
from itouch_thermal.laws import press_factor

#: Indices in ``memory``.
(
    FLUX, SKIN, PLATE, SINK, BACK, PUMP, PLATE_AIR, FINGER_AIR, TOUCHING, FLUX_LAG, PLATE_LAG, SINK_LAG,
    READ_FLUX, READ_PLATE, READ_SINK, READ_SKIN, READ_VALID,
    ENERGY_ELECTRIC, ENERGY_FINGER, ENERGY_AIR, ENERGY_ROOM, MEAN, CURRENT, SLOT, INTEGRAL, PRESSED, MEMORY,
) = range(27)  # fmt: skip

#: Indices in ``constants``.
(
    C_PERIOD, C_REST, C_TISSUE_GAIN, C_PLATE_GAIN, C_TISSUE_SELF, C_SEEBECK, C_RESISTANCE, C_CONDUCTANCE,
    C_AREA, C_COVER, C_SENSOR, C_SINK_CAPACITY, C_SINK_RESISTANCE, C_FILM, C_FINGER_FILM,
    C_MAX_CURRENT, C_CURRENT_STEP, C_FLUX_KEEP, C_PLATE_KEEP, C_SINK_KEEP, C_FLUX_NOISE, C_PLATE_NOISE, C_SINK_NOISE,
    C_SKIN_NOISE, C_FLUX_STEP, C_PLATE_STEP, C_SINK_STEP, C_SKIN_STEP, C_FLUX_GAIN, C_FLUX_BIAS, C_PLATE_OFFSET,
    C_CLEAR, C_REFERENCE, C_CEILING, C_SLOTS, C_GAIN, C_INTEGRAL, C_SLEW, CONSTANTS,
) = range(39)  # fmt: skip

#: Indices in ``finger``: force from which the whole pad touches [N], factor on the law, time constant of pressing [s],
#: contact area at 1 N [m2], and exponent of the force in it.
FULL_FORCE, FACTOR, PRESS, PAD, PAD_EXPONENT, FINGER = range(6)

_resistance_at, _press_factor, _contact_area = kernel(resistance_at), kernel(press_factor), kernel(contact_area)


class PlantConstants(NamedTuple):
    """What the plant is made of, which never changes.

    Constants, shape (CONSTANTS,); packed column: tissue and plate, shapes (4, n) and (P_ROWS, m); weights of the
    contact on the plate's modes, and of the modes in the contact, by covered share, shape (k, 2, m).
    """

    c: Any
    tissue: Any
    plate: Any
    shares: Any


class PlantState(NamedTuple):
    """State of the plant, changed in place.

    ``memory`` (MEMORY,), mode coordinates of tissue and plate (n,) and (m,), delayed currents (d,), and the generator's
    word (1,).  Modes and temperatures are in [K], currents in [A].
    """

    memory: Any
    above: Any
    below: Any
    line: Any
    words: Any


@linked
def _counted(value: float, step: float) -> float:
    return math.floor(value / step + 0.5) * step if step > 0.0 else value


@kernel
def contact_resistance(law: Any, finger: Any, force: float) -> float:
    """Return the true contact resistance [K m2/W] at a force [N] on the plate; infinite at zero force.

    ``law`` (n,): the numbers of a law of the contact resistance, in SI units, see `resistance_at`; ``finger``
    (FINGER,), with the units that stand at its indices.
    """
    if force <= 0.0:
        return math.inf
    full = finger[FULL_FORCE]
    scale = max(1.0, full / force) if full > 0.0 else 1.0
    return float(_resistance_at(law, force) * finger[FACTOR] * scale)


@kernel
def display_step(
    made: PlantConstants, held: PlantState, law: Any, finger: Any, wanted: Any, output: Any, face: Any,
    ambient: float, flux: Any, skin: Any, surface: Any, beside: Any,
) -> int:  # fmt: skip
    """Advance the twin by one step under its command and what presses on it; return 0.

    Parameters
    ----------
    made, held, ambient
        As in `plant_step`.
    law, finger
        As in `contact_resistance`, shapes (n,) and (FINGER,), in SI units.
    wanted, output
        The command, current [A] or temperature [K], and whether the output is on (0.5 or more), shape (1,) each.
    face
        Force on the face [N] and gap to the finger [m], shape (2,).
    flux, skin, surface
        The true flux out of the finger [W/m2] and temperatures of skin and face [K], shape (1,) each; written.
    beside
        Heat flux that a device worn on the finger takes from it [W/m2], shape (1,).
    """
    c, memory, force = made.c, held.memory, face[0]
    contact = contact_resistance(law, finger, force)
    if finger[PRESS] > 0.0:
        pressed = memory[PRESSED] + 1.0 if force > 0.0 else 0.0
        memory[PRESSED] = pressed
        if pressed > 0.0:
            contact *= _press_factor(pressed * c[C_PERIOD], finger[PRESS])
    command = wanted[0] if output[0] >= 0.5 else 0.0
    cover = c[C_COVER]
    if force > 0.0:
        cover = min(1.0, _contact_area(force, finger[PAD], finger[PAD_EXPONENT]) / c[C_AREA])
    plant_step(made, held, command, contact, cover, face[1], ambient, beside[0])
    flux[0], skin[0], surface[0] = memory[FLUX], memory[SKIN], memory[PLATE]
    return 0


@linked
def plant_step(
    made: PlantConstants,
    held: PlantState,
    command: float,
    contact: float,
    under: float,
    gap: float,
    ambient: float,
    beside: float,
) -> None:
    """Advance the plant by one step; for its equations see docs/explanation/thermal-estimator.md.

    Parameters
    ----------
    made, held
        What the plant is made of, and its State.
    command, contact, under, gap, ambient, beside
        Current [A], or the temperature [K] for a driver that holds one (0: its output is off); contact resistance
        [K m2/W] (infinite: out of contact); share of the plate that the finger covers, or would cover; gap to the
        finger [m]; room [K]; another flux out of the finger during the whole step [W/m2].
    """
    c, tissue, plate, shares = made.c, made.tissue, made.plate, made.shares
    memory, above, below = held.memory, held.above, held.below
    current = _drive(c, memory, held.line, command)
    touching = contact < np.inf
    flux = memory[FLUX]
    skin, face, cold, hot = memory[SKIN], memory[PLATE], memory[BACK], memory[SINK]
    if touching != (memory[TOUCHING] > 0.0):
        flux = (skin - face) / contact if touching else 0.0
        memory[TOUCHING] = 1.0 if touching else 0.0
    air = c[C_FILM] * (ambient - face)
    finger_air = c[C_FINGER_FILM] * (skin - ambient)
    cover = under if touching else 0.0
    spill = (1.0 - cover) * air
    place = under * (shares.shape[0] - 1)
    row = min(int(place), shares.shape[0] - 2)
    low, high, part = shares[row], shares[row + 1], place - row
    pumped = pumped_heat(c[C_SEEBECK], c[C_RESISTANCE], c[C_CONDUCTANCE], current, cold, hot)
    pump = pumped / c[C_AREA]

    open_skin = _relax_tissue(c, tissue, above, flux if touching else finger_air, beside)
    entering = flux if touching else 0.0
    before, open_face, plate_self = _relax_plate(c, plate, low, high, part, below, entering, spill, pump)
    end = 0.0
    if touching:
        end = (open_skin - open_face) / (contact + c[C_TISSUE_GAIN] * c[C_TISSUE_SELF] + c[C_PLATE_GAIN] * plate_self)
        leaving = end
    else:
        answer = c[C_FINGER_FILM] * c[C_TISSUE_GAIN] * c[C_TISSUE_SELF]
        leaving = c[C_FINGER_FILM] * (open_skin - ambient) / (1.0 + answer)
    skin = _end_tissue(c, tissue, above, leaving)
    face, back, film, half, mean = _end_plate(c, plate, low, high, part, below, end)

    entered = 0.5 * (flux + end)
    _account(c, memory, current, pumped, cover, entered, spill, ambient)
    memory[FLUX], memory[SKIN], memory[PLATE], memory[BACK], memory[MEAN] = end, skin, face, back, mean
    memory[PUMP], memory[PLATE_AIR], memory[FINGER_AIR] = pump, air, finger_air
    # The film measures the flux at its middle: the flux that entered less the heat kept by its upper half.
    seen = air
    if touching:
        covered = min(1.0, under * c[C_AREA] / c[C_SENSOR])
        seen = covered * entered + (1.0 - covered) * air
    seen -= (half - before) / (c[C_PLATE_GAIN] * c[C_PERIOD])
    _sense(c, memory, held.words, seen, film, skin, gap)


@inlined
def _relax_tissue(c: Any, tissue: Any, above: Any, begin: float, beside: float) -> float:
    """Advance the tissue under the flux at the start of a step and a constant loss; return the skin temperature [K]."""
    gain, skin = c[C_TISSUE_GAIN], c[C_REST]
    for i in range(above.shape[0]):
        above[i] = tissue[F_DECAY, i] * above[i] - gain * tissue[F_BEGIN, i] * begin
        if beside != 0.0:
            above[i] -= gain * (tissue[F_BEGIN, i] + tissue[F_END, i]) * beside
        skin += tissue[F_PORT, i] * above[i]
    return float(skin)


@inlined
def _end_tissue(c: Any, tissue: Any, above: Any, end: float) -> float:
    """Add the effect of the flux at the end of a step on the tissue; return the skin temperature [K]."""
    gain, skin = c[C_TISSUE_GAIN], c[C_REST]
    for i in range(above.shape[0]):
        above[i] -= gain * tissue[F_END, i] * end
        skin += tissue[F_PORT, i] * above[i]
    return float(skin)


@inlined
def _relax_plate(
    c: Any, plate: Any, low: Any, high: Any, part: float, below: Any, begin: float, spill: float, pump: float
) -> tuple[float, float, float]:
    """Advance the plate under everything but the contact flux at the end of the step.

    Return the heat in the film's upper half at the start of the step, the face temperature, and the face's response to
    the flux at the end; ``low`` and ``high`` (2, m) are rows of the shares, between which ``part`` interpolates.
    """
    before = plate_self = 0.0
    face = c[C_REFERENCE]
    for i in range(below.shape[0]):
        into = low[0, i] + part * (high[0, i] - low[0, i])
        out = low[1, i] + part * (high[1, i] - low[1, i])
        before += plate[P_HALF, i] * out * below[i]
        below[i] = plate[P_DECAY, i] * below[i] + c[C_PLATE_GAIN] * (
            plate[P_BEGIN, i] * into * begin + plate[P_SPILL, i] * spill - plate[P_PUMP, i] * pump
        )
        face += plate[P_PORT, i] * out * below[i]
        plate_self += plate[P_PORT, i] * out * into * plate[P_END, i]
    return before, face, plate_self


@inlined
def _end_plate(
    c: Any, plate: Any, low: Any, high: Any, part: float, below: Any, end: float
) -> tuple[float, float, float, float, float]:
    """Add the effect of the flux at the end of a step on the plate.

    Return the temperatures of face, back and film, the heat in the film's upper half, and the plate's mean temperature.
    """
    face = back = film = mean = c[C_REFERENCE]
    half = 0.0
    for i in range(below.shape[0]):
        into = low[0, i] + part * (high[0, i] - low[0, i])
        out = low[1, i] + part * (high[1, i] - low[1, i])
        below[i] += c[C_PLATE_GAIN] * plate[P_END, i] * into * end
        face += plate[P_PORT, i] * out * below[i]
        back += plate[P_BACK, i] * below[i]
        film += plate[P_SENSE, i] * out * below[i]
        half += plate[P_HALF, i] * out * below[i]
        mean += plate[P_MEAN, i] * below[i]
    return face, back, film, half, mean


@inlined
def _account(
    c: Any, memory: Any, current: float, pumped: float, cover: float, entered: float, spill: float, ambient: float
) -> None:  # fmt: skip
    """Warm the sink, and add a step's heat to the energies: electric, from finger and air, and to the room.

    ``memory`` is as at the start of the step; ``entered`` [W/m2] entered the share ``cover`` of the plate, ``spill`` is
    the air's flux into the rest, averaged over the whole plate.
    """
    dt, hot = c[C_PERIOD], memory[SINK]
    electric = c[C_SEEBECK] * (hot - memory[BACK]) * current + current * current * c[C_RESISTANCE]
    room = (hot - ambient) / c[C_SINK_RESISTANCE]
    memory[SINK] = hot + dt / c[C_SINK_CAPACITY] * (pumped + electric - room)
    memory[ENERGY_ELECTRIC] += dt * electric
    memory[ENERGY_FINGER] += dt * c[C_AREA] * cover * entered
    memory[ENERGY_AIR] += dt * c[C_AREA] * spill
    memory[ENERGY_ROOM] += dt * room


@linked
def _drive(c: Any, memory: Any, line: Any, command: float) -> float:
    """Pass the command through the delay line and the driver; return the current [A]."""
    size = int(c[C_SLOTS])
    current = command
    if size > 0:
        slot = int(memory[SLOT])
        current = line[slot]
        line[slot] = command
        memory[SLOT] = (slot + 1) % size
    if c[C_GAIN] > 0.0:
        current = _hold(c, memory, current)
    current = min(c[C_MAX_CURRENT], max(-c[C_MAX_CURRENT], current))
    if c[C_SLEW] > 0.0:
        most = c[C_SLEW] * c[C_PERIOD]
        current = min(memory[CURRENT] + most, max(memory[CURRENT] - most, current))
    current = _counted(current, c[C_CURRENT_STEP])
    memory[CURRENT] = current
    return current


@linked
def _hold(c: Any, memory: Any, target: float) -> float:
    """Return the current of a driver that holds the plate at a temperature: a PI controller.

    The integral stops while the current is at its limit and the error would drive it further (anti-windup).
    """
    if target <= 0.0:
        memory[INTEGRAL] = 0.0
        return 0.0
    error = memory[READ_PLATE] - target
    current = c[C_GAIN] * error + memory[INTEGRAL]
    if abs(current) < c[C_MAX_CURRENT] or current * error < 0.0:
        memory[INTEGRAL] += c[C_INTEGRAL] * error * c[C_PERIOD]
    return float(current)


@linked
def _sense(c: Any, memory: Any, words: Any, seen: float, film: float, skin: float, gap: float) -> None:
    """Pass the true values through the sensors' models."""
    memory[FLUX_LAG] = c[C_FLUX_KEEP] * memory[FLUX_LAG] + (1.0 - c[C_FLUX_KEEP]) * seen
    memory[PLATE_LAG] = c[C_PLATE_KEEP] * memory[PLATE_LAG] + (1.0 - c[C_PLATE_KEEP]) * film
    memory[SINK_LAG] = c[C_SINK_KEEP] * memory[SINK_LAG] + (1.0 - c[C_SINK_KEEP]) * memory[SINK]
    flux = memory[FLUX_LAG] * c[C_FLUX_GAIN] + c[C_FLUX_BIAS] + c[C_FLUX_NOISE] * gaussian(words)
    flux = min(c[C_CEILING], max(-c[C_CEILING], flux))
    memory[READ_FLUX] = _counted(flux, c[C_FLUX_STEP])
    memory[READ_PLATE] = _counted(
        memory[PLATE_LAG] + c[C_PLATE_OFFSET] + c[C_PLATE_NOISE] * gaussian(words), c[C_PLATE_STEP]
    )
    memory[READ_SINK] = _counted(memory[SINK_LAG] + c[C_SINK_NOISE] * gaussian(words), c[C_SINK_STEP])
    noise = c[C_SKIN_NOISE] * gaussian(words)
    memory[READ_VALID] = 0.0
    if gap > c[C_CLEAR]:
        memory[READ_VALID] = 1.0
        memory[READ_SKIN] = _counted(skin + noise, c[C_SKIN_STEP])


@kernel
def sense(memory: Any, skin: Any, valid: Any, plate: Any, sink: Any, flux: Any, current: Any) -> int:
    """Write the sensors' readings, and the present current if it is read; return 0.

    ``memory`` (MEMORY,), in SI units; ``skin``, ``plate``, ``sink`` [K], ``flux`` [W/m2] and ``valid``, whether the
    skin's reading is, (1,) each; ``current`` [A], (1,) or (0,).
    """
    skin[0], valid[0] = memory[READ_SKIN], memory[READ_VALID]
    plate[0], sink[0], flux[0] = memory[READ_PLATE], memory[READ_SINK], memory[READ_FLUX]
    for i in range(current.shape[0]):
        current[i] = memory[CURRENT]
    return 0
