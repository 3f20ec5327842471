"""The current that a controller says flows, beside what it was asked for: if they differ for long the session ends."""

from __future__ import annotations

from collections import deque

from itouch.plugin import DeviceError

#: How far the current that flows may be from what was asked for [A], and as a part of it; for how many exchanges.
ASIDE, PART, STRAYED = 0.3, 0.2, 25
#: Among so many of the last orders: a current follows late, and where it is on its way is not known.
ASKED = 8


class FlowingCurrent:
    """Compares, exchange by exchange, the current that flows with what was asked for.

    Parameters
    ----------
    source
        Who gives the current, as a message begins.
    less
        Whether it may be less, for whatever cause: many rigs hold a current back by themselves, or do not measure it.
    """

    def __init__(self, source: str, *, less: bool = False) -> None:
        self._source, self._less, self._strayed = source, less, 0
        self._asked: deque[float] = deque([0.0], maxlen=ASKED)

    def ask(self, current: float) -> None:
        """Take note of an order [A]."""
        self._asked.append(current)

    def follows(self, flowing: float) -> None:
        """Take note of what flows [A].

        Raises
        ------
        DeviceError
            If it has not been what was asked for in a row of exchanges.
        """
        low, high = min(self._asked), max(self._asked)
        room = ASIDE + PART * max(abs(low), abs(high))
        if self._less:
            low, high = min(0.0, low), max(0.0, high)
        self._strayed = 0 if low - room <= flowing <= high + room else self._strayed + 1
        if self._strayed >= STRAYED:
            raise DeviceError(
                f"{self._source} gives {flowing:.2f} A where {self._asked[-1]:.2f} A was asked for: check its "
                "limits of current and voltage, and the wires of the module"
            )
