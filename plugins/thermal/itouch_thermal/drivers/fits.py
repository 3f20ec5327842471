"""Calibrating a display: the gain of its flux sensor, and the module from its answer to a step of current."""

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
#: Parameters of the module that a step shows, the part by which they are varied, and how often the fit is improved.
MODULE, _VARIED, _ROUNDS = ("seebeck", "resistance", "conductance"), 0.01, 6
_STEP = 1e-3
_FAR = 3.0
#: What is left over is doubted above so many times the sensors' noise, and so much of the swing; a parameter that is
#: more than so many times the scene's, or less than its part.
_NOISES, _OF_SWING, _OTHER = 4.0, 0.01, 2.0


def without_sensor(params: Any) -> str:
    """Return what is missing for the gain of the flux sensor: the sensor."""
    if params.labjack is None or params.labjack.flux_sensor is None:
        return "there is no <thermal:flux-sensor> whose gain could be found"
    return ""


def flux_gain(params: Any, samples: Array) -> Fitted:
    """Return sensitivity and offset of the flux sensor from fluxes of a reference and what the display read then.

    ``samples`` (n, 2): reference [W/m2] and what the display read [W/m2].
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
    """Return the module's parameters at which the plant answers a current as was measured (Gauss-Newton).

    The plant is the display's twin without a finger; plate and sink begin at the temperature of the first sample.

    ``samples`` (n, 4): time [s], current [A], plate and sink [K].
    """
    times, currents, plate, sink = samples.T
    if len(times) < 20 or np.ptp(currents) < 0.1 or np.any(np.diff(times) <= 0.0):
        raise ValueError("a step response needs 20 samples or more at growing times, and a step of 0.1 A or more")
    measured = np.concatenate([plate, sink])
    start = np.array([getattr(params, name) for name in MODULE])
    found = np.zeros(3)  # logarithms of the ratios to the start

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
    """Yield why a step may be of another display: it is not answered as measured, or only by quite another module.

    ``residual`` and ``swing`` are rms values [K]: of what is left over, and of what was measured.
    """
    noise = math.hypot(params.plate_noise, params.sink_noise) / math.sqrt(2.0)
    if residual > max(_NOISES * noise, _OF_SWING * swing):
        yield (
            f"with the best module this display still answers {residual:.2g} K (rms) off what was measured, and its "
            f"sensors' noise is {noise:.2g} K: another plate or sink, a finger on it, or another time base?"
        )
    for name, value in values.items():
        ratio = value / getattr(params, name)
        if not 1.0 / _OTHER <= ratio <= _OTHER:
            yield f"{name} comes out {ratio:.2g} times what the scene says: another module?"


def _simulate(params: Any, times: Array, currents: Array, begin: float) -> Array:
    """Return the plate's and the sink's readings of the twin at these times [K], shape (2 n,)."""
    quiet = replace(params, plate_noise=0.0, sink_noise=0.0, flux_noise=0.0, skin_noise=0.0)
    twin = DisplayTwin(quiet)
    twin.set_environment(begin, None)
    reads, commands = channels(quiet)
    state = Record.of(twin.fields())
    reading, command = (Record.of(Field.of(c) for c in side) for side in (reads, commands))
    twin.reset(state, np.random.default_rng(0))
    step = twin.bound_step(state, command, TwinInputs(ambient=begin), _STEP)  # bound once: there are many
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
