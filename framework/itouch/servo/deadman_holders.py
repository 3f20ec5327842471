"""The holders of the dead-man's switch: a memory word for each, believed for `monitors.default_limits.HOLD` at most.

The servo process believes a word for no longer than that from when it first sees it, whatever the word says, so that
nothing written there can hold the switch for ever.  If a holder lets go or falls silent, the session stops, even if
somebody else still holds.
"""

from __future__ import annotations

import os
import secrets
from typing import Final

import numpy as np
from numpy.typing import NDArray

from itouch.platforms import lives
from itouch.servo import control_block as at
from itouch.servo.shared_memory import ServoError, SharedMemory, monotonic
from itouch.world.limits import HOLD

#: How long [ns] a word is believed (W3).
HOLD_NS: Final = round(HOLD * 1e9)
#: A place whose owner has written nothing for this long [ns] may be taken by another.
_IDLE_NS: Final = 10_000_000_000
_PID_SHIFT: Final = 40


class Holder:
    """A possible holder of the switch: it has a word of its own in a session's memory, claimed when it first holds."""

    def __init__(self, segment: SharedMemory) -> None:
        self._segment = segment
        self._token = os.getpid() << _PID_SHIFT | secrets.randbits(_PID_SHIFT)
        self._place = -1

    def say(self, held: bool) -> None:
        """Hold the switch for the time `HOLD` from now, or let it go.

        Raises
        ------
        ServoError
            If too many processes hold the switch of this session.
        """
        words = self._segment.words
        if self._place < 0 or int(words[self._place]) != self._token:
            if not held:
                return
            self._place = self._claim()
        words[self._place + 1] = monotonic() + HOLD_NS if held else 0

    def _claim(self) -> int:
        with self._segment.alone(wait=True):
            words = self._segment.words
            for place in range(at.HOLDERS, at.HOLDERS + 2 * at.MOST_HOLDERS, 2):
                if _is_free(int(words[place]), int(words[place + 1])):
                    words[place + 1] = 0
                    words[place] = self._token
                    return place
        raise ServoError(f"{at.MOST_HOLDERS} others hold the dead-man's switch of session '{self._segment.name}'")

    def release(self) -> None:
        """Let go of the switch, and give the word back."""
        words = self._segment.words
        if self._place >= 0 and int(words[self._place]) == self._token:
            words[self._place + 1] = 0
            words[self._place] = 0
        self._place = -1


def _is_free(owner: int, until: int) -> bool:
    return owner == 0 or until < monotonic() - _IDLE_NS or not lives(owner >> _PID_SHIFT)


class Switch:
    """The servo process's view of all these words."""

    def __init__(self, words: NDArray[np.int64]) -> None:
        self._words = words[at.HELD_UNTIL : at.HOLDERS + 2 * at.MOST_HOLDERS]
        self._places = [0, *range(at.HOLDERS + 1 - at.HELD_UNTIL, len(self._words), 2)]
        self._seen = [int(self._words[place]) for place in self._places]
        self._until = [0] * len(self._places)
        self._before = b""

    def look(self) -> tuple[bool, bool]:
        """Return whether the switch is held now, and whether any holder has let go since the last look."""
        now, told = monotonic(), self._words.tobytes()
        if told != self._before:
            self._before = told
            self._hear(self._words.tolist(), now)
        released = False
        for index, until in enumerate(self._until):
            if until and until <= now:
                self._until[index] = 0
                released = True
        return any(self._until), released

    def _hear(self, words: list[int], now: int) -> None:
        for index, place in enumerate(self._places):
            value = words[place]
            if value != self._seen[index]:
                self._seen[index] = value
                if value > now:
                    self._until[index] = min(value, now + HOLD_NS)
                elif self._until[index]:
                    self._until[index] = now  # let go; ``look`` sees it at once
