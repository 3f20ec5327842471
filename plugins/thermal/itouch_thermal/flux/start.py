"""The start temperature of the plate: what it must have when the finger arrives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch_thermal.display.column import F_END, F_PORT, P_END, P_PORT, Array, Column
from itouch_thermal.flux import planner
from itouch_thermal.solver.layers import Layer

#: Steps over which flux and skin are weighed, knots of the trial pump, and the seconds after which flux counts.
STEPS, KNOTS, COUNTED_FROM = 80, 8, 0.1
#: One kelvin of skin weighs as much as this flux [W/m2] at first; a pump at its limit as much as this.
SKIN_WEIGHT, PUMP_WEIGHT = 2e3, 3.0
#: Errors are relative to at least this flux [W/m2]; seconds of contact; how often the skin's weight is lessened.
FLOOR, SCORED_FOR, TRIES = 200.0, 10.0, 12
#: Parts of the pump's limit to plan with, the rest being for what differs, and the flux error that they must leave,
#: relative and as a mean over SCORED_FOR.  The first is taken with which the skin stays this close [K], ever and from
#: 0.3 s on; if none does, the flux comes first.
TRIALS = ((0.5, 7e-4), (0.6, 7e-4), (0.7, 7e-4), (0.85, 7e-4), (1.0, 7e-4), (1.0, 2e-3), (1.0, 4e-3))
OTHERWISE = (0.55, 6e-4)
SKIN_EVER, SKIN_LATER = 0.119, 0.018
#: Difference of skin and object [K] from which on the flux comes first.
WIDE = 11.0
#: How far start temperatures stay from the ends of the band [K].
MARGIN = 0.1


def equation_three(material: float, plate: float, tissue: float, object_temperature: float, skin: float) -> float:
    """Return the plate temperature [K] of equation 3 of the paper.

    Parameters
    ----------
    material, plate, tissue
        Effusivities [W s^1/2 / m2K].
    object_temperature, skin
        Temperatures [K] before the touch.
    """
    contact = (material * object_temperature + tissue * skin) / (material + tissue)
    return contact * (plate + tissue) / plate - tissue * skin / plate


def within(band: tuple[float, float], wanted: float) -> float:
    """Return the nearest start temperature [K] that stays inside the band by what the sensor may be off."""
    return min(band[1] - MARGIN, max(band[0] + MARGIN, wanted))


def outer_effusivity(layers: Sequence[Layer]) -> float:
    """Return the effusivity of the first layer."""
    return layers[0].effusivity


class Trial(NamedTuple):
    """A column at coarse steps and what drives it: delay in steps, expected resistance, greatest flux."""

    column: Column
    constants: Array
    resistance: float
    delay: int
    limit: float
    reference: float


def start_temperature(trial: Trial, finger: Array, desired: Array, skin: Array) -> tuple[float, Array]:
    """Return the start temperature [K] from which the first moments come closest, and the flux they then have.

    A pump that begins after the delay and the plate's temperature are chosen together by least squares, so that from
    0.1 s on the flux is the desired one and all the time the skin is as warm as it should be.

    Parameters
    ----------
    finger
        Coordinates of the finger at the begin, shape (n,).
    desired, skin
        Desired flux [W/m2] and skin temperature [K] at the ends of the coarse steps, shape (STEPS,).
    """
    free, warmer, pumps = _responses(trial, finger)
    times = np.arange(1, STEPS + 1) * trial.column.period
    found = np.zeros(0)
    # With a greater difference than that between skin and room no pump holds the skin so close: then flux is first.
    wide = abs(float(desired[0])) * trial.resistance > WIDE
    for share, first in (OTHERWISE,) if wide else (*TRIALS, OTHERWISE):
        columns = np.stack([warmer, *(share * pump for pump in pumps)], axis=-1)
        found = _weighed(columns, desired - free[0], skin - free[1], times, desired, first)
        apart = np.abs(skin - free[1] - columns[1] @ found)
        if apart.max() <= SKIN_EVER and apart[times >= 0.3].max() <= SKIN_LATER:
            break
    return trial.reference + float(found[0]), free[0] + columns[0] @ found


def _weighed(columns: Array, flux: Array, skin: Array, times: NDArray[Any], desired: Array, first: float) -> Array:
    """Return the least squares with as much weight on the skin as leaves the flux right."""
    scored, weight = times >= COUNTED_FROM, SKIN_WEIGHT
    scale = np.maximum(np.abs(desired), FLOOR)
    found = np.zeros(columns.shape[-1])
    for _ in range(TRIES):
        found = _least(columns, flux, skin, scored, weight)
        error = ((columns[0] @ found - flux) / scale)[scored]
        if np.sqrt(np.sum(error**2) * (times[1] - times[0]) / SCORED_FOR) <= first:
            break
        weight *= 0.6
    return found


def _least(columns: Array, flux: Array, skin: Array, scored: NDArray[np.bool_], skin_weight: float) -> Array:
    """Return plate temperature and pump knots, within the pump's limits, that come closest to flux and skin."""
    rows = np.concatenate((columns[0][scored], skin_weight * columns[1]))
    aim = np.concatenate((flux[scored], skin_weight * skin))
    count = columns.shape[-1]
    weight = np.diag(np.concatenate(([0.0], np.full(count - 1, PUMP_WEIGHT))))
    found, held = np.zeros(count), np.zeros(count, bool)
    for _ in range(count):
        stacked = np.concatenate((rows[:, ~held], weight[:, ~held]))
        target = np.concatenate((aim - rows[:, held] @ found[held], np.zeros(count)))
        found[~held] = np.linalg.lstsq(stacked, target, rcond=None)[0]
        over = ~held & (np.abs(found) > 1.0)
        over[0] = False
        if not over.any():
            break
        found[over] = np.sign(found[over])
        held |= over
    return found


def _responses(trial: Trial, finger: Array) -> tuple[Array, Array, list[Array]]:
    """Return flux and skin, shape (2, STEPS): by itself, of 1 K more in the plate, and of each knot of the pump."""
    still = np.zeros_like(finger)
    cold = np.zeros(trial.column.plate.shape[1])
    rest = trial.column.rest - trial.reference
    silent = np.zeros(STEPS)
    free = _run(trial, finger, cold, silent, rest)
    free[1] += trial.column.rest
    warmer = _run(trial, still, np.array(trial.column.flat), silent, 0.0)
    return free, warmer, [_run(trial, still, cold, trial.limit * hat, 0.0) for hat in _hats(trial.delay)]


def _hats(delay: int) -> list[Array]:
    """Return the pump's knots as shapes over the steps, closer together at first."""
    places = delay + np.concatenate(([0.0], np.cumsum(np.geomspace(1.5, 0.35 * STEPS, KNOTS - 1))))
    steps = np.arange(STEPS) + 0.5
    found = [np.interp(steps, places, unit) for unit in np.eye(KNOTS)]
    return [np.where(steps > delay, hat, 0.0) for hat in found]


def _run(trial: Trial, finger: Array, plate: Array, pump: Array, rest: float) -> Array:
    above, below = finger.copy(), plate.copy()
    tissue, lower = trial.column.tissue, trial.column.plate
    selves = float(tissue[F_PORT] @ tissue[F_END]), float(lower[P_PORT] @ lower[P_END])
    flux = (rest + float(tissue[F_PORT] @ above) - float(lower[P_PORT] @ below)) / trial.resistance
    found = np.empty((2, STEPS))
    for i in range(STEPS):
        flux = planner.ahead(
            trial.constants, tissue, lower, above, below, flux, float(pump[i]), trial.resistance, 1.0, 1.0, *selves,
            rest,
        )  # fmt: skip
        found[:, i] = flux, float(tissue[F_PORT] @ above)
    return found
