"""The simulations behind figures and claims; each is run once, when first needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from contact_heat.contact import Contact
from itouch.plugin import Field, Record, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch_thermal.display.column import Array
from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.display.display_twin import DisplayTwin
from itouch_thermal.flux.curve import Curve
from itouch_thermal.paper.setup import Measured, Setup, lagged, measure, sample, touch
from itouch_thermal.paper.setup import finger as nominal_finger
from itouch_thermal.rendering.closedloop import AMBIENT, PERIOD, Case, Course, Run, desired_course, simulate
from itouch_thermal.rendering.materials import material

Found = TypeVar("Found")

#: Time between rows of a run of the paper's scheme [s]; its node spacing [m], and on metals, where steps are short; the
#: effusivity above which a material counts as metal.
COARSE, SPACING, SPACING_METAL, METAL = 0.01, 1e-4, 2e-4, 1e4


class Work:
    """All runs in one set-up; ``curves`` are a lab's own, by material."""

    def __init__(self, setup: Setup | None = None, curves: dict[str, Curve] | None = None) -> None:
        self.setup = setup or Setup()
        self.curves = curves or {}
        self._kept: dict[tuple[Any, ...], Any] = {}

    def _once(self, key: tuple[Any, ...], make: Callable[[], Found]) -> Found:
        if key not in self._kept:
            self._kept[key] = make()
        return cast("Found", self._kept[key])

    def real(self, name: str, films: float = 1.0) -> Measured:
        """Return the touch of an instrumented sample."""
        return self._once(("real", name, films), lambda: measure(name, self.setup, films=films))

    def bare(self, name: str, resistance: float, seconds: float = 10.0, period: float = PERIOD) -> Array:
        """Return the flux of a touch of a sample without a film."""
        return self._once(
            ("bare", name, resistance, seconds, period), lambda: touch(name, resistance, seconds, period=period)
        )

    def filmed(self, name: str, resistance: float, films: float = 1.0, seconds: float = 10.0) -> Array:
        """Return the flux of a touch at t = 0 of a sample under ``films`` films."""
        film = films * self.setup.film
        return self._once(
            ("film", name, resistance, film, seconds), lambda: touch(name, resistance, seconds, film=film)
        )

    def published(self, name: str, resistance: float | None = None) -> Run:
        """Return the replay of a recorded touch by equation 3 and the published loop."""
        return self._once(("published", name, resistance), lambda: self._replay(name, "paper", resistance))

    def open(self, name: str) -> Run:
        """Return the touch of a plate that is held at the temperature from equation 3."""
        return self._once(("open", name), lambda: self._replay(name, "hold", None))

    def _replay(self, name: str, controller: str, resistance: float | None) -> Run:
        setup = self.setup if resistance is None else replace(self.setup, resistance=resistance)
        wanted = self.real(name) if resistance is None else measure(name, setup)
        case = Case(
            material(name)[1], resistance=setup.resistance, press=setup.press, seconds=setup.seconds
        )  # fmt: skip
        course = Course(wanted.reading, wanted.face)
        return simulate(
            case, course, setup.module, controller, seed=1, gains=setup.gains, start=setup.start(name)
        )  # fmt: skip

    def free(self, offset: float) -> Run:
        """Return the touch of a plate that starts ``offset`` [K] above the room and is then not driven."""
        return self._once(("free", offset), lambda: self._free(offset))

    def _free(self, offset: float) -> Run:
        setup = self.setup
        case = Case(
            material("aluminium")[1], resistance=setup.resistance, press=setup.press, seconds=setup.seconds
        )  # fmt: skip
        none = np.zeros(round(setup.seconds / PERIOD))
        return simulate(case, Course(none, none), setup.module, "free", seed=1, start=AMBIENT + offset)

    def ours(self, name: str, resistance: float | None = None) -> Run:
        """Return our own rendering of the bare object: no film, no recorded curve."""
        return self._once(("ours", name, resistance), lambda: self._ours(name, resistance))

    def _ours(self, name: str, resistance: float | None) -> Run:
        setup = self.setup
        of = setup.resistance if resistance is None else resistance
        case = Case(material(name)[1], resistance=of, press=setup.press, seconds=setup.seconds)
        return simulate(case, desired_course(case), setup.module, "model", seed=1)

    def step(self, current: float = 1.0, seconds: float = 20.0, *, touched: bool = False) -> Array:
        """Return the reading of the sensor on the module [W/m2] with a current step [A] at 1 s, one value per period.

        With ``touched``, return the true flux out of a resting finger instead, less that without the current.
        """
        return self._once(("step", current, seconds, touched), lambda: _step(self.setup, current, seconds, touched))

    def scheme(self, name: str) -> tuple[Array, Array]:
        """Return times [s] and the sensor's reading [W/m2] by the paper's equations 4 to 10."""
        return self._both(name)[:2]

    def scheme_flux(self, name: str) -> tuple[Array, Array]:
        """Return times [s] and the flux out of the finger [W/m2] by the paper's equations 4 to 10."""
        return self._both(name)[::2]

    def _both(self, name: str) -> tuple[Array, Array, Array]:
        return self._once(("scheme", name), lambda: self._scheme(name))

    def _scheme(self, name: str) -> tuple[Array, Array, Array]:
        from contact_heat.differences import solve_differences

        setup = self.setup
        times: Array = np.arange(1, round(setup.seconds / COARSE) + 1, dtype=np.float64) * COARSE
        contact = Contact(finger=nominal_finger(), object=sample(name, setup.film), resistance=setup.resistance)
        metal = material(name)[1].effusivity > METAL
        found = solve_differences(contact, times, spacing=SPACING_METAL if metal else SPACING)
        flux = found.flux_at("object", 0.5 * setup.film) if setup.film > 0.0 else found.flux
        return times, lagged(flux, setup.lag, COARSE), found.flux


def _step(setup: Setup, current: float, seconds: float, touched: bool) -> Array:
    found = []
    for level in (0.0, current) if touched else (current,):
        params = replace(setup.module, flux_noise=0.0)
        twin = DisplayTwin(params)
        state = Record.of(twin.fields())
        twin.reset(state, np.random.default_rng(0))
        reading = Record.of(Field.of(c) for c in ThermalDisplay.channels(params)[0])
        command = Record.of(Field.of(c) for c in ThermalDisplay.commands)
        touch = (
            TwinInputs(ambient=AMBIENT, force=1.0, gap=0.0)
            if touched
            else TwinInputs(ambient=AMBIENT, force=0.0, gap=1.0)
        )
        flux, bound = np.empty(round((seconds + 1.0) / PERIOD)), BoundTwin(twin)
        for i in range(len(flux)):
            command["current"] = level if i * PERIOD >= 1.0 else 0.0
            bound.step(state, command, touch, PERIOD)
            if touched:
                flux[i] = state["true_flux"].item()
            else:
                bound.read(state, reading)
                flux[i] = reading["heat_flux"].item()
        found.append(flux)
    return np.asarray(found[-1] - found[0] if touched else found[0])
