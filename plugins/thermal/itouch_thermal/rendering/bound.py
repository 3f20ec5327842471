"""The clairvoyant bound: the best start temperature and pump for a contact that is known from begin to end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from itouch_thermal.display.column import F_END, F_PORT, P_END, P_PORT, REACH, Array, column
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.flux import observer as at
from itouch_thermal.flux import planner
from itouch_thermal.flux.law import REFERENCE, ModelLaw
from itouch_thermal.flux.preview import rising
from itouch_thermal.heat import FINGER
from itouch_thermal.rendering.closedloop import AMBIENT, BAND, CORE, PERIOD, Case, Course, press_factor
from itouch_thermal.rendering.score import FLOOR

#: Grid of the optimisation [s], knots of the pump, and how far past the band the face may be [K].
STEP, KNOTS, SLACK = 5e-3, 60, 0.02


@dataclass(frozen=True, slots=True)
class Bound:
    """The least rms error [%], the start temperature [K] that reaches it, and what limits it, if anything does."""

    rms_pct: float
    start: float
    limited: str | None


def bound(case: Case, course: Course, display: DisplayParams, spread: float = 0.0) -> Bound:
    """Return the best that the nominal plant can do; needs scipy.

    Bounded least squares in the plate's start temperature and the knots of the pumped flux, which may begin with the
    contact.  The face's temperature is fixed by the flux that is wanted, so its band is checked, not traded;
    ``spread`` is the part by which the plants' contact resistance may be off.
    """
    try:
        from scipy.optimize import lsq_linear
    except ImportError as missing:
        raise ValueError("the bound needs scipy: pip install 'itouch-py[bench]'") from missing
    parts = column(FINGER, CORE, case.skin, display.plate, STEP, REACH / 1e-3)
    every = slice(round(STEP / PERIOD) - 1, None, round(STEP / PERIOD))
    count = round(case.seconds / STEP)
    wanted, skin = course.flux[every][:count], course.skin[every][:count]
    times = np.arange(1, count + 1) * STEP
    scored = times >= 0.1
    resistance = np.array([case.resistance * press_factor(float(t), case.press) for t in times])
    law = ModelLaw(display, FINGER, CORE, case.skin, case.resistance, AMBIENT, PERIOD, band=BAND, ceiling=1.0)
    places = np.concatenate(([0.0], np.geomspace(STEP, case.seconds, KNOTS - 1)))
    hats = [np.interp(times - 0.5 * STEP, places, unit) * display.flux_limit for unit in np.eye(KNOTS)]
    cold, still = np.zeros(parts.plate.shape[1]), np.zeros(parts.tissue.shape[1])
    drive = _Drive(parts.tissue, parts.plate, law.constants, resistance)
    free = drive.run(rising(parts, case.skin), cold, np.zeros(count), parts.rest - REFERENCE)
    columns = [drive.run(still, np.array(parts.flat), np.zeros(count), 0.0)]
    columns += [drive.run(still, cold, hat, 0.0) for hat in hats]
    scale = 1.0 / np.maximum(np.abs(wanted), FLOOR)
    rows = np.stack(columns, axis=-1) * scale[:, None]
    low = np.concatenate(([BAND[0] - REFERENCE], np.full(KNOTS, -1.0)))
    high = np.concatenate(([BAND[1] - REFERENCE], np.full(KNOTS, 1.0)))
    found = lsq_linear(rows[scored], ((wanted - free) * scale)[scored], (low, high), method="bvls", max_iter=200)
    left = (rows @ found.x - (wanted - free) * scale)[scored]
    faces = np.stack([skin - (1.0 + part) * resistance * wanted for part in (-spread, 0.0, spread)])
    return Bound(100.0 * float(np.sqrt(np.mean(left**2))), REFERENCE + float(found.x[0]), _limit(faces[:, scored]))


def _limit(face: Array) -> str | None:
    """Say which end of the band the plate's face would have to pass."""
    if float(face.min()) < BAND[0] - SLACK:
        return "lowest plate temperature"
    return "highest plate temperature" if float(face.max()) > BAND[1] + SLACK else None


class _Drive:
    """Steps the column under a given pump and history of resistances."""

    def __init__(self, tissue: Array, plate: Array, constants: Array, resistance: Array) -> None:
        self.tissue, self.plate, self.constants, self.resistance = tissue, plate, constants, resistance
        self.selves = float(tissue[F_PORT] @ tissue[F_END]), float(plate[P_PORT] @ plate[P_END])
        if constants[at.O_COVER] <= 0.0:
            raise ValueError("contact_area: must be more than 0")

    def run(self, finger: Array, plate: Array, pump: Array, rest: float) -> Array:
        """Return the contact flux at the end of each step."""
        above, below = finger.copy(), plate.copy()
        gap = rest + float(self.tissue[F_PORT] @ above) - float(self.plate[P_PORT] @ below)
        flux = gap / float(self.resistance[0])
        found = np.empty(len(pump))
        for i in range(len(pump)):
            flux = planner.ahead(
                self.constants, self.tissue, self.plate, above, below, flux, float(pump[i]), float(self.resistance[i]),
                1.0, 1.0, *self.selves, rest,
            )  # fmt: skip
            found[i] = flux
        return found
