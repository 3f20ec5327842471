"""From the controller's current to the command of the display's driver: a current, or a temperature target.

A current driver is given the current.  A driver that holds a temperature has a PI controller of its own, whose gains
are in its data: it is given the target at which this controller delivers the wanted current, on average until the next
command.  To find that target, the readings of the plate's sensor are extrapolated, and the driver's integral is
inferred from the current that it reports and from the targets that are still on their way to it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from itouch.plugin import Bound, Field, Record
from itouch.plugin.kernels import kernel, linked
from itouch_thermal.flux.flux_model import FluxModel
from itouch_thermal.flux.views import Scene

#: Time constants [s] of the filters of the plate's level and slope, and of the driver's integral.
LEVEL, INTEGRAL = 0.03, 0.05
#: Indices into the memory: filtered reading of the plate, its slope, the driver's integral; and its length.
_PLATE, _SLOPE, _INTEGRAL, _MEMORY = range(4)


def fields(model: FluxModel) -> tuple[Field, ...]:
    """Return the State fields that a temperature driver needs; a current driver needs none."""
    if model.display.command == "current":
        return ()
    delay = round(model.display.delay / model.period)
    return (
        Field(
            "asked", unit="A", doc="current that the controller wants of a driver that holds a temperature", show="no"
        ),
        Field(
            "driver",
            "f8",
            _MEMORY,
            unit="mixed",
            doc="filtered reading of the plate [K], its slope [K/s] and the driver's integral [A]",
        ),
        Field("targets", "f8", delay + 1, unit="K", doc="targets that are on their way to the driver"),
    )


def channels(model: FluxModel) -> tuple[str, ...]:
    """Return the command channels of the display that are written."""
    names, device = model.names, model.params.display
    told = (names.command,) if model.display.command == "current" else (names.target, names.output)
    return tuple(field.replace(f"{device}.command.", f"{device}.", 1) for field in told if field)


def reset(model: FluxModel, state: Record) -> None:
    """Begin with a plate at the room's temperature, and an output that is off."""
    if model.display.command == "temperature":
        state[f"{model.name}.driver"] = (model.ambient, 0.0, 0.0)
        state[f"{model.name}.targets"] = 0.0


def bound(model: FluxModel, state: Record, scene: Scene) -> tuple[Bound, ...]:
    """Return the call that turns the wanted current into the command of a driver that holds a temperature, else ()."""
    names, display = model.names, model.display
    if display.command == "current":
        return ()
    flowing = state[names.actual or names.asked]  # one that reports no current is taken to give what was asked
    told = state[names.target], state[names.output] if names.output else np.zeros(1)
    driver = Driver(*(float(n) for n in (display.target_gain, display.target_integral, model.current, *model.band)))
    return (
        Bound(
            _issue, state[names.driver], state[names.targets], scene.plate_temperature, flowing, scene.command, *told,
            state[names.asked], driver, float(model.period), model.hold,
        ),
    )  # fmt: skip


class Driver(NamedTuple):
    """A driver's proportional [A/K] and integral gain [A/(K s)], its greatest current [A], and range of targets [K]."""

    gain: float
    integral: float
    ceiling: float
    low: float
    high: float


@kernel
def _issue(
    driver: Any, targets: Any, plate: Any, flowing: Any, current: Any, target: Any, output: Any, asked: Any, of: Driver,
    period: float, hold: int,
) -> int:  # fmt: skip
    """Command the target for the wanted ``current`` (1,) [A], which will be held for ``hold`` servo periods."""
    target[0], asked[0] = target_for(
        driver, targets, plate[0], flowing[0], current[0], of.gain, of.integral, of.ceiling, of.low, of.high, period,
        hold,
    )  # fmt: skip
    output[0] = 1.0
    return 0


@linked
def target_for(
    driver: Any, targets: Any, plate: float, actual: float, current: float, gain: float, integral: float,
    ceiling: float, low: float, high: float, period: float, hold: int,
) -> tuple[float, float]:  # fmt: skip
    """Return the target [K] that gives a wanted mean current [A], and the current [A] that it will give.

    Parameters
    ----------
    driver
        Memory of the driver, shape (3,): filtered plate reading [K], its slope [K/s], the driver's integral [A];
        changed.
    targets
        The targets [K] of the last periods, shape (delay + 1,), oldest first: the one in force, then those on their
        way; changed.
    plate, actual
        Newest readings of plate [K] and current [A].
    current
        The wanted current [A].
    gain, integral, ceiling
        The driver's proportional [A/K] and integral gain [A/(K s)], and its greatest current [A].
    low, high
        Lowest and highest target that may be commanded [K].
    period, hold
        Period of the servo loop [s], and for how many periods the target will stand.
    """
    _observe(driver, targets[0], plate, actual, gain, integral, ceiling, period * hold)
    level, slope, summed = driver[0], driver[1], driver[2]
    delay = targets.shape[0] - 1
    for i in range(1, delay + 1):
        if targets[i] > 0.0:
            error = level + slope * (i - 0.5) * period - targets[i]
            if abs(gain * error + summed) < ceiling:
                summed += integral * error * period
    middle = level + slope * (delay + 0.5 * hold) * period
    stiffness = gain + 0.5 * integral * hold * period
    target = min(high, max(low, middle - (current - summed) / stiffness))
    for i in range(delay + 1):
        targets[i] = targets[i + hold] if i + hold <= delay else target
    return target, min(ceiling, max(-ceiling, stiffness * (middle - target) + summed))


@kernel
def _observe(
    driver: Any, target: float, plate: float, actual: float, gain: float, integral: float, ceiling: float, time: float
) -> None:
    """Filter the plate's reading and its slope, and update the driver's integral from the current that it reports."""
    part = min(1.0, time / LEVEL)
    driver[0] += driver[1] * time
    miss = plate - driver[0]
    driver[0] += (2.0 - part) * part * miss
    driver[1] += part * part / time * miss
    if target <= 0.0:
        driver[2] = 0.0
        return
    error = driver[0] - target
    if abs(actual) < 0.999 * ceiling:
        driver[2] += integral * error * time
        driver[2] += min(1.0, time / INTEGRAL) * (actual - gain * error - driver[2])
