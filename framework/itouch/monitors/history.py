"""What a plate has read lately: temperature and flux with the times at which they were measured, as a ring in State."""

from __future__ import annotations

from collections.abc import Sequence

from itouch.plugin import Field, Record

#: How many readings are kept: more than a second of them, 5 ms apart.
SLOTS = 256
#: Times [s] that differ by less are one.
_SAME = 1e-7
_TIME, _VALUE, _AREA, _FLUX = range(4)


class History:
    """Looks back by time.  A row of the ring: time, temperature, and the integrals of temperature and |flux| so far.

    Parameters
    ----------
    windows
        Times [s] that are looked back; each has a pointer of its own, so that looking back is one step or two.
    """

    def __init__(self, windows: Sequence[float]) -> None:
        self._windows = tuple(windows)

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (
            Field("samples", "i8", low=0, unit="1", doc="readings taken since the device was away"),
            Field(
                "history", "f8", (SLOTS, 4), unit="mixed", doc="time, temperature, and integrals of it and of the flux"
            ),
            Field("flux", unit="W/m^2", doc="the newest magnitude of the flux"),
            Field("tails", "i8", len(self._windows), low=0, unit="1", doc="where each window begins"),
        )

    def forget(self, state: Record) -> None:
        """Begin anew."""
        state["samples"][...] = 0
        state["tails"][:] = 0

    def add(self, state: Record, time: float, value: float, flux: float) -> bool:
        """Take a reading; tell whether it is a new one."""
        count = state["samples"].item()
        ring = state["history"]
        area = mean = 0.0
        if count:
            then, before, area, mean = ring[(count - 1) % SLOTS].tolist()
            passed = time - then
            if passed < _SAME:
                return False
            area += before * passed
            mean += 0.5 * (state["flux"].item() + flux) * passed
        ring[count % SLOTS] = (time, value, area, mean)
        state["flux"][...] = flux
        state["samples"][...] = count + 1
        return True

    @staticmethod
    def newest(state: Record) -> float:
        """Return when the newest reading was measured [s]; 0 before the first one."""
        count = state["samples"].item()
        return float(state["history"][(count - 1) % SLOTS, _TIME]) if count else 0.0

    def _rows(self, state: Record, time: float, window: int) -> tuple[list[float], list[float]] | None:
        """Return the readings before and after a time; None if it is before the first one that is known."""
        count, ring, tails = state["samples"].item(), state["history"], state["tails"]
        tail = max(tails[window].item(), count - SLOTS)
        if tail >= count or ring[tail % SLOTS, _TIME] > time + _SAME:
            return None
        while tail + 1 < count and ring[(tail + 1) % SLOTS, _TIME] <= time + _SAME:
            tail += 1
        tails[window] = tail
        return ring[tail % SLOTS].tolist(), ring[min(tail + 1, count - 1) % SLOTS].tolist()

    def _at(self, state: Record, time: float, window: int, column: int) -> float | None:
        """Return a column at a time, linear between two readings."""
        rows = self._rows(state, time, window)
        if rows is None:
            return None
        first, second = rows
        wide, part = second[_TIME] - first[_TIME], time - first[_TIME]
        if part < _SAME or wide <= 0.0:
            return first[column]
        return first[column] + (second[column] - first[column]) * part / wide

    def before(self, state: Record, window: int) -> float | None:
        """Return the temperature one window ago [K]; None if that is not known."""
        return self._at(state, self.newest(state) - self._windows[window], window, _VALUE)

    def value(self, state: Record, time: float, window: int) -> float:
        """Return the temperature at a time [K], or the oldest one that is known."""
        found = self._at(state, time, window, _VALUE)
        count = state["samples"].item()
        return found if found is not None else float(state["history"][max(0, count - SLOTS) % SLOTS, _VALUE])

    def mean_flux(self, state: Record, window: int, seconds: float) -> float:
        """Return the mean of |flux| over a window [W/m2]; 0 before one has passed."""
        before = self._at(state, self.newest(state) - self._windows[window], window, _FLUX)
        if before is None:
            return 0.0
        return float(state["history"][(state["samples"].item() - 1) % SLOTS, _FLUX] - before) / seconds

    def step(self, state: Record, window: int, double: int, seconds: float) -> float:
        """Return the mean over the last window less that over the one before [K]; 0 before both have passed."""
        newest = self.newest(state)
        older = self._at(state, newest - self._windows[double], double, _AREA)
        middle = self._at(state, newest - self._windows[window], window, _AREA)
        if older is None or middle is None:
            return 0.0
        last = float(state["history"][(state["samples"].item() - 1) % SLOTS, _AREA])
        return ((last - middle) - (middle - older)) / seconds
