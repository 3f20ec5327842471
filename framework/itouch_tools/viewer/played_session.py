"""A recording as the window's session: it plays, pauses, goes faster and slower, and can be moved to any tick."""

from __future__ import annotations

import numpy as np

from itouch.plugin import Record
from itouch.world import Model
from itouch_tools.viewer.overlay import SessionStatus
from itouch_tools.viewer.recording_seek import SeekableRecording
from itouch_tools.viewer.signals import Curves
from itouch_tools.viewer.timeline import Timeline, faults_at, timeline

#: Share of the host's time that goes into reading the recording ahead; longest such time [s] in one frame; and the time
#: [s] in a frame while the wanted tick has not been read.
SHARE, MOST, URGENT = 0.4, 0.02, 0.06
#: Slowest and fastest speed, in multiples of real time.
SLOWEST, FASTEST = 1 / 64, 16.0
_REFUSED = "this is a recording"


class Playback:
    """Shows a recording."""

    def __init__(self, reel: SeekableRecording) -> None:
        self._reel = reel
        self.model: Model = reel.model
        self.state: Record = reel.state
        self.line: Timeline = timeline(reel.recording, reel.ticks, self.model.period)
        self.status = SessionStatus(pace="playback", timeline=self.line)
        self.curves: Curves = reel.curves
        self._cursor = float(reel.ticks[0])  # ticks

    def advance(self, seconds: float, ring: Curves) -> None:
        """Play on for ``seconds`` of the host's time; wait where the recording has not been read yet."""
        reel, line = self._reel, self.line
        if line.playing and not line.reading:
            self._cursor += min(seconds, 0.25) * line.speed / self.model.period
            if self._cursor >= reel.ticks[-1]:
                self._cursor, line.playing = float(reel.ticks[-1]), False
        reel.row = max(0, int(np.searchsorted(reel.ticks, np.floor(self._cursor), side="right")) - 1)
        line.reading = not reel.work(URGENT if line.reading else min(MOST, SHARE * max(seconds, 1e-3)))
        line.now = float(self._cursor) * self.model.period
        line.known = reel.known(200)
        faults = reel.recording.faults
        self.status.faults = faults_at(faults, reel.recording.states, int(reel.ticks[reel.row]))

    def pause(self) -> str:
        """Play, or pause; at the end play from the beginning."""
        line = self.line
        if not line.playing and self._cursor >= self._reel.ticks[-1]:
            self._cursor = float(self._reel.ticks[0])
        line.playing = not line.playing
        return ""

    def seek(self, seconds: float) -> None:
        """Show a time of the session [s]; beyond an end of the recording, that end."""
        first, last = float(self._reel.ticks[0]), float(self._reel.ticks[-1])
        self._cursor = min(last, max(first, seconds / self.model.period))

    def step(self, ticks: int) -> None:
        """Pause, and move on by ``ticks`` recorded ticks (back if negative)."""
        self.line.playing = False
        row = int(np.searchsorted(self._reel.ticks, np.floor(self._cursor), side="right")) - 1 + ticks
        self._cursor = float(self._reel.ticks[min(len(self._reel.ticks) - 1, max(0, row))])

    def jump(self, way: int) -> None:
        """Go to the next contact, mark or fault (``way`` > 0) or the one before; without one, to the end or start."""
        half = 0.5 * self.model.period
        if way > 0:
            later = [stop for stop in self.line.stops if stop > self.line.now + half]
            self.seek(later[0] if later else self.line.last)
        else:
            earlier = [stop for stop in self.line.stops if stop < self.line.now - half]
            self.seek(earlier[-1] if earlier else self.line.first)

    def faster(self, factor: float) -> None:
        """Multiply the speed by a factor, from ``SLOWEST`` to ``FASTEST``."""
        self.line.speed = min(FASTEST, max(SLOWEST, self.line.speed * factor))

    def hold(self, held: bool) -> None:
        """Play or pause when Space is pressed: nothing can be held here."""
        if held:
            self.pause()

    def beat(self) -> None:
        """Do nothing: nothing is held."""

    def save(self) -> str:
        """Say that there is nothing to save."""
        return f"{_REFUSED}: there is nothing to save"

    def rearm(self) -> str:
        """Say that there is nothing to re-arm."""
        return f"{_REFUSED}: there is nothing to re-arm"

    def steer(self, step: tuple[float, float, float] | None) -> str:
        """Say that the finger can't be moved."""
        return f"{_REFUSED}: the finger goes its recorded way"

    def stop(self) -> None:
        """Do nothing: nothing runs."""
