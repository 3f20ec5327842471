"""The commands of a replay, compared with the recorded ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch.recording import Recording
from itouch.recording.tracks import Track

if TYPE_CHECKING:
    from itouch.session.engine import Session

#: How many ticks are compared at once.
_BLOCK = 1000


@dataclass(frozen=True, slots=True)
class Mismatch:
    """A command (or status) that differs in a replay."""

    tick: int
    channel: str
    recorded: Any
    replayed: Any

    def __str__(self) -> str:
        recorded, replayed = (np.array2string(np.asarray(v), precision=17) for v in (self.recorded, self.replayed))
        return f"tick {self.tick}, {self.channel}: recorded {recorded}, replayed {replayed}"


class Comparison:
    """Compares what the engine commands in a replay with what is recorded."""

    def __init__(self, recording: Recording, session: Session) -> None:
        self._columns = [
            (f"{track.name}.{column.name}", recording[track.name][column.name], session.state[column.field])
            for track in recording.tracks.values()
            if track.replay
            for column in track.columns
            if _is_outcome(track, column.name) and column.field in session.state
        ]
        self._ticks = recording.ticks
        self._seen: list[list[NDArray[Any]]] = [[] for _ in self._columns]
        self._begin = self.compared = self.mismatches = 0
        self.first: Mismatch | None = None

    def note(self, at: int) -> None:
        """Keep what is commanded in this tick, which is row ``at`` of the recording."""
        if not self._seen or not self._seen[0]:
            self._begin = at
        for (_, _, view), seen in zip(self._columns, self._seen, strict=True):
            seen.append(view.copy())
        if self._seen and len(self._seen[0]) >= _BLOCK:
            self.settle()

    def settle(self) -> None:
        """Compare what has been kept so far."""
        for (name, recorded, _), seen in zip(self._columns, self._seen, strict=True):
            if not seen:
                continue
            ours = np.stack(seen)
            theirs = recorded[self._begin : self._begin + len(ours)].reshape(ours.shape)
            same = (ours == theirs) | ((ours != ours) & (theirs != theirs))
            wrong = ~same.reshape(len(ours), -1).all(axis=1)
            self.compared += len(ours)
            self.mismatches += int(wrong.sum())
            if wrong.any():
                index = int(np.argmax(wrong))
                tick = int(self._ticks[self._begin + index])
                if self.first is None or tick < self.first.tick:
                    self.first = Mismatch(tick, name, theirs[index], ours[index])
            seen.clear()


def _is_outcome(track: Track, name: str) -> bool:
    return track.name != "session" and (name.startswith(("command.", "sent.")) or name in ("status", "trip"))
