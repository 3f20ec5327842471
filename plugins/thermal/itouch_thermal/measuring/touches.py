"""Finds the touches in a record of flux, film temperature, force and skin, and which of them are fit for averaging."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from itouch_thermal.display.column import Array

#: Force that counts as a touch [N], and the least time that it must last [s].
TOUCHED, LASTS = 0.05, 0.02
#: Length of the rest before a touch that is evaluated [s], and how long before the touch it ends [s].
BASE, CLEAR = 1.0, 0.02
#: Number of samples from which the rise of the force is estimated.
RISE = 5


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Samples at times [s]: flux [W/m2], film [K], force [N], skin [K]; NaN if not read; shape (n,)."""

    times: Array
    flux: Array
    film: Array
    force: Array
    skin: Array

    @property
    def period(self) -> float:
        """Median time between two samples [s]; there must be two."""
        return float(np.median(np.diff(self.times)))


@dataclass(frozen=True, slots=True, eq=False)
class Touched:
    """One touch from its start on; the flux is less the reading at rest.

    ``times`` [s], ``flux`` [W/m2], ``film`` [K], ``force`` [N]; ``begin`` [s] in the record; ``skin`` and ``rest`` [K]
    are the skin's and the film's temperature before it (NaN: not read), ``offset`` [W/m2] is the film's reading at
    rest, ``slope`` [K/s] the rate of change of its temperature then, ``rested`` [s] the time since the last touch.
    """

    times: Array
    flux: Array
    film: Array
    force: Array
    begin: float
    skin: float
    rest: float
    offset: float
    slope: float
    rested: float = BASE

    @property
    def pressed(self) -> float:
        """Mean force [N] after its rise."""
        return pressed(self.times, self.force)


def pressed(times: Array, force: Array) -> float:
    """Return the mean force [N] of a touch after its rise; times [s] from its start on.

    ``times`` and ``force`` [N] have shape (n,).
    """
    return float(force[times > min(0.2, 0.5 * float(times[-1]))].mean())


def touches(record: Record) -> list[Touched]:
    """Return all touches of a record, also those without a second of rest before them (see ``rested``)."""
    if len(record.times) < 2:
        return []
    found, period = [], record.period
    length = max(1, round(LASTS / period))
    on = record.force > TOUCHED
    i, count, free = 0, len(on), 0
    while i < count - length:
        if not (on[i] and record.force[i : i + length].mean() > TOUCHED):
            i += 1
            continue
        end = i
        while end < count and record.force[end : end + length].mean() > TOUCHED:
            end += 1
        found.append(_one(record, i, end, free))
        i = free = end + length
    return found


def _one(record: Record, first: int, end: int, free: int) -> Touched:
    """Return the touch whose first sample above the threshold is ``first``; nothing has touched since ``free``."""
    at = record.times
    begin = _begin(record, first)
    low, high = np.searchsorted(at, (at[first] - BASE - 1e-9, at[first] - CLEAR - 1e-9))
    rest = slice(max(int(low), free), max(int(high), free))
    rested = float(at[first] - at[free]) if free < first else 0.0
    film = record.film[rest]
    slope = float(np.polyfit(at[rest] - at[first], film, 1)[0]) if len(film) > 2 and np.isfinite(film).all() else 0.0
    offset = _mean(record.flux[rest])
    return Touched(
        np.asarray(at[first:end] - begin), record.flux[first:end] - offset, record.film[first:end],
        record.force[first:end], begin, _mean(record.skin[rest]), _mean(film), offset, slope, rested,
    )  # fmt: skip


def _begin(record: Record, first: int) -> float:
    """Return when a touch began [s]: its force rose from 0 on a straight line through the next samples."""
    if first == 0:
        return float(record.times[0])
    before, force = float(record.force[first - 1]), record.force[first : first + RISE]
    # Up to 95 % of the rise: the slope of a steady force would only be noise.
    top = int(np.argmax(force >= before + 0.95 * (force.max() - before)))
    rise = max((float(force[top]) - before) / (top + 1), 1e-9)
    return float(record.times[first]) - min(float(RISE), float(force[0]) / rise) * record.period


def _mean(values: Array) -> float:
    """Return the mean of the finite values; NaN if there are none."""
    seen = values[np.isfinite(values)]
    return float(seen.mean()) if len(seen) else float("nan")


@dataclass(frozen=True, slots=True)
class Wanted:
    """Requirements on a touch: force [N] and tolerance, duration [s], film drift [K/s], skin [K], full scale [W/m2]."""

    force: float
    duration: float
    tolerance: float = 0.15
    drift: float = 0.02
    skin: float = 0.5
    full_scale: float = 20e3

    def why_not_held(self, rested: float, lasted: float, held: float) -> str:
        """Return why a touch with this rest [s], length [s] and mean force [N] is rejected; empty if it is not."""
        if rested < BASE - 1e-6:
            return f"there were {rested:.2f} s of rest before it, not {BASE:g} s"
        if lasted < self.duration:
            return f"it lasted {lasted:.2f} s, not {self.duration:g} s"
        if abs(held - self.force) > self.tolerance * self.force:
            return f"its force was {held:.2f} N, not {self.force:g} N within {100 * self.tolerance:g} %"
        return ""

    def why_not(self, touch: Touched, usual_skin: float) -> str:
        """Return why a touch is rejected; empty if it is not."""
        if why := self.why_not_held(touch.rested, float(touch.times[-1]), touch.pressed):
            return why
        if abs(touch.slope) > self.drift:
            return f"the sample was not at rest: its film changed by {touch.slope:+.3f} K/s before it"
        if abs(touch.skin - usual_skin) > self.skin:
            return f"the skin was {touch.skin - 273.15:.2f} degC, not {usual_skin - 273.15:.2f} as usual"
        if float(np.abs(touch.flux + touch.offset).max()) >= 0.999 * self.full_scale:
            return f"the film read its full scale, {self.full_scale:g} W/m2"
        return ""


def sort_out(found: list[Touched], wanted: Wanted) -> tuple[list[Touched], list[str]]:
    """Return the touches to be averaged, and why each of the others is not."""
    skins = [touch.skin for touch in found if np.isfinite(touch.skin) and touch.rested >= BASE - 1e-6]
    usual = float(np.median(skins)) if skins else float("nan")
    good, bad = [], []
    for k, touch in enumerate(found):
        why = wanted.why_not(touch, usual)
        if why:
            bad.append(f"touch {k + 1}: {why}")
        else:
            good.append(touch)
    return good, bad
