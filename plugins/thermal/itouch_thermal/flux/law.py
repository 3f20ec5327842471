"""The `model` controller put together: estimator, approach and plan on one set of State fields."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from itouch.plugin import Field, Record
from itouch_thermal.display.column import P_MEAN, REACH, Array, column, plate_capacity
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.display.peltier import current_for
from itouch_thermal.flux import observer as at
from itouch_thermal.flux import planner
from itouch_thermal.flux.start import Trial
from itouch_thermal.solver.layers import Layer

#: Coarse steps that cover the delay; without a delay a coarse step is FREE long [s].
GROUPS, FREE = 4, 5e-3
#: What is thought possible before anything is measured: one standard deviation of each parameter.
PRIOR = (0.25, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.05, 20.0, 0.4)
#: Random walk of the unexplained flux [W/m2 per root second] and of the plate sensor's offset [K per root second].
DRIFT_FLUX, DRIFT_OFFSET = 10.0, 1e-3
#: Part of the squared response below which a change of the plan is not worth its noise.
SMOOTH = 1e-5
#: Time [s] in which an error of the plate's heat is made good before a touch.
DEADBEAT = 0.012
#: The plate's modes count from here [K].
REFERENCE = 296.15
#: Recompute the plan's responses every so many ticks of a touch.
REFRESH = 16


@njit(cache=True, error_model="numpy")
def _queue(line: Any, slot: int, delay: int, out: Any) -> None:
    """Average the currents on their way, oldest first, in the plan's coarse steps."""
    groups = out.shape[0]
    if groups == 0:
        return
    size = delay // groups
    for g in range(groups):
        total = 0.0
        for i in range(size):
            total += line[(slot + g * size + i) % delay]
        out[g] = total / size


@njit(cache=True, error_model="numpy")
def _track(
    c: Any, tissue: Any, plate: Any, x: Any, theta: Any, cover: Any, gain: Any, memory: Any, line: Any, slots: Any,
    sent: float, scale: float, flux: float, film: float, sink: float,
) -> None:  # fmt: skip
    """Take in what was sent and read, in one call a tick."""
    delay = int(slots[1])
    current = sent
    if delay > 0:
        slot = int(slots[0])
        current = line[slot]
        line[slot] = sent
        slots[0] = (slot + 1) % delay
    at.observe(c, tissue, plate, x, theta, cover, gain, memory, current, scale, flux, film, sink)


@njit(cache=True, error_model="numpy")
def _approach(
    c: Any, tissue: Any, plate: Any, x: Any, theta: Any, memory: Any, line: Any, delay: int, target: float,
    capacity: float, limit: float, ceiling: float, within: float,
) -> Any:  # fmt: skip
    """Return the current [A] that brings the plate's heat to a target [K], the flux behind it and the error [K]."""
    n, m = tissue.shape[1], plate.shape[1]
    gp = 1.0 / (1.0 + theta[at.PLATE])
    seebeck, legs = c[at.O_SEEBECK] * (1.0 + theta[at.SEEBECK]), c[at.O_CONDUCTANCE] * (1.0 + theta[at.LEGS])
    ohmic = c[at.O_RESISTANCE] * (1.0 + theta[at.OHMIC])
    mean = c[at.O_REFERENCE]
    for i in range(m):
        mean += plate[P_MEAN, i] * x[0, n + i]
    back, hot = x[0, n + m + at.X_BACK], memory[at.M_SINK]
    heat = capacity / gp
    air = c[at.O_AIR] * (c[at.O_AMBIENT] - mean)
    for i in range(delay):
        pump = (seebeck * back * line[i] - 0.5 * line[i] * line[i] * ohmic - legs * (hot - back)) / c[at.O_AREA]
        change = c[at.O_PERIOD] * (air - pump - theta[at.FLUX]) / heat
        mean += change
    error = mean - target
    flux = min(limit, max(-limit, heat * error / within + air))
    current = current_for(seebeck, ohmic, legs, (flux - theta[at.FLUX]) * c[at.O_AREA], mean, hot)
    return min(ceiling, max(-ceiling, current)), flux, error


@njit(cache=True, error_model="numpy")
def _follow(
    c: Any, tissue: Any, plate: Any, x: Any, theta: Any, memory: Any, scale: float, line: Any, slots: Any, queue: Any,
    wanted: Any, response: Any, last: Any, work: Any, limit: float, ceiling: float, band: Any, capacity: float,
    coarse: float, hold: int,
) -> Any:  # fmt: skip
    """Return the current [A] that follows the plan, and the flux behind it."""
    n, m = tissue.shape[1], plate.shape[1]
    above, below = work[:n], work[n : n + m]
    rest = work[n + m :]
    _queue(line, int(slots[0]), int(slots[1]), queue)
    ticks = memory[at.M_TICKS]
    if ticks % REFRESH < hold:
        planner.respond(c, tissue, plate, theta, scale, above, below, response)
    memory[at.M_TICKS] = ticks + hold
    flux, back = planner.plan(
        c, tissue, plate, x, theta, memory, scale, queue, wanted, response, last, above, below, rest, SMOOTH, limit,
        (ticks + slots[1]) * c[at.O_PERIOD], coarse,
    )  # fmt: skip
    # A current that is held for long carries the plan's mean over that time.
    part = min(1.0, hold * c[at.O_PERIOD] / (4.0 * coarse))
    flux += 0.5 * part * (last[1] - last[0])
    # Towards an end of the band the pump may at most carry what keeps the plate there.
    gp = 1.0 / (1.0 + theta[at.PLATE])
    coming = x[0, n + m + at.X_FLUX]
    slack = 0.05
    flux = min(flux, coming + capacity / gp * (back - band[0] - slack) / 0.05)
    flux = max(flux, coming - capacity / gp * (band[1] - slack - back) / 0.05)
    seebeck, legs = c[at.O_SEEBECK] * (1.0 + theta[at.SEEBECK]), c[at.O_CONDUCTANCE] * (1.0 + theta[at.LEGS])
    ohmic = c[at.O_RESISTANCE] * (1.0 + theta[at.OHMIC])
    current = current_for(seebeck, ohmic, legs, (flux - theta[at.FLUX]) * c[at.O_AREA], back, memory[at.M_SINK])
    return min(ceiling, max(-ceiling, current)), flux


class ModelLaw:
    """The `model` controller on a record of State; it keeps only constants.

    Parameters
    ----------
    display
        What the display's data sheets say.
    tissue, core, skin
        The finger: layers, core and resting skin temperature [K].
    resistance
        Contact resistance [K m2/W] that is expected.
    ambient
        Room [K].
    period
        Seconds between two calls.
    band, ceiling
        Lowest and highest plate temperature [K]; greatest current [A].
    prefix
        Of its fields' names in the State.
    """

    def __init__(
        self, display: DisplayParams, tissue: tuple[Layer, ...], core: float, skin: float, resistance: float,
        ambient: float, period: float, *, band: tuple[float, float], ceiling: float, prefix: str = "",
    ) -> None:  # fmt: skip
        self.display, self.period, self.prefix, self.ceiling = display, period, prefix, ceiling
        self.delay = round(display.delay / period)
        groups = GROUPS if self.delay >= GROUPS and self.delay % GROUPS == 0 else 0
        self.coarse_ticks = self.delay // GROUPS if groups else max(1, round(FREE / period))
        self.fine = column(tissue, core, skin, display.plate, period, REACH / 1e-3)
        self.coarse = column(tissue, core, skin, display.plate, period * self.coarse_ticks, REACH / 1e-3)
        self.groups = groups
        self.ahead = self.delay + planner.AHEAD * self.coarse_ticks
        self.capacity = plate_capacity(display.plate)
        self.band = np.array(band)
        self.constants = _constants(display, self.fine.rest, resistance, ambient, period)
        self.prior = np.array(PRIOR)
        #: Where in the future, counted in periods from the last end of a step, the plan looks.
        self.offsets = self.delay + np.arange(1, planner.AHEAD + 1) * self.coarse_ticks - 1
        self.trial = Trial(self.coarse, self.constants, resistance, groups, display.flux_limit, REFERENCE)

    def fields(self) -> tuple[Field, ...]:
        """Return its State."""
        n, m = self.fine.tissue.shape[1], self.fine.plate.shape[1]
        wide = n + m + at.X_TAIL
        sizes: dict[str, int | tuple[int, ...]] = {
            "x": (1 + at.COUNT, wide), "theta": at.COUNT, "cover": (at.COUNT, at.COUNT), "gain": at.COUNT,
            "memory": at.M_TAIL, "line": max(1, self.delay), "slots": 2, "queue": self.groups or 1,
            "wanted": planner.AHEAD, "response": (planner.HATS, planner.AHEAD), "knots": planner.HATS,
            "work": wide + planner.HATS * (planner.HATS + 1) + planner.AHEAD, "future": self.ahead + 1,
        }  # fmt: skip
        return tuple(Field(self.prefix + name, "f8", size) for name, size in sizes.items())

    def reset(self, state: Record) -> None:
        """Begin with an even plate at the room's temperature and the data sheets' values."""
        p = self.prefix
        n, m = self.fine.tissue.shape[1], self.fine.plate.shape[1]
        for field in self.fields():
            state[field.name] = 0.0
        state[p + "cover"] = np.diag(self.prior**2)
        ambient = self.constants[at.O_AMBIENT]
        x = state[p + "x"]
        x[0, n : n + m] = self.fine.flat * (ambient - REFERENCE)
        x[0, n + m + at.X_BACK] = x[0, n + m + at.X_FACE] = x[0, n + m + at.X_FILM] = ambient
        state[p + "memory"][[at.M_SINK, at.M_SINK_SEEN]] = ambient
        state[p + "memory"][at.M_CONTACT] = 1.0
        state[p + "slots"][1] = self.delay

    def track(self, state: Record, sent: float, flux: float, film: float, sink: float, scale: float = 1.0) -> None:
        """Take in the current [A] sent a tick ago and the newest readings."""
        s, p = state, self.prefix
        _track(
            self.constants, self.fine.tissue, self.fine.plate, s[p + "x"], s[p + "theta"], s[p + "cover"],
            s[p + "gain"], s[p + "memory"], s[p + "line"], s[p + "slots"], sent, scale, flux, film, sink,
        )  # fmt: skip

    def approach(self, state: Record, target: float, hold: int = 1) -> tuple[float, float, float]:
        """Return current [A] and flux [W/m2] that bring the plate to ``target`` [K], and how far it is [K].

        The current will be held for ``hold`` periods.
        """
        s, p = state, self.prefix
        found: tuple[float, float, float] = _approach(
            self.constants, self.fine.tissue, self.fine.plate, s[p + "x"], s[p + "theta"], s[p + "memory"],
            s[p + "line"], self.delay, target, self.capacity, self.display.flux_limit, self.ceiling,
            max(DEADBEAT, 1.5 * hold * self.period),
        )  # fmt: skip
        return found

    def disturb(self, state: Record) -> None:
        """Say that something else than air is on the plate."""
        state[self.prefix + "memory"][at.M_QUIET] = at.QUIET

    def place(self, state: Record, finger: Array) -> None:
        """Say what finger is about to touch, by its coordinates."""
        state[self.prefix + "x"][0, : len(finger)] = finger

    def begin(self, state: Record, flux: float, scale: float = 1.0) -> None:
        """Set the finger on the plate; ``flux`` [W/m2] is the last one pumped, ``scale`` as in `track`."""
        s, p = state, self.prefix
        s[p + "memory"][at.M_CONTACT] = scale
        at.begin_touch(
            self.constants, self.fine.tissue, self.fine.plate, s[p + "x"], s[p + "theta"], s[p + "cover"],
            s[p + "memory"], self.prior,
        )  # fmt: skip
        s[p + "knots"] = flux
        s[p + "memory"][at.M_TICKS] = 0.0

    def end(self, state: Record) -> None:
        """Take the finger off."""
        s, p = state, self.prefix
        at.end_touch(self.fine.tissue, self.fine.plate, s[p + "x"], s[p + "memory"])

    def follow(self, state: Record, scale: float = 1.0, hold: int = 1) -> tuple[float, float]:
        """Return current [A] and flux [W/m2] that make the contact flux follow the field ``wanted``."""
        s, p = state, self.prefix
        found: tuple[float, float] = _follow(
            self.constants, self.coarse.tissue, self.coarse.plate, s[p + "x"], s[p + "theta"], s[p + "memory"], scale,
            s[p + "line"], s[p + "slots"], s[p + "queue"][: self.groups], s[p + "wanted"], s[p + "response"],
            s[p + "knots"], s[p + "work"], self.display.flux_limit, self.ceiling, self.band, self.capacity,
            self.coarse.period, hold,
        )  # fmt: skip
        return found


def _constants(p: DisplayParams, rest: float, resistance: float, ambient: float, period: float) -> Array:
    c = np.zeros(at.O_CONSTANTS)
    c[at.O_PERIOD], c[at.O_REST], c[at.O_REFERENCE], c[at.O_CONTACT] = period, rest, REFERENCE, resistance
    c[at.O_SEEBECK], c[at.O_RESISTANCE], c[at.O_CONDUCTANCE], c[at.O_AREA] = (
        p.seebeck, p.resistance, p.conductance, p.area,
    )  # fmt: skip
    c[at.O_FLUX_LAG], c[at.O_PLATE_LAG] = max(p.flux_lag, 1e-6), max(p.plate_lag, 1e-6)
    c[at.O_FLUX_NOISE] = math.hypot(p.flux_noise, p.flux_resolution) + 1e-3
    c[at.O_PLATE_NOISE] = math.hypot(p.plate_noise, p.plate_resolution) + 1e-6
    c[at.O_SINK_CAPACITY], c[at.O_SINK_RESISTANCE], c[at.O_SINK_LAG] = p.sink_capacity, p.sink_resistance, p.sink_lag
    c[at.O_AIR], c[at.O_COVER] = p.film_coefficient, p.contact_area / p.area
    c[at.O_SEEN], c[at.O_AMBIENT] = min(1.0, p.contact_area / p.sensor_area), ambient
    c[at.O_DRIFT_FLUX], c[at.O_DRIFT_OFFSET] = DRIFT_FLUX**2 * period, DRIFT_OFFSET**2 * period
    c[at.O_CEILING] = 0.98 * p.full_scale
    c.setflags(write=False)
    return c
