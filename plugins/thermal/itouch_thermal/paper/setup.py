"""The paper's set-up as a preset: the samples, the film, and how the display is driven."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from contact_heat.contact import Contact
from contact_heat.layers import Back, Initial, Side
from itouch_thermal.display.column import Array
from itouch_thermal.display.params import ALUMINA, FILM, DisplayParams
from itouch_thermal.flux.limits import BAND
from itouch_thermal.flux.start import equation_three, within
from itouch_thermal.heat import FINGER, finger_side
from itouch_thermal.rendering.closedloop import AMBIENT, CORE, DEPTH, GAINS, PERIOD, press_factor
from itouch_thermal.rendering.materials import material

#: The paper's materials, from the most to the least conducting.
MATERIALS = ("aluminium", "pyrex", "wood", "polystyrene")
SKIN = 306.15


@dataclass(frozen=True, slots=True)
class Setup:
    """A real touch and its replay: the film [m], the contact [K m2/W, s], and the published loop.

    The paper does not state the resistance: the one here is assumed of it, whatever scenes have by default.
    ``film`` is the thickness of the flux sensor on sample and module, 0 for none; ``press`` the time constant of
    pressing the finger on; ``lag`` and ``noise`` [W/m2] are the sensor's; ``plate_effusivity`` is the beta_p of
    equation 3, which in the paper is that of the module's ceramic.
    """

    film: float = FILM.thickness or 0.0
    resistance: float = 2e-3
    press: float = 0.05
    seconds: float = 10.0
    lag: float = 0.05
    noise: float = 20.0
    plate_effusivity: float = ALUMINA.effusivity
    gains: tuple[float, float] = GAINS

    @property
    def module(self) -> DisplayParams:
        """The display: a film on a ceramic plate on a Peltier module."""
        return DisplayParams(flux_lag=self.lag, flux_noise=self.noise)

    def wanted(self, name: str) -> float:
        """Return the plate's start temperature [K] for a material by equation 3."""
        beta = material(name)[1].effusivity
        return equation_three(beta, self.plate_effusivity, FINGER[0].effusivity, AMBIENT, SKIN)

    def start(self, name: str) -> float:
        """Return the start temperature [K] nearest to it that the plate may have."""
        return within(BAND, self.wanted(name))


class Measured(NamedTuple):
    """A touch of an instrumented sample at the ends of the periods.

    Flux out of the finger, flux at the film's middle, the sensor's reading [W/m2], and the temperature of the sample's
    face [K].
    """

    flux: Array
    film: Array
    reading: Array
    face: Array


def sample(name: str, film: float = 0.0, room: float = AMBIENT) -> Side:
    """Return 20 mm of a material in a room [K], under a film [m] if that is more than 0."""
    between = (replace(FILM, thickness=film),) if film > 0.0 else ()
    return Side(
        layers=(*between, material(name)[1].layer(DEPTH)),
        initial=Initial(kind="uniform", temperature=room),
        back=Back(kind="convection", temperature=room, coefficient=10.0),
    )


def finger(perfusion: float = 1.0, skin: float = SKIN) -> Side:
    """Return the nominal finger with a skin temperature [K] and a factor on its perfusion."""
    layers = tuple(replace(layer, perfusion=layer.perfusion * perfusion) for layer in FINGER)
    return finger_side(layers, CORE, skin, AMBIENT)


def touch(name: str, resistance: float, seconds: float, *, film: float = 0.0, period: float = PERIOD) -> Array:
    """Return the flux [W/m2] out of a finger that touches a sample at t = 0 through a constant resistance."""
    from contact_heat.stepper import Stepper

    stepper = Stepper(Contact(finger=finger(), object=sample(name, film)), period)
    return stepper.advance(resistance, round(seconds / period))


def measure(name: str, setup: Setup, *, films: float = 1.0) -> Measured:
    """Return a touch of a sample under ``films`` films: the paper's section II-B, simulated."""
    from contact_heat import live

    ours, other = finger(), sample(name, films * setup.film)
    above, below = live.side_model(ours, PERIOD, finger=True), live.side_model(other, PERIOD, finger=False)
    skin, body = live.initial_state(ours, PERIOD, finger=True), live.initial_state(other, PERIOD, finger=False)
    count = round(setup.seconds / PERIOD)
    flux, face = np.empty(count), np.empty(count)
    for i in range(count):
        resistance = setup.resistance * press_factor((i + 1) * PERIOD, setup.press)
        flux[i] = live.contact_step(above, skin, below, body, resistance)
        face[i] = live.surface_temperature(below, body)
    # The film is thin: the heat that its upper half stores follows from the temperature of its face.
    kept = 0.5 * films * setup.film * FILM.heat_capacity * np.diff(face, prepend=AMBIENT) / PERIOD
    film = 0.5 * (flux + np.concatenate(([flux[0]], flux[:-1]))) - kept
    return Measured(flux, film, lagged(film, setup.lag), face)


def lagged(flux: Array, lag: float, period: float = PERIOD) -> Array:
    """Return the reading of a sensor with a time constant [s].

    ``flux`` and the reading have shape (steps,) [W/m2]; ``period`` is in [s].
    """
    if lag <= 0.0:
        return flux.copy()
    keep, found, value = math.exp(-period / lag), np.empty_like(flux), 0.0
    for i, now in enumerate(flux.tolist()):
        value = keep * value + (1.0 - keep) * now
        found[i] = value
    return found


def halfspaces(times: Array, resistance: float, ours: float, other: float) -> Array:
    """Return the flux [W/m2] between two half-spaces with these effusivities; for resistance 0, that of equation 2.

    ``times`` (n,) [s], ``resistance`` [K m2/W], effusivities [W s^0.5/m2K].
    """
    from contact_heat.splitting import first_flux, first_problem

    return first_flux(first_problem(ours, other, SKIN, AMBIENT, resistance), np.asarray(times))[0]
