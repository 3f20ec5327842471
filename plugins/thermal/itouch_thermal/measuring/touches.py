"""Touches in a record of flux, film temperature, force and skin: where each begins, and which are worth averaging."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from itouch_thermal.display.column import Array

#: Force that is a touch [N], and for how long it must last [s].
TOUCHED, LASTS = 0.05, 0.02
#: Before a touch so much is looked at [s], up to so shortly before it.
BASE, CLEAR = 1.0, 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Samples at even times: flux [W/m2], film [K], force [N], skin [K] (NaN while it is not seen); shape (n,)."""

    period: float
    flux: Array
    film: Array
    force: Array
    skin: Array


@dataclass(frozen=True, slots=True, eq=False)
class Touched:
    """One touch at even times from its begin on; flux without what was read at rest.

    ``times`` [s], ``flux`` [W/m2], ``film`` [K], ``force`` [N]; ``begin`` [s] in the record, ``skin`` and ``rest`` [K]
    are skin and film before it, ``offset`` [W/m2] what the film read at rest.
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

    @property
    def pressed(self) -> float:
        """Mean force [N] once it is up."""
        late = self.force[self.times > min(0.2, 0.5 * float(self.times[-1]))]
        return float(late.mean())


def touches(record: Record) -> list[Touched]:
    """Return the touches of a record that have a second of rest before them."""
    found, period = [], record.period
    length = max(1, round(LASTS / period))
    base, clear = round(BASE / period), round(CLEAR / period)
    on = record.force > TOUCHED
    i, count = 0, len(on)
    while i < count - length:
        if not (on[i] and record.force[i : i + length].mean() > TOUCHED):
            i += 1
            continue
        end = i
        while end < count and record.force[end : end + length].mean() > TOUCHED:
            end += 1
        if i >= base:
            found.append(_one(record, i, end, base, clear))
        i = end + length
    return found


def _one(record: Record, first: int, end: int, base: int, clear: int) -> Touched:
    """Return the touch whose first sample over the threshold is ``first``."""
    period, force = record.period, record.force
    # Between the last sample below and the first above the force is on a straight line that began at 0.
    rise = max(float(force[first : first + 5].max() - force[first - 1]), 1e-9)
    part = min(1.0, max(0.0, float(force[first]) / rise)) if first else 0.0
    begin = (first - part) * period
    rest = slice(first - base, first - clear)
    skin = record.skin[rest]
    offset = float(record.flux[rest].mean())
    film = record.film[rest]
    times: Array = np.arange(first, end, dtype=np.float64) * period - begin
    seen = skin[np.isfinite(skin)]
    lean = np.arange(len(film)) * period
    slope = float(np.polyfit(lean, film, 1)[0]) if len(film) > 2 else 0.0
    return Touched(
        times, record.flux[first:end] - offset, record.film[first:end], force[first:end], begin,
        float(seen.mean()) if len(seen) else float("nan"), float(film.mean()), offset, slope,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a touch must be: force [N] within a part, duration [s], film at rest [K/s], skin [K], flux [W/m2]."""

    force: float
    duration: float
    tolerance: float = 0.15
    drift: float = 0.02
    skin: float = 0.5
    full_scale: float = 20e3

    def why_not(self, touch: Touched, usual_skin: float) -> str:
        """Return why a touch is rejected; empty: it is not."""
        if touch.times[-1] < self.duration:
            return f"it lasted {touch.times[-1]:.2f} s, not {self.duration:g} s"
        held = touch.pressed
        if abs(held - self.force) > self.tolerance * self.force:
            return f"its force was {held:.2f} N, not {self.force:g} N within {100 * self.tolerance:g} %"
        if abs(touch.slope) > self.drift:
            return f"the sample was not at rest: its film changed by {touch.slope:+.3f} K/s before it"
        if abs(touch.skin - usual_skin) > self.skin:
            return f"the skin was {touch.skin - 273.15:.2f} degC, not {usual_skin - 273.15:.2f} as usual"
        if float(np.abs(touch.flux + touch.offset).max()) >= 0.999 * self.full_scale:
            return f"the film read its full scale, {self.full_scale:g} W/m2"
        return ""


def sort_out(found: list[Touched], wanted: Wanted) -> tuple[list[Touched], list[str]]:
    """Return the touches to be averaged, and why each other one is not."""
    skins = [touch.skin for touch in found if np.isfinite(touch.skin)]
    usual = float(np.median(skins)) if skins else float("nan")
    good, bad = [], []
    for k, touch in enumerate(found):
        why = wanted.why_not(touch, usual)
        if why:
            bad.append(f"touch {k + 1}: {why}")
        else:
            good.append(touch)
    return good, bad
