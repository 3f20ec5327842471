"""One contact in closed loop: the display's twin under a controller, with the ideal contact's flux as desired."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from contact_heat.resistance import DEFAULT_RESISTANCE
from itouch.plugin import Field, Record, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch_thermal.display.column import Array, plate_capacity
from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.display.display_twin import DisplayTwin
from itouch_thermal.display.params import DisplayParams, Mismatch
from itouch_thermal.display.peltier import current_for
from itouch_thermal.flux.current_command import FutureCurrent
from itouch_thermal.flux.flux_model import APPROACH
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.flux.limits import BAND, RATE, RATE_OVER
from itouch_thermal.flux.preview import contact_course, rising
from itouch_thermal.flux.proportional import proportional_integral
from itouch_thermal.flux.published import RATE_USED, STOPPING
from itouch_thermal.flux.start import MARGIN, Touched, Trial, equation_three, start_temperature, within
from itouch_thermal.heat import FINGER, ThermalMaterial, finger_side, object_side

#: Loop period [s], temperatures of core and room [K], and depth of the object [m].
PERIOD = 1e-3
CORE, AMBIENT, DEPTH = 310.15, 296.15, 0.02
#: Time that the plate has to reach its start temperature [s].
BEFORE = 3.0
#: Gains of `paper`: the best pair of the grid of ``bench display --grid``.
GAINS = (40.0, 800.0)


@dataclass(frozen=True, slots=True)
class Case:
    """The touch: temperatures [K], resistance [K m2/W], duration [s]; ``press`` is a time constant [s].

    With ``press`` the resistance falls as ``R / (1 - exp(-t / press))``; the plant's press is ``press * press_off``.
    """

    material: ThermalMaterial
    object_temperature: float = AMBIENT
    skin: float = 306.15
    resistance: float = DEFAULT_RESISTANCE
    seconds: float = 10.0
    press: float = 0.0
    press_off: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """The ideal contact: flux [W/m2] and skin [K] at the ends of the periods; it extends beyond the contact."""

    flux: Array
    skin: Array


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """The course of a contact at the ends of the periods.

    True flux [W/m2], skin and plate face [K], flux demanded of the pump, current [A], and the flux sensor's reading.
    """

    flux: Array
    skin: Array
    plate: Array
    pump: Array
    current: Array
    sensed: Array
    start: float
    desired: Array
    ideal_skin: Array


def desired_course(case: Case) -> Course:
    """Return the ideal finger's contact with the bare object, extended by as much as a controller looks ahead."""
    from contact_heat import live

    side = finger_side(FINGER, CORE, case.skin, case.skin)
    body = object_side(case.material, case.object_temperature, DEPTH)
    if body is None:
        raise ValueError("material: missing")
    count = round(case.seconds / PERIOD) + 400
    if case.press == 0.0:
        return Course(*contact_course(side, body, case.resistance, PERIOD, count))
    finger, other = live.side_model(side, PERIOD, finger=True), live.side_model(body, PERIOD, finger=False)
    above, below = live.initial_state(side, PERIOD, finger=True), live.initial_state(body, PERIOD, finger=False)
    flux, skin = np.empty(count), np.empty(count)
    for i in range(count):
        resistance = case.resistance * press_factor((i + 1) * PERIOD, case.press)
        flux[i] = live.contact_step(finger, above, other, below, resistance)
        skin[i] = live.surface_temperature(finger, above)
    return Course(flux, skin)


def press_factor(time: float, press: float) -> float:
    """Return the factor on the resistance while the finger is being pressed on."""
    return 1.0 if press == 0.0 else 1.0 / -math.expm1(-time / press)


def simulate(
    case: Case, course: Course, display: DisplayParams, controller: str, *, believed: DisplayParams | None = None,
    seed: int = 0, hold: int = 1, stream: int = 1, gains: tuple[float, float] = GAINS, start: float | None = None,
) -> Run:  # fmt: skip
    """Run one contact.

    Parameters
    ----------
    case, course
        The touch, and its ideal course.
    display, believed
        The plant, and the controller's model of it; default: the plant without its mismatch.
    controller
        ``hold``, ``paper`` or ``model``; ``free`` brings the plate to its start and then sends no current.
    seed
        Seed of the noise.
    hold, stream
        Number of periods between two commands, and between two readings.
    gains
        Gains of ``paper``.
    start
        Start temperature [K]; default: the controller's own.
    """
    plant = replace(display, contact_resistance=case.resistance, skin_temperature=case.skin, core=CORE)
    twin = DisplayTwin(replace(plant, full_force=1.0 if case.press else 0.0))
    state = Record.of(twin.fields())
    twin.reset(state, np.random.default_rng(seed))
    known = believed or replace(display, mismatch=Mismatch())
    brain = _Controller(case, course, known, controller, gains, start)
    reads, commands = ThermalDisplay.channels(plant)
    reading = Record.of(Field.of(c) for c in reads)
    command = Record.of(Field.of(c) for c in commands)
    touch, bound = TwinInputs(ambient=AMBIENT), BoundTwin(twin)
    before, count = round(BEFORE / PERIOD), round(case.seconds / PERIOD)
    found = np.empty((6, count))
    for k in range(before + count):
        i = k - before
        bound.read(state, reading)
        brain.take(reading, k % stream == 0, i)
        if k % hold == 0 or i == 0:
            command["current"][0] = brain.command(i, hold)
        if i >= 0:
            touch.gap = 0.0
            touch.force = 1.0 / press_factor((i + 1) * PERIOD, case.press * case.press_off)
        bound.step(state, command, touch, PERIOD)
        brain.sent = float(command["current"][0])
        if i >= 0:
            found[:, i] = (
                state["true_flux"].item(), state["true_skin"].item(), state["true_plate"].item(), brain.flux,
                brain.sent, reading["heat_flux"].item(),
            )  # fmt: skip
    flux, skin, plate, pump, current, sensed = found
    return Run(flux, skin, plate, pump, current, sensed, brain.start, course.flux[:count], course.skin[:count])


class _Controller:
    """A controller outside a scene."""

    def __init__(
        self, case: Case, course: Course, display: DisplayParams, controller: str, gains: tuple[float, float],
        start: float | None,
    ) -> None:  # fmt: skip
        self.case, self.course, self.display, self.controller, self.gains = case, course, display, controller, gains
        self.sent = self.flux = 0.0
        self.memory = Record.of([Field("pi.integral", unit="W/m^2", doc="integral part of the flux")])
        self.reading = (0.0, AMBIENT, AMBIENT)
        self.law: ModelLaw | None = None
        self.passed: list[float] = []
        if controller == "model":
            self.law = law = _law(display, case.skin, case.resistance)
            self.state = Record.of(law.fields())
            law.reset(self.state)
            self.finger = rising(law.fine, case.skin)
        self.start = self._own_start() if start is None else start

    def _own_start(self) -> float:
        case = self.case
        if self.law is not None:
            return start_for(case, self.course, self.display)
        wanted = equation_three(
            case.material.effusivity, self.display.plate[-1].effusivity, FINGER[0].effusivity,
            case.object_temperature, case.skin,
        )  # fmt: skip
        return within(BAND, wanted)

    def take(self, reading: Record, new: bool, i: int) -> None:
        """Process a reading, or only the passing of time."""
        if new:
            names = ("heat_flux", "plate_temperature", "sink_temperature")
            self.reading = (reading[names[0]].item(), reading[names[1]].item(), reading[names[2]].item())
        if self.law is not None:
            scale = press_factor((i or 1) * PERIOD, self.case.press) if i >= 0 else 1.0
            self.law.feel(self.state, 1.0 / scale)
            self.law.track(self.state, self.sent, *(self.reading if new else (math.nan,) * 3), scale)

    def command(self, i: int, hold: int) -> float:
        """Return the current [A]."""
        if self.law is not None:
            return self._predictive(self.law, i, hold)
        if self.controller == "free" and i >= 0:
            self.flux = 0.0
            return 0.0
        flux, plate, sink = self.reading
        if i >= 0 and self.controller == "paper":
            if i == 0:
                self.memory["pi.integral"] = self.flux
            error = float(self.course.flux[i]) - flux
            self.flux = proportional_integral(
                self.memory, "pi", error, self.gains, self.display.flux_limit, hold * PERIOD
            )
        else:
            limit, capacity = self.display.flux_limit, plate_capacity(self.display.plate)
            self.flux = min(limit, max(-limit, capacity * (plate - self.start) / APPROACH))
        if i >= 0:
            self.flux = self._bounded(self.flux, flux, plate, hold)
        p = self.display
        wanted = current_for(p.seebeck, p.resistance, p.conductance, self.flux * p.area, plate, sink)
        return float(min(p.max_current, max(-p.max_current, wanted)))

    def _bounded(self, pump: float, flux: float, plate: float, hold: int) -> float:
        """Limit a pumped flux so that the plate neither leaves its band nor exceeds its greatest rate."""
        self.passed.append(plate)
        before = self.passed[max(0, len(self.passed) - round(RATE_OVER / PERIOD / hold))]
        swing = RATE * RATE_OVER * RATE_USED
        low, high = max(BAND[0] + MARGIN, before - swing), min(BAND[1] - MARGIN, before + swing)
        flux *= self.display.cover  # the least pumped flux that holds the plate's temperature
        stiff = plate_capacity(self.display.plate) / max(STOPPING, 2.0 * hold * PERIOD)
        return min(flux + stiff * (plate - low), max(flux + stiff * (plate - high), pump))

    def _predictive(self, law: ModelLaw, i: int, hold: int) -> float:
        if i < 0:
            current, self.flux, _ = law.approach(self.state, self.start, FutureCurrent(hold))
            return current
        if i == 0:
            law.place(self.state, self.finger)
            law.begin(self.state, self.flux, press_factor(PERIOD, self.case.press))
        self.state["wanted"][:] = self.course.flux[i + law.offsets]
        scale = press_factor(max(i, 1) * PERIOD + self.display.delay, self.case.press)
        current, self.flux = law.follow(self.state, scale, hold, FutureCurrent(hold))
        return current


def _start(law: ModelLaw, case: Case, course: Course, finger: Array) -> float:
    trial, every = Trial(law), slice(law.coarse_ticks - 1, None, law.coarse_ticks)
    flux, skin = course.flux[every][: trial.needed], course.skin[every][: trial.needed]
    press = np.array([press_factor((i + 1) * law.step, case.press) for i in range(trial.needed)])
    return start_temperature(trial, finger, Touched(flux, skin, press, case.material.effusivity))


def start_for(case: Case, course: Course, believed: DisplayParams) -> float:
    """Return the start temperature [K] that `model` chooses."""
    law = _law(believed, case.skin, case.resistance)
    return within(BAND, _start(law, case, course, rising(law.fine, case.skin)))


_LAWS: dict[tuple[object, ...], ModelLaw] = {}


def _law(display: DisplayParams, skin: float, resistance: float) -> ModelLaw:
    key = (display, skin, resistance)
    if key not in _LAWS:
        _LAWS[key] = ModelLaw(
            display, FINGER, CORE, skin, resistance, AMBIENT, PERIOD, band=BAND, ceiling=display.max_current
        )
    return _LAWS[key]
