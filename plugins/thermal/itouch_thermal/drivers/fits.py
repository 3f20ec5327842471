"""Calibrations of a display: the gain of its flux sensor, and its module from the response to a current step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Field, Fit, Fitted, Record, TwinInputs, line_through
from itouch_thermal.display.channels import channels
from itouch_thermal.display.display_twin import DisplayTwin

Array = NDArray[np.float64]
#: Parameters of the module seen in a step, the relative variation for their derivatives, and the number of iterations.
MODULE, _VARIED, _ROUNDS = ("seebeck", "resistance", "conductance"), 0.01, 6
_STEP = 1e-3
_FAR = 3.0
#: A residual above this many times the sensors' noise and this share of the swing is doubtful, as is a parameter above
#: this many times the scene's value, or below its inverse.
_NOISES, _OF_SWING, _OTHER = 4.0, 0.01, 2.0


def without_sensor(params: Any) -> str:
    """Return what is missing for the gain of the flux sensor: the sensor itself; empty if it is there."""
    if params.labjack is None or params.labjack.flux_sensor is None:
        return "there is no <thermal:flux-sensor> whose gain could be found"
    return ""


def flux_gain(params: Any, samples: Array) -> Fitted:
    """Return the flux sensor's sensitivity and offset from a reference's fluxes and the display's readings.

    ``samples``, shape (n, 2): the reference [W/m2], and the display's reading at that time [W/m2].
    """
    if lack := without_sensor(params):
        raise ValueError(lack)
    sensor = params.labjack.flux_sensor
    reference, read = samples.T
    slope, zero, residual = line_through(reference, read)
    if slope <= 0.0:
        raise ValueError("the display reads less at a greater flux: turn sign")
    values = {
        "labjack.flux_sensor.sensitivity": sensor.sensitivity * slope,
        "labjack.flux_sensor.offset": sensor.offset + sensor.sign * sensor.sensitivity * zero,
    }
    return Fitted(values, residual, "W/m^2")


def step_response(params: Any, samples: Array) -> Fitted:
    """Return the module's parameters for which the plant responds to a current as measured (Gauss-Newton).

    The plant is the display's twin without a finger; plate and sink start at the plate temperature of the first sample.

    ``samples``, shape (n, 4): time [s], current [A], plate and sink [K].
    """
    times, currents, plate, sink = samples.T
    if len(times) < 20 or np.ptp(currents) < 0.1 or np.any(np.diff(times) <= 0.0):
        raise ValueError("a step response needs 20 samples or more at growing times, and a step of 0.1 A or more")
    measured = np.concatenate([plate, sink])
    start = np.array([getattr(params, name) for name in MODULE])
    found = np.zeros(3)  # logarithms of the ratios to the initial values

    def answer(ratios: Array) -> Array:
        values = dict(zip(MODULE, (float(v) for v in start * np.exp(ratios)), strict=True))
        return _simulate(replace(params, datasheet=None, **values), times, currents, float(plate[0]))

    rest = measured - answer(found)
    for _ in range(_ROUNDS):
        slopes = np.stack([(answer(found + _VARIED * e) - answer(found)) / _VARIED for e in np.eye(3)], axis=1)
        found = np.clip(found + np.linalg.lstsq(slopes, rest, rcond=None)[0], -_FAR, _FAR)
        rest = measured - answer(found)
    values = dict(zip(MODULE, (float(v) for v in start * np.exp(found)), strict=True))
    residual = float(np.sqrt(np.mean(rest * rest)))
    swing = float(np.sqrt(np.mean((measured - plate[0]) ** 2)))
    return Fitted(values, residual, "K", tuple(_doubts(params, values, residual, swing)))


def _doubts(params: Any, values: Mapping[str, float], residual: float, swing: float) -> Iterator[str]:
    """Yield reasons to doubt that a step is of this display: a bad fit, or only a very different module fits.

    ``residual`` and ``swing`` are rms values [K]: of the fit's residual, and of the measured change.
    """
    noise = math.hypot(params.plate_noise, params.sink_noise) / math.sqrt(2.0)
    if residual > max(_NOISES * noise, _OF_SWING * swing):
        yield (
            f"even with the best module the computed response is {residual:.2g} K (rms) off the measured one, and the "
            f"sensors' noise is {noise:.2g} K: another plate or sink, a finger on it, or another time base?"
        )
    for name, value in values.items():
        ratio = value / getattr(params, name)
        if not 1.0 / _OTHER <= ratio <= _OTHER:
            yield f"{name} comes out {ratio:.2g} times what the scene says: another module?"


def _simulate(params: Any, times: Array, currents: Array, begin: float) -> Array:
    """Return the twin's readings of plate and sink at these times [K], shape (2 n,)."""
    quiet = replace(params, plate_noise=0.0, sink_noise=0.0, flux_noise=0.0, skin_noise=0.0)
    twin = DisplayTwin(quiet)
    twin.set_environment(begin, None)
    reads, commands = channels(quiet)
    state = Record.of(twin.fields())
    reading, command = (Record.of(Field.of(c) for c in side) for side in (reads, commands))
    twin.reset(state, np.random.default_rng(0))
    step = twin.bound_step(state, command, TwinInputs(ambient=begin), _STEP)  # bound once, for many steps
    shown = np.zeros((2, len(times)))
    ticks = 0
    for index, (time, current) in enumerate(zip(times - times[0], currents, strict=True)):
        while (ticks + 1) * _STEP <= time + 1e-9:
            step()
            ticks += 1
        command["current"] = current
        twin.read(state, reading)
        shown[:, index] = reading["plate_temperature"].item(), reading["sink_temperature"].item()
    flat: Array = shown.ravel()
    return flat


FITS = (
    Fit(
        "flux-gain",
        "let known fluxes through the sensor (a reference sensor on it) and write down what the display reads",
        ("reference [W/m^2]", "read [W/m^2]"), 365.0, flux_gain, without_sensor,
    ),
    Fit(
        "tec-step",
        "without a finger, record a step of current for some seconds; a current holds until the next sample",
        ("time [s]", "current [A]", "plate [K]", "sink [K]"), 90.0, step_response,
    ),
)  # fmt: skip
