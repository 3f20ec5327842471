"""Compares the current that a controller reports with the one commanded: a lasting difference ends the session."""

from __future__ import annotations

from collections import deque

from itouch.plugin import DeviceError

#: Allowed difference [A] from the commanded current, and as a share of it; number of exchanges before it counts.
ASIDE, PART, STRAYED = 0.3, 0.2, 25
#: Number of the latest commands that are compared: the current follows late, and may be at any point on its way.
ASKED = 8


class FlowingCurrent:
    """Compares the flowing current with the commanded one, exchange by exchange.

    Parameters
    ----------
    source
        The source of the current, as messages name it.
    less
        Whether the current may be smaller for any reason: many rigs reduce a current by themselves, or do not measure
        it.
    """

    def __init__(self, source: str, *, less: bool = False) -> None:
        self._source, self._less, self._strayed = source, less, 0
        self._asked: deque[float] = deque([0.0], maxlen=ASKED)

    def ask(self, current: float) -> None:
        """Record a commanded current [A]."""
        self._asked.append(current)

    def follows(self, flowing: float) -> None:
        """Check the flowing current [A].

        Raises
        ------
        DeviceError
            If it has differed from the commanded currents in too many exchanges in a row.
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
