"""The law of the controller `model`: estimator, approach and plan on one set of State fields."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from contact_heat.layers import Layer
from itouch.plugin import Field, Record
from itouch.plugin.kernels import kernel
from itouch_thermal.display.column import REACH, Array, column, plate_capacity
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.display.sideways import Sideways
from itouch_thermal.drivers.driver_params import SAMPLING
from itouch_thermal.flux import late_readings, planner
from itouch_thermal.flux import observer as at
from itouch_thermal.flux.current_command import AT_ONCE, FutureCurrent, approach_current, plan_current
from itouch_thermal.flux.limits import RATE_OVER


class Memory(NamedTuple):
    """Views of the law's State fields; what each is, and in which unit, stands in `_MEANINGS`.

    With p parameters, n and m modes of tissue and plate, and the plan's steps: ``x`` (1 + p, n + m + X_TAIL); ``theta``
    and ``gain`` (p,); ``cover`` (p, p); ``memory`` (M_TAIL,), or one more; ``line`` (delay,), at least (1,); ``slots``
    (2,); ``wanted`` (steps,); ``span`` (2, steps); ``response`` (HATS, steps); ``knots`` (HATS,); ``past`` (1 +
    longest, width); ``kept`` (KEPT,); ``future`` (ahead + 1,); ``work``, ``trace``, ``single`` and ``queue`` (k,), each
    with its own k, see `ModelLaw.fields`.
    """

    x: Array
    theta: Array
    cover: Array
    gain: Array
    memory: Array
    line: Array
    slots: Array
    wanted: Array
    response: Array
    knots: Array
    work: Array
    trace: Array
    span: Array
    past: Array
    kept: Array
    future: Array
    single: Array
    queue: Array


class Fixed(NamedTuple):
    """Arrays that never change: the column in fine and coarse steps, and what planning and covering need besides.

    ``hats`` (HATS, steps) are the plan's functions [1], ``band`` (2,) the plate's [K], ``offsets`` (steps,) the times
    at which the plan looks, in periods; ``pad`` (4,) as in `observer.seen`, ``prior`` (p,) how far each parameter may
    be from the data sheets, in its own unit.
    """

    fine: at.Basis
    coarse: at.Basis
    hats: Array
    band: Array
    offsets: Any
    pad: Array
    prior: Array


class Bounds(NamedTuple):
    """Numbers that never change: periods in a coarse step, greatest flux [W/m2] and current [A], and the plate's heat.

    ``capacity`` is the plate's [J/m2K].
    """

    size: int
    flux_limit: float
    ceiling: float
    capacity: float


#: Length of the plan's coarse steps [s], as near as the period allows.
COARSE = 5e-3
#: How far a display may differ from its data sheet, before its first touch shows it: the standard deviation of each
#: parameter.
PRIOR = (0.25, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.05, 20.0, 0.7)
#: The same, behind a wire, for the time at which the finger came, and for the delay [s].
PRIOR_ONSET, PRIOR_DELAY = 4e-3, 4e-3
#: Random walk of the unexplained flux [W/m2 per root second] and of the plate sensor's offset [K per root second].
DRIFT_FLUX, DRIFT_OFFSET = 3.0, 1e-3
#: Share of its remaining way to the flux by which the flux sensor's reading may be wrong on a rig of one's own: its
#: filter and converter are no simple lag.  It counts as noise of the reading.
LAGS = 0.1
#: Time [s] in which an error of the plate's heat is corrected before a touch.
DEADBEAT = 0.012
#: Greatest number of periods without news that are caught up with; after more, the plate is as its sensors say.
MISSED = 250
#: Temperature [K] from which the plate's modes are counted.
REFERENCE = 296.15

#: Unit and meaning of each field of its State, in order.
_MEANINGS = {
    "x": ("mixed", "the column of finger and plate, and its derivative with respect to each parameter"),
    "theta": ("mixed", "what the estimator has found of the parameters"),
    "cover": ("mixed", "covariance of the parameters"),
    "gain": ("mixed", "gain of the estimator in the last update"),
    "memory": ("mixed", "what the estimator remembers beside the column"),
    "line": ("A", "currents on their way to the module"),
    "slots": ("1", "where the line of currents begins, and how long it is"),
    "single": ("A", "currents on their way that are no whole coarse step"),
    "queue": ("A", "means of the currents on their way, one per coarse step"),
    "wanted": ("W/m^2", "desired flux at the ends of the plan's steps"),
    "response": ("mixed", "flux at the ends of the plan's steps that each piece of the plan makes"),
    "knots": ("W/m^2", "the plan"),
    "work": ("mixed", "scratch space"),
    "future": ("W/m^2", "desired flux from now on"),
    "trace": ("K", "the plate's face in the last half second"),
    "span": ("K", "lowest and highest face that is allowed at the ends of the plan's steps"),
    "past": ("mixed", "what was expected to be read in the last periods, with its derivatives"),
    "kept": ("1", "the next row of `past`, how many rows count, and whether the plate is disturbed"),
}


@kernel
def _track(
    basis: Any, own: Any, size: int, sent: float, scale: float, press: float, flux: float, film: float, sink: float
) -> None:  # fmt: skip
    """Take in the current that was sent and the readings, in one call per period; see `ModelLaw.track`."""
    x, memory, line, slots, trace = own.x, own.memory, own.line, own.slots, own.trace
    column = basis.tissue.shape[1] + basis.plate.shape[1]
    delay = int(slots[1])
    current = sent
    if delay > 0:
        slot = int(slots[0])
        current = line[slot]
        line[slot] = sent
        slots[0] = (slot + 1) % delay
    at.observe(basis, own, current, scale, press, flux, film, sink)
    if memory[at.M_TOUCHING] > 0.0:
        if memory[at.M_AGE] % size == 0.0:
            trace[int(memory[at.M_AGE] / size) % trace.shape[0]] = x[0, column + at.X_FACE]
        memory[at.M_AGE] += 1.0
    if own.past.shape[0] > 1:
        late_readings.remember(x, own.theta, memory, own.past, own.kept, column)


@kernel
def _pass(
    basis: Any, own: Any, size: int, count: int, before: float, after: float, change: int, scale: float, press: float
) -> None:  # fmt: skip
    """Let ``count`` periods pass without readings; from period ``change`` on, counted from 0, ``after`` [A] leaves.

    A negative ``change`` says that it left so many periods ago already: the currents on their way are corrected.
    """
    delay = int(own.slots[1])
    for i in range(min(-change, delay)):
        own.line[(int(own.slots[0]) - 1 - i) % delay] = after
    for i in range(count):
        sent = before if i < change else after
        _track(basis, own, size, sent, scale, press, math.nan, math.nan, math.nan)


@kernel
def _begin(fixed: Any, own: Any, flux: float, scale: float, onset: float) -> None:
    """Set the finger on the plate; see `ModelLaw.begin`."""
    c, tissue, plate, memory = fixed.fine.c, fixed.fine.tissue, fixed.fine.plate, own.memory
    memory[at.M_CONTACT] = scale
    at.begin_touch(c, tissue, plate, own.x, own.theta, own.cover, memory, fixed.prior, onset)
    own.knots[:] = flux
    own.trace[:] = own.x[0, tissue.shape[1] + plate.shape[1] + at.X_FACE]
    memory[at.M_TICKS] = memory[at.M_AGE] = 0.0
    own.kept[late_readings.VALID] = 0.0  # what was measured before knows nothing of this finger


@kernel
def _rendered(
    fixed: Any, own: Any, plant: Any, bounds: Any, leaving: Any, flux: Any, press: Any, found: Any, fingers: Any
) -> None:
    """Let a law render a contact on a plant, one call per period; see `ModelLaw.rendered`."""
    n, offsets = fixed.fine.tissue.shape[1], fixed.offsets
    o = n + fixed.fine.plate.shape[1]
    for i in range(found.shape[0]):
        for k in range(offsets.shape[0]):
            own.wanted[k] = flux[i + offsets[k]]
        doubt = own.cover[at.RESISTANCE, at.RESISTANCE]
        current, _ = plan_current(fixed, own, bounds, leaving, press[i], doubt, leaving.hold)
        read, film = math.nan, math.nan
        for who in range(2):  # the plant first: the law takes in its readings; one call site is compiled only once
            some = plant if who == 0 else own
            _track(fixed.fine, some, bounds.size, current, press[i], max(0.0, press[i] - 1.0), read, film, math.nan)
            read, film = plant.x[0, o + at.X_SEEN], plant.x[0, o + at.X_FILM]
        found[i] = plant.x[0, o + at.X_FLUX]
        for k in range(n):  # not as a whole: the check of its shape alone takes over a second to compile
            fingers[i, k] = plant.x[0, k]


class ModelLaw:
    """The `model` controller: all that changes is in a record of State, the object keeps only constants.

    Parameters
    ----------
    display
        What the display's data sheets say.
    tissue, core, skin
        The finger: layers, core and resting skin temperature [K].
    resistance
        Contact resistance [K m2/W] that is expected.
    ambient
        Room temperature [K].
    period
        Seconds between two calls.
    band, ceiling
        Lowest and highest plate temperature [K]; greatest current [A].
    prefix
        Prefix of its fields' names in State.
    longest
        By how many periods a reading may be late; for so long the expected readings are kept.
    wait
        Greatest number of periods for which a command may wait until it leaves, in addition to the display's delay.
    """

    def __init__(
        self, display: DisplayParams, tissue: tuple[Layer, ...], core: float, skin: float, resistance: float,
        ambient: float, period: float, *, band: tuple[float, float], ceiling: float, prefix: str = "",
        longest: int = 0, wait: int = 0,
    ) -> None:  # fmt: skip
        self.longest, self.wait = longest, wait
        self.display, self.period, self.prefix, self.ceiling = display, period, prefix, ceiling
        self.given = tissue, core, skin, resistance, ambient
        self.delay = round(display.delay / period)
        self.coarse_ticks = max(1, round(COARSE / period))
        self.step = period * self.coarse_ticks
        sideways = Sideways(display.area, display.conductance / display.area, display.cover)
        self.fine = column(tissue, core, skin, display.plate, period, REACH / 1e-3, sideways)
        self.coarse = column(tissue, core, skin, display.plate, self.step, REACH / 1e-3, sideways)
        self.hats = planner.shapes(self.step)
        self.steps = self.hats.shape[1]
        self.ahead = self.delay + wait + self.steps * self.coarse_ticks
        self.capacity = plate_capacity(display.plate)
        self.pad = np.array((*display.pad, display.area, display.sensor_area))
        self.band = np.array(band)
        self.constants = _constants(display, self.fine.rest, resistance, ambient, period)
        #: Behind a wire it is uncertain by some milliseconds when a command acts, so the delay is a parameter.  Not on
        #: a rig of one's own: its filters and slow thermistors are no simple lags, and would be taken for a delay.
        of_wire = (PRIOR_ONSET, PRIOR_DELAY) if display.line is None else (PRIOR_ONSET,)
        self.prior = np.array((*PRIOR, *of_wire) if longest > 0 else PRIOR)
        #: Behind a wire readings are so few that the resistance stays uncertain for a whole touch: its estimate is
        #: acted upon at once, or else a weak flux would stay wrong by as much.  Not on a rig of one's own, where the
        #: estimate moves more with each reading.
        self.believes = longest > 0 and display.line is None
        #: The future times at which the plan looks, in periods from the end of the last step.
        self.offsets = self.delay + np.arange(1, self.steps + 1) * self.coarse_ticks - 1
        #: The same for compiled code: what never changes, as arrays and as numbers.
        self.fixed = Fixed(
            at.Basis(self.constants, self.fine.tissue, self.fine.plate),
            at.Basis(self.constants, self.coarse.tissue, self.coarse.plate),
            self.hats, self.band, self.offsets, self.pad, self.prior,
        )  # fmt: skip
        self.bounds = Bounds(
            self.coarse_ticks, float(display.flux_limit), float(ceiling), float(self.capacity)
        )  # fmt: skip

    def coarser(self) -> ModelLaw:
        """Return the same law with the coarse step as its period, and with readings that are means over it."""
        band = float(self.band[0]), float(self.band[1])
        calmer = 1.0 / math.sqrt(self.coarse_ticks)
        noise, film_noise = self.display.flux_noise * calmer, self.display.plate_noise * calmer
        display = replace(self.display, flux_noise=noise, plate_noise=film_noise)
        return ModelLaw(display, *self.given, self.step, band=band, ceiling=self.ceiling)

    def fields(self) -> tuple[Field, ...]:
        """Return the fields of its State."""
        n, m = self.fine.tissue.shape[1], self.fine.plate.shape[1]
        wide, count = n + m + at.X_TAIL, len(self.prior)
        size: dict[str, int | tuple[int, ...]] = {
            "x": (1 + count, wide), "theta": count, "cover": (count, count), "gain": count,
            "memory": at.M_TAIL + (count > at.DELAY or self.display.slew > 0.0), "line": max(1, self.delay), "slots": 2,
            "single": self.coarse_ticks, "queue": 1 + (self.delay + self.wait) // self.coarse_ticks,
            "wanted": self.steps, "response": (planner.HATS, self.steps), "knots": planner.HATS,
            "work": wide + planner.HATS * (planner.HATS + 1), "future": self.ahead + 1,
            "trace": round(RATE_OVER / self.step), "span": (2, self.steps),
            "past": (1 + self.longest, late_readings.width(count)), "kept": late_readings.KEPT,
        }  # fmt: skip
        low = {"slots": (0.0, float(self.delay)), "kept": (0.0, 0.0, 0.0)}
        high = {
            "slots": (max(0.0, self.delay - 1.0), float(self.delay)),
            "kept": (float(self.longest), 1.0 + self.longest, 1.0),
        }
        return tuple(
            Field(self.prefix + name, "f8", size[name], low.get(name, -math.inf), high.get(name, math.inf), unit=unit,
                  doc=doc)
            for name, (unit, doc) in _MEANINGS.items()
        )  # fmt: skip

    def reset(self, state: Record) -> None:
        """Begin with a plate uniformly at the room's temperature, and with the data sheets' values."""
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
        self.feel(state, None)
        state[p + "slots"][1] = self.delay

    def feel(self, state: Record, force: float | None) -> None:
        """Set how much of the sensor the finger covers, by the force [N] with which it presses (None: not at all)."""
        state[self.prefix + "memory"][at.M_PART] = 1.0 if force is None else at.seen(self.pad, force)

    def track(
        self, state: Record, sent: float, flux: float, film: float, sink: float, scale: float = 1.0, press: float = -1.0
    ) -> None:
        """Take in the current [A] sent a tick ago and the newest readings, of flux [W/m2], film and sink [K].

        ``scale`` is the resistance that the force explains, as a multiple of the expected one, and ``press`` how
        strongly the finger is being pressed on (below 0: by as much as the scale exceeds 1, as in a press of 50 ms).
        """
        pressing = press if press >= 0.0 else max(0.0, scale - 1.0)
        _track(self.fixed.fine, self.memory(state), self.coarse_ticks, sent, scale, pressing, flux, film, sink)

    def pass_by(
        self, state: Record, count: int, before: float, after: float, change: int, scale: float = 1.0,
        press: float = -1.0,
    ) -> None:  # fmt: skip
        """Let ``count`` periods pass without readings, in which the current [A] that leaves changed once.

        Until period ``change``, counted from 0, ``before`` left, from it on ``after``; negative: from so many periods
        ago on.
        """
        pressing = press if press >= 0.0 else max(0.0, scale - 1.0)
        own = self.memory(state)
        _pass(self.fixed.fine, own, self.coarse_ticks, count, before, after, change, scale, pressing)

    def recall(
        self, state: Record, flux: float, flux_back: int, film: float, film_back: int, sink: float, since: float,
        press: float = 0.0,
    ) -> None:  # fmt: skip
        """Take in late readings of flux [W/m2], film and sink [K].

        Flux and film were measured ``flux_back`` and ``film_back`` periods ago; ``since`` is the time [s] since the
        readings before, ``press`` as in `track`.
        """
        own = self.memory(state)
        late_readings.recall(self.fixed.fine, own, press, flux_back, flux, film_back, film, sink, since)

    def estimate(self, state: Record) -> tuple[float, float]:
        """Return the estimated contact flux [W/m2], and its standard deviation."""
        column = self.fine.tissue.shape[1] + self.fine.plate.shape[1]
        found: tuple[float, float] = late_readings.estimate(
            state[self.prefix + "x"], state[self.prefix + "cover"], column
        )
        return found

    def approach(self, state: Record, target: float, coming: FutureCurrent = AT_ONCE) -> tuple[float, float, float]:
        """Return current [A] and flux [W/m2] that bring the plate to ``target`` [K], and its error [K] as they act."""
        within = max(DEADBEAT, 1.5 * coming.hold * self.period)
        found: tuple[float, float, float] = approach_current(
            self.fixed.fine, self.memory(state), self.bounds, coming, target, within
        )
        return found

    def place(self, state: Record, finger: Array) -> None:
        """Set the finger that is about to touch, by its coordinates (modes,) [K] in the modes of ``fine``."""
        state[self.prefix + "x"][0, : len(finger)] = finger

    def begin(self, state: Record, flux: float, scale: float = 1.0, onset: float = PRIOR_ONSET) -> None:
        """Set the finger on the plate; ``flux`` [W/m2] is the last one pumped, ``scale`` as in `track`.

        ``onset`` is the standard deviation [s] of the time at which it came; it is used only behind a wire.
        """
        _begin(self.fixed, self.memory(state), flux, scale, onset)

    def follow(
        self, state: Record, scale: float = 1.0, every: int = 1, coming: FutureCurrent = AT_ONCE
    ) -> tuple[float, float]:
        """Return current [A] and flux [W/m2] that make the contact flux follow the field ``wanted``.

        It is called once in ``every`` periods; ``scale`` as in `track`.
        """
        own = self.memory(state, coming.wait)
        doubt = 0.0 if self.believes else own.cover[at.RESISTANCE, at.RESISTANCE].item()
        found: tuple[float, float] = plan_current(self.fixed, own, self.bounds, coming, scale, doubt, every)
        return found

    def memory(self, state: Record, wait: int = 0) -> Memory:
        """Return views of its State; currents on their way, for a command that leaves in ``wait`` periods.

        These are cut to their number: single ones, and means of coarse steps.
        """
        ahead, fields = self.delay + wait, {name: state[self.prefix + name] for name in Memory._fields}
        fields["single"] = fields["single"][: ahead % self.coarse_ticks]
        fields["queue"] = fields["queue"][: ahead // self.coarse_ticks]
        return Memory(**fields)

    def rendered(self, own: Record, plant: Record, flux: Array, press: Array, steps: int) -> tuple[Array, Array]:
        """Render a contact on a plant that is this law's own model, with readings that come at once.

        Only for a law that weighs its doubt about the resistance, that is, whose ``believes`` is false.

        Parameters
        ----------
        own, plant
            State of the law and of the plant, as their touch begins.
        flux, press
            Desired flux [W/m2] and the resistance as a multiple of the expected one, at the ends of the periods; longer
            than ``steps`` by the horizon of the plan.

        Returns
        -------
        flux, fingers
            Contact flux [W/m2], shape (steps,), and the finger's coordinates [K], shape (steps, modes), at the ends of
            the periods.
        """
        found, fingers = np.empty(steps), np.empty((steps, self.fine.tissue.shape[1]))
        laws = self.memory(own), self.memory(plant)
        _rendered(self.fixed, *laws, self.bounds, AT_ONCE, flux, press, found, fingers)
        return found, fingers


def _of_mean(p: DisplayParams, period: float) -> float:
    """Return by what share of its remaining way to the flux a mean may differ from a sample in its middle.

    The time of the middle is known to a period.  The mean of an exponential decay with the sensor's lag exceeds its
    value in the middle by the share (window / lag)**2 / 24.
    """
    if p.flux_samples == 1:
        return 0.0
    lag, window = max(p.flux_lag, period), p.flux_samples / SAMPLING
    return period / lag + (window / lag) ** 2 / 24.0


def _constants(p: DisplayParams, rest: float, resistance: float, ambient: float, period: float) -> Array:
    c = np.zeros(at.O_CONSTANTS)
    c[at.O_PERIOD], c[at.O_REST], c[at.O_REFERENCE], c[at.O_CONTACT] = period, rest, REFERENCE, resistance
    c[at.O_SEEBECK], c[at.O_RESISTANCE], c[at.O_CONDUCTANCE], c[at.O_AREA] = (
        p.seebeck, p.resistance, p.conductance, p.area,
    )  # fmt: skip
    c[at.O_FLUX_LAG], c[at.O_PLATE_LAG] = max(p.flux_lag, 1e-6), max(p.plate_lag, 1e-6)
    c[at.O_FLUX_NOISE] = math.hypot(p.flux_noise / math.sqrt(p.flux_samples), p.flux_resolution) + 1e-3
    c[at.O_PLATE_NOISE] = math.hypot(p.plate_noise, p.plate_resolution) + 1e-6
    c[at.O_SINK_CAPACITY], c[at.O_SINK_RESISTANCE], c[at.O_SINK_LAG] = p.sink_capacity, p.sink_resistance, p.sink_lag
    c[at.O_AIR], c[at.O_COVER], c[at.O_AMBIENT] = p.film_coefficient, p.cover, ambient
    c[at.O_DRIFT_FLUX], c[at.O_DRIFT_OFFSET] = DRIFT_FLUX**2 * period, DRIFT_OFFSET**2 * period
    c[at.O_CEILING] = 0.98 * p.full_scale
    c[at.O_SLEW] = p.slew
    c[at.O_LAGS] = LAGS if p.line is not None else _of_mean(p, period)
    c.setflags(write=False)
    return c
