"""Corrects a touch for the dynamics of its sensors, and computes how this amplifies their noise.

A film shows the flux through its middle with a lag: that flux is ``y + tau dy/dt``.  The flux out of the finger exceeds
it by the heat stored in the film's upper half, ``C/2 dT/dt`` with the film's temperature, whose lag is corrected alike.
Values and slopes come from a parabola through the samples around each time; its half width grows with the time since
the touch began, as does the time scale on which a touch changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from itouch_thermal.display.column import Array
from itouch_thermal.measuring.touches import Touched

#: Half width of the parabola relative to the time, and least number of samples on either side.
WIDTH, LEAST = 0.2, 3


@dataclass(frozen=True, slots=True)
class Sensors:
    """Calibration: lags of film and thermometer [s], heat capacity of the film [J/m2K]; 0: no correction.

    ``resistance`` [m2K/W] is the film's, from face to face; 0: unknown.
    """

    lag: float = 0.0
    film_lag: float = 0.0
    capacity: float = 0.0
    resistance: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """Flux out of the finger [W/m2] at times [s], and the amplification of each sensor's noise; shape (rows,).

    ``flux_gain`` is the flux film's, ``film_gain`` the flux [W/m2] per kelvin of the thermometer's noise.
    """

    times: Array
    flux: Array
    flux_gain: Array
    film_gain: Array


def output_times(last: float, every: float = 0.01) -> Array:
    """Return the times [s] of a curve's rows."""
    return np.asarray(np.arange(1, int(last / every + 1e-9) + 1, dtype=np.float64) * every)


def correct(touch: Touched, sensors: Sensors, times: Array) -> Corrected:
    """Return the flux out of the finger at times [s] since the start of the touch.

    ``times`` has shape (rows,); see `Corrected` for the result.
    """
    found, gains = np.empty(len(times)), np.empty((2, len(times)))
    period = float(np.median(np.diff(touch.times)))  # the median, as a reading may have been held
    half = 0.5 * sensors.capacity
    for k, time in enumerate(times.tolist()):
        width = max(WIDTH * time, LEAST * period)
        low, high = np.searchsorted(touch.times, (time - width, time + width))
        low, high = max(0, min(int(low), len(touch.times) - 7)), min(len(touch.times), max(int(high) + 1, 7))
        value, slope, bend = _parabola(touch.times[low:high] - time)
        flux = value + sensors.lag * slope
        found[k], gains[:, k] = flux @ touch.flux[low:high], (np.sqrt(flux @ flux), 0.0)
        if half > 0.0:  # if not, there may be no thermometer
            film = half * (slope + 2.0 * sensors.film_lag * bend)
            found[k] += film @ (touch.film[low:high] - touch.rest)
            gains[1, k] = np.sqrt(film @ film)
    return Corrected(times, found, *gains)


def _parabola(at: Array) -> tuple[Array, Array, Array]:
    """Return the weights of samples at times [s] for the value, slope and half second derivative at time 0."""
    scale = max(float(np.abs(at).max()), 1e-12)
    u = at / scale
    base = np.stack((np.ones_like(u), u, u * u))
    weights = np.linalg.solve(base @ base.T, base)
    return weights[0], weights[1] / scale, weights[2] / scale**2


@dataclass(frozen=True, slots=True, eq=False)
class Average:
    """Mean flux [W/m2] over touches at times [s], its standard error, and the gains of one touch; shape (rows,)."""

    times: Array
    flux: Array
    error: Array
    flux_gain: Array
    film_gain: Array
    count: int


def average(touches: list[Touched], sensors: Sensors, every: float = 0.01) -> Average:
    """Return the mean of touches, each corrected separately.

    Raises
    ------
    ValueError
        If there are no touches.
    """
    if not touches:
        raise ValueError("no touch is left to be averaged")
    times = output_times(min(float(touch.times[-1]) for touch in touches), every)
    found = [correct(touch, sensors, times) for touch in touches]
    rows = np.stack([one.flux for one in found])
    many = len(rows) > 1
    error = rows.std(axis=0, ddof=1) / np.sqrt(len(rows)) if many else np.full(len(times), np.nan)
    return Average(times, rows.mean(axis=0), error, found[0].flux_gain, found[0].film_gain, len(rows))
