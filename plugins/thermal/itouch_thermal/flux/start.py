"""The start temperature of the plate: the temperature that it must have when the finger arrives.

It is found by trials: the controller renders the first moments of the contact on simulated plants, that of the data
sheets and two hard ones, and the start temperature with the greatest margin to the allowed errors is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from contact_heat.layers import Layer
from itouch.plugin import Record
from itouch_thermal.display.column import F_PORT, Array
from itouch_thermal.flux import observer as at
from itouch_thermal.flux.law import REFERENCE, ModelLaw

#: Length of a trial, times from which flux and later skin temperature count, and time over which the flux error is a
#: mean [s].
TRIED, COUNTED_FROM, LATER, SCORED = 0.4, 0.1, 0.3, 9.9
#: Errors are relative to at least this flux [W/m2].
FLOOR = 200.0
#: Allowed errors on the plant of the data sheets: of the skin temperature [K], at any time and later, and of the flux,
#: relative rms.
SKIN_EVER, SKIN_LATER, NOMINAL = 0.116, 0.0155, 3e-3
#: Flux error [W/m2] that comes from the sensor's noise, and the factor by which the flux falls after the trial's end.
NOISE, FALLS = 0.45, 3.0
#: Allowed errors of the flux on a hard plant, relative rms, and there for effusivities below THIN [W s^1/2 / m2K].
HARD, HARD_THIN, THIN = 5e-3, 14e-3, 300.0
#: Extra cost of a flux error beyond the allowed one, per multiple of that by which it is beyond.
FLUX_FIRST = 10.0
#: How many start temperatures are tried first, how far they reach beyond the faces' temperatures [K], how far around a
#: known one [K], and their distance at the end [K].
FIRST, ASIDE, NEAR, CLOSE = 6, 1.5, 0.5, 0.01
#: How far start temperatures stay from the ends of the band [K].
MARGIN = 0.1

#: Parameters that are unknown before the touch, and the share of the others' standard deviations that the approach
#: leaves.
UNKNOWN, FOUND = frozenset({at.RESISTANCE, at.TISSUE, at.PRESS}), 0.1
#: The plants: that of the data sheets, and the hard ones, with all that slows the plate down and a contact that is 10 %
#: better or worse than expected.
_SLOW = {at.SEEBECK: -0.1, at.LEGS: 0.1, at.OHMIC: 0.1, at.PLATE: 0.1, at.LAG: math.log(0.9)}
PLANTS: tuple[dict[int, float], ...] = (
    {},
    {**_SLOW, at.RESISTANCE: math.log(0.9), at.TISSUE: 0.1},
    {**_SLOW, at.RESISTANCE: math.log(1.1), at.TISSUE: -0.1},
)


def equation_three(material: float, plate: float, tissue: float, object_temperature: float, skin: float) -> float:
    """Return the plate temperature [K] of equation 3 of the paper.

    Parameters
    ----------
    material, plate, tissue
        Effusivities [W s^1/2 / m2K].
    object_temperature, skin
        Temperatures [K] before the touch.
    """
    contact = (material * object_temperature + tissue * skin) / (material + tissue)
    return contact * (plate + tissue) / plate - tissue * skin / plate


def within(band: tuple[float, float], wanted: float) -> float:
    """Return the nearest start temperature [K] that is inside the band by as much as the sensor may be off (MARGIN)."""
    return min(band[1] - MARGIN, max(band[0] + MARGIN, wanted))


def outer_effusivity(layers: Sequence[Layer]) -> float:
    """Return the effusivity of the first layer."""
    return layers[0].effusivity


class Touched(NamedTuple):
    """The contact that is to be rendered, at the ends of a trial's steps, and beyond by the horizon of the plan.

    ``flux`` [W/m2] and ``skin`` [K] of the ideal contact, ``press``: the resistance as a multiple of the expected one,
    and the effusivity of the object [W s^1/2 / m2K].
    """

    flux: Array
    skin: Array
    press: Array
    effusivity: float


class Trial:
    """Simulated contacts of the controller with plants made of its own model, in coarse steps and without noise."""

    def __init__(self, law: ModelLaw) -> None:
        self.law = law.coarser()
        self.own, self.plant = Record.of(self.law.fields()), Record.of(self.law.fields())
        self.steps = round(TRIED / self.law.period)
        #: How many steps of the desired contact a trial needs.
        self.needed = self.steps + self.law.ahead + 1

    def run(self, start: float, finger: Array, touched: Touched, differs: dict[int, float]) -> tuple[Array, Array]:
        """Return flux [W/m2] and the finger's coordinates [K] at the ends of the steps of a contact.

        Parameters
        ----------
        start
            Temperature [K] of the plate.
        finger
            Coordinates of the finger at the start, shape (n,).
        differs
            By how much the plant's parameters differ, by their indices in `observer`.
        """
        law, own, plant = self.law, self.own, self.plant
        n, m = len(finger), law.fine.plate.shape[1]
        for state in (own, plant):
            law.reset(state)
            x = state["x"]
            x[0, n : n + m] = law.fine.flat * (start - REFERENCE)
            x[0, [n + m + at.X_BACK, n + m + at.X_FACE, n + m + at.X_FILM]] = start
            law.place(state, finger)
            law.begin(state, 0.0, float(touched.press[0]))
        x, theta = plant["x"], plant["theta"]
        for which, much in differs.items():
            theta[which] = much
            if which not in UNKNOWN:
                own["theta"][which] = much
        for which in set(range(at.COUNT)) - UNKNOWN:
            own["cover"][which, which] *= FOUND * FOUND
        x[0, n + m + at.X_FLUX] /= math.exp(theta[at.RESISTANCE])
        return law.rendered(own, plant, touched.flux, touched.press, self.steps)

    def cost(self, start: float, finger: Array, touched: Touched, best: float = math.inf) -> float:
        """Return the greatest error as a multiple of what is allowed: up to 1 all is well, more costs extra.

        ``start`` is a temperature [K], ``finger`` (modes,) are coordinates of the tissue [K].  If the cost is above
        ``best`` already on the first plants, the others are not tried.
        """
        steps = self.steps
        times = np.arange(1, steps + 1) * self.law.period
        scale = np.maximum(np.abs(touched.flux[:steps]), FLOOR)
        warmth, pumped, found = 0.0, list[float](), 0.0
        noise = NOISE / max(float(scale[-1]) / FALLS, FLOOR)
        hard = HARD if touched.effusivity >= THIN else HARD_THIN
        for k, differs in enumerate(PLANTS):
            flux, fingers = self.run(start, finger, touched, differs)
            if k == 0:
                fine = self.law.fine
                skin = np.array([fine.rest + fine.tissue[F_PORT] @ row for row in fingers])
                apart = np.abs(skin - touched.skin[:steps])
                warmth = max(float(apart.max()) / SKIN_EVER, float(apart[times >= LATER].max()) / SKIN_LATER)
            error = ((flux - touched.flux[:steps]) / scale)[times >= COUNTED_FROM]
            rms = math.hypot(math.sqrt(float(error @ error) * self.law.period / SCORED), noise)
            pumped.append(rms / (NOMINAL if k == 0 else hard))
            found = max(warmth, *pumped) + FLUX_FIRST * sum(max(0.0, part - 1.0) for part in pumped)
            if found > best:
                break
        return found


def start_temperature(trial: Trial, finger: Array, touched: Touched, near: float | None = None) -> float:
    """Return the start temperature [K] of least cost, that is, with the greatest margin to the allowed errors.

    Parameters
    ----------
    finger
        Coordinates of the finger at the start, shape (n,).
    touched
        The contact to be rendered; arrays of shape (trial.needed,).
    near
        A start temperature [K] near which to look, if one is known.
    """

    def cost(start: float, best: float) -> float:
        return trial.cost(start, finger, touched, best)

    if near is not None:
        return _least(cost, near - NEAR, near + NEAR, 3)
    resistance = trial.law.constants[at.O_CONTACT] * touched.press
    faces = (touched.skin - resistance * touched.flux)[: trial.steps]
    ends = sorted((float(faces[0]), float(faces[-1])))
    return _least(cost, ends[0] - ASIDE, ends[1] + ASIDE, FIRST)


def _least(cost: Callable[[float, float], float], low: float, high: float, first: int) -> float:
    """Return where a cost with few minima is least: first on a coarse grid, then ever closer around the best point."""
    known: dict[float, float] = {}
    for place in np.linspace(low, high, first).tolist():
        known[place] = cost(place, min(known.values(), default=math.inf))
    apart = (high - low) / (first - 1)
    while apart > 2.0 * CLOSE:
        apart *= 0.5
        best = min(known, key=known.__getitem__)
        for place in (best - apart, best + apart):
            known[place] = cost(place, known[best])
    return min(known, key=known.__getitem__)
