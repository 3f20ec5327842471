"""The start temperature of the plate: what it must have when the finger arrives.

It is found by trying: the controller renders the first moments on plants of its own making, the one of the data
sheets and two that are hard, and the start temperature is taken with which most is left of what may go wrong.
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

#: Seconds that are tried, seconds from which flux and late skin count, and over which the flux error is a mean.
TRIED, COUNTED_FROM, LATER, SCORED = 0.4, 0.1, 0.3, 9.9
#: Errors are relative to at least this flux [W/m2].
FLOOR = 200.0
#: What the skin may be off on the plant of the data sheets [K], ever and later, and the flux there, relative rms.
SKIN_EVER, SKIN_LATER, NOMINAL = 0.116, 0.0155, 3e-3
#: What the sensor's noise leaves of the flux error [W/m2], and by how much the flux falls from the trial's end on.
NOISE, FALLS = 0.45, 3.0
#: What the flux may be off on a hard plant, and on it for materials below THIN [W s^1/2 / m2K], relative rms.
HARD, HARD_THIN, THIN = 5e-3, 13e-3, 300.0
#: How much worse than the skin's it is to miss the flux.
FLUX_FIRST = 10.0
#: Start temperatures tried at first, how far aside they begin [K], also near a known one, and how close they end.
FIRST, ASIDE, NEAR, CLOSE = 6, 1.5, 0.5, 0.01
#: How far start temperatures stay from the ends of the band [K].
MARGIN = 0.1

#: What is not known before the touch, and the part of the doubt about the rest that the way to the start leaves.
UNKNOWN, FOUND = frozenset({at.RESISTANCE, at.TISSUE, at.PRESS}), 0.1
#: The hard plants: all that slows the plate down, and a contact that is 10 % better or worse than expected.
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
    """Return the nearest start temperature [K] that stays inside the band by what the sensor may be off."""
    return min(band[1] - MARGIN, max(band[0] + MARGIN, wanted))


def outer_effusivity(layers: Sequence[Layer]) -> float:
    """Return the effusivity of the first layer."""
    return layers[0].effusivity


class Touched(NamedTuple):
    """The contact that is to be rendered, at the ends of a trial's steps; longer than it by what is planned ahead.

    ``flux`` [W/m2] and ``skin`` [K] of the ideal contact, by how much the resistance is still higher (``press``), and
    the effusivity of the object.
    """

    flux: Array
    skin: Array
    press: Array
    effusivity: float


class Trial:
    """Contacts of the controller with plants of its own making, at coarse steps and without noise."""

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
            By how much the plant's parameters differ, as the observer counts them.
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
        """Return how near the worst of what may be off comes to what is allowed: below 1 all is well.

        ``start`` is a temperature [K], ``finger`` (modes,) are coordinates of the tissue [K].  What is more than
        ``best`` already on the first plants is not tried on the others.
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
    """Return the start temperature [K] with which most is left of what may go wrong.

    Parameters
    ----------
    finger
        Coordinates of the finger at the start, shape (n,).
    touched
        What is to be rendered; shape (trial.needed,) each.
    near
        Where to look [K], if that is known.
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
    """Return where a cost with few valleys is least: some places first, then between the best one's neighbours."""
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
