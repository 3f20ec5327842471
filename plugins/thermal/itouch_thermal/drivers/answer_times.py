"""Which answers on a wire came promptly: of a late one only the time of its request is sure."""

from __future__ import annotations

import math

#: A device answers within this time [s] beyond the usual one; an answer that took longer may have been given before.
TURNAROUND = 5e-3
#: After so many answers the usual time of a wire is known.
KNOWN = 10


class AnswerTimes:
    """The time that answers on a wire usually take, that of the quickest: no delay becomes usual because it lasts."""

    def __init__(self) -> None:
        self._quickest, self._count = math.inf, 0

    def prompt(self, took: float) -> bool:
        """Tell whether an answer came promptly; ``took`` [s] is what it took besides its and its request's transit."""
        self._quickest, self._count = min(self._quickest, took), self._count + 1
        return took <= TURNAROUND + (max(0.0, self._quickest) if self._count > KNOWN else 0.0)
