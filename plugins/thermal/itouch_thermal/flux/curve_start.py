"""The skin temperature under a recorded flux curve, and the start temperature from which a display can follow it."""

from __future__ import annotations

import math

import numpy as np

from itouch_thermal.display.column import F_BEGIN, F_DECAY, F_END, F_PORT, Array, Column
from itouch_thermal.flux.curve import Curve
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.flux.preview import rising
from itouch_thermal.flux.start import Touched, Trial, start_temperature
from itouch_thermal.laws import press_factor


def skin_under(column: Column, finger: Array, flux: Array) -> Array:
    """Return the skin temperature [K] at the ends of steps, at which a flux [W/m2] out of the finger is given.

    Flux and result have the shape (steps,); ``finger`` (modes,) are the coordinates of the finger [K] before the first
    step.  The flux is linear within a step, constant in the first.
    """
    rows, state, before = column.tissue, finger.copy(), float(flux[0])
    found = np.empty(len(flux))
    for i, after in enumerate(flux.tolist()):
        state = rows[F_DECAY] * state - rows[F_BEGIN] * before - rows[F_END] * after
        found[i] = column.rest + float(rows[F_PORT] @ state)
        before = after
    return found


def start_for_curve(law: ModelLaw, press: float, curve: Curve, skin: float) -> float:
    """Return the start temperature [K] from which a curve can be followed, for a skin temperature [K].

    ``press`` [s] is the time constant with which a finger is set down on the plate.
    """
    trial, finger, coarse = Trial(law), rising(law.fine, skin), law.coarse_ticks
    flux = curve.at(law.period * np.arange(1, trial.needed * coarse + 1))
    every = slice(coarse - 1, None, coarse)
    factor = np.array([press_factor((i + 1) * law.step, press) for i in range(trial.needed)])
    touched = Touched(flux[every], skin_under(law.fine, finger, flux)[every], factor, math.inf)
    return start_temperature(trial, finger, touched)
