"""The clairvoyant bound: the best start temperature and pumped flux for a contact known from start to end."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from contact_heat.blas import one_thread
from itouch_thermal.display.column import F_BEGIN, F_DECAY, F_END, F_PORT, P_END, P_PORT, REACH, Array, column
from itouch_thermal.display.params import DisplayParams, Mismatch
from itouch_thermal.display.sideways import Sideways
from itouch_thermal.flux import planner
from itouch_thermal.flux.law import REFERENCE
from itouch_thermal.flux.limits import BAND, RATE, RATE_OVER
from itouch_thermal.flux.preview import rising
from itouch_thermal.heat import FINGER
from itouch_thermal.rendering.closedloop import (
    CORE,
    PERIOD,
    Case,
    Course,
    press_factor,
)
from itouch_thermal.rendering.score import FLOOR, index

#: Time step of the optimisation [s], and number of knots of the pumped flux.
STEP, KNOTS = 5e-3, 60
#: A temperature band that costs even a clairvoyant controller more than this rms error [%] limits the rendering.
LIMITED = 0.3


@dataclass(frozen=True, slots=True)
class Bound:
    """The least rms error [%], and what limits the rendering: an end of the plate's band, its rate, or None."""

    rms_pct: float
    limited: str | None


def bound(case: Case, course: Course, display: DisplayParams, plants: Iterable[Mismatch] = ()) -> Bound:
    """Return the best that the nominal plant can achieve, and which of the plate's limits hinders it or ``plants``.

    Bounded least squares in the plate's start temperature and the knots of the pumped flux, which may start with the
    contact.  The face's temperature follows from the desired flux: where the band does not allow it, the flux is the
    greatest that the band permits.  Needs SciPy.
    """
    ends = [_within_band(case, course, display, *off) for off in _contacts(plants)]
    worst, limited = max(ends)
    if worst <= LIMITED:
        limited = "plate rate" if _fastest(case, course, _contacts(plants)) > RATE else ""
    return Bound(max(_pumped(case, course, display), ends[0][0]), limited or None)


def _fastest(case: Case, course: Course, contacts: Iterable[tuple[float, float]]) -> float:
    """Return the greatest rate [K/s] that the face would need from 0.1 s on, as a mean over half a second."""
    count, over = round(case.seconds / PERIOD), round(RATE_OVER / PERIOD)
    press = np.array([press_factor((i + 1) * PERIOD, case.press) for i in range(count)])
    rates = [0.0]
    for resistance_off, _ in contacts:
        face = course.skin[:count] - case.resistance * (1.0 + resistance_off) * press * course.flux[:count]
        late = face[index(0.1) :]
        rates.append(float(np.abs(late[over:] - late[:-over]).max(initial=0.0)) / RATE_OVER)
    return max(rates)


def _contacts(plants: Iterable[Mismatch]) -> list[tuple[float, float]]:
    """Return the relative differences of contact resistance and finger; the nominal contact first."""
    return list(dict.fromkeys([(0.0, 0.0), *((p.contact_resistance, p.finger_effusivity) for p in plants)]))


def _within_band(
    case: Case, course: Course, display: DisplayParams, resistance_off: float, finger_off: float
) -> tuple[float, str]:
    """Return the rms error [%] of a contact that is exact within the face's band, and the end that is in the way."""
    parts = column(FINGER, CORE, case.skin, display.plate, PERIOD, REACH / 1e-3)
    rows, gain = parts.tissue, 1.0 / (1.0 + finger_off)
    own = gain * float(rows[F_PORT] @ rows[F_END])
    modes, flux = rising(parts, case.skin).copy(), 0.0
    count = round(case.seconds / PERIOD)
    found, stopped = np.empty(count), [0, 0]
    for i in range(count):
        modes = rows[F_DECAY] * modes - gain * rows[F_BEGIN] * flux
        skin = parts.rest + float(rows[F_PORT] @ modes)
        contact = case.resistance * (1.0 + resistance_off) * press_factor((i + 1) * PERIOD, case.press) + own
        wanted = float(course.flux[i])
        flux = min((skin - BAND[0]) / contact, max((skin - BAND[1]) / contact, wanted))
        stopped[0] += flux < wanted
        stopped[1] += flux > wanted
        modes -= gain * rows[F_END] * flux
        found[i] = flux
    desired = course.flux[:count]
    error = ((found - desired) / np.maximum(np.abs(desired), FLOOR))[index(0.1) :]
    which = "lowest" if stopped[0] >= stopped[1] else "highest"
    return 100.0 * float(np.sqrt(np.mean(error**2))), f"{which} plate temperature"


def _pumped(case: Case, course: Course, display: DisplayParams) -> float:
    """Return the least rms error [%] over start temperature and pumped flux."""
    try:
        from scipy.optimize import lsq_linear
    except ImportError as missing:
        raise ValueError("the bound needs scipy: pip install 'itouch-py[bench]'") from missing
    sideways = Sideways(display.area, display.conductance / display.area, display.cover)
    parts = column(FINGER, CORE, case.skin, display.plate, STEP, REACH / 1e-3, sideways)
    every = slice(round(STEP / PERIOD) - 1, None, round(STEP / PERIOD))
    count = round(case.seconds / STEP)
    wanted = course.flux[every][:count]
    times = np.arange(1, count + 1) * STEP
    scored = times >= 0.1
    resistance = np.array([case.resistance * press_factor(float(t), case.press) for t in times])
    places = np.concatenate(([0.0], np.geomspace(STEP, case.seconds, KNOTS - 1)))
    hats = [np.interp(times - 0.5 * STEP, places, unit) * display.flux_limit for unit in np.eye(KNOTS)]
    cold, still = np.zeros(parts.plate.shape[1]), np.zeros(parts.tissue.shape[1])
    drive = _Drive(parts.tissue, parts.plate, resistance)
    free = drive.run(rising(parts, case.skin), cold, np.zeros(count), parts.rest - REFERENCE)
    columns = [drive.run(still, np.array(parts.flat), np.zeros(count), 0.0)]
    columns += [drive.run(still, cold, hat, 0.0) for hat in hats]
    scale = 1.0 / np.maximum(np.abs(wanted), FLOOR)
    rows = np.stack(columns, axis=-1) * scale[:, None]
    low = np.concatenate(([BAND[0] - REFERENCE], np.full(KNOTS, -1.0)))
    high = np.concatenate(([BAND[1] - REFERENCE], np.full(KNOTS, 1.0)))
    with one_thread():
        found = lsq_linear(rows[scored], ((wanted - free) * scale)[scored], (low, high), method="bvls", max_iter=200)
    left = (rows @ found.x - (wanted - free) * scale)[scored]
    return 100.0 * float(np.sqrt(np.mean(left**2)))


class _Drive:
    """Steps the column under a given pumped flux and history of resistances."""

    def __init__(self, tissue: Array, plate: Array, resistance: Array) -> None:
        self.tissue, self.plate, self.resistance = tissue, plate, resistance
        self.selves = float(tissue[F_PORT] @ tissue[F_END]), float(plate[P_PORT] @ plate[P_END])

    def run(self, finger: Array, plate: Array, pump: Array, rest: float) -> Array:
        """Return the contact flux at the end of each step."""
        above, below = finger.copy(), plate.copy()
        gap = rest + float(self.tissue[F_PORT] @ above) - float(self.plate[P_PORT] @ below)
        flux = gap / float(self.resistance[0])
        found = np.empty(len(pump))
        for i in range(len(pump)):
            joint = planner.Joint(float(self.resistance[i]), 1.0, 1.0, *self.selves, rest)
            flux = planner.ahead(self.tissue, self.plate, above, below, flux, float(pump[i]), 0.0, joint)
            found[i] = flux
        return found
