"""A window's source for tests: a session in the window's own process, whose time the script turns."""

from __future__ import annotations

from itouch.loop import DeviceFaultError
from itouch.plugin import Record
from itouch.schema import ItouchError
from itouch.session import Session
from itouch.world import Model
from itouch_tools.viewer.overlay import SessionStatus
from itouch_tools.viewer.signals import Curves


class Local:
    """A session in this process on the virtual clock; the window's frames make it run."""

    def __init__(self, session: Session, *, speed: float = 1.0, save_to: str = "session.itouch") -> None:
        self._session, self._speed, self._save_to = session, speed, save_to
        self._owed = 0.0
        self._held = False
        self.status = SessionStatus(pace="fast")
        self.stopped = False

    @property
    def model(self) -> Model:
        """The compiled scene."""
        return self._session.model

    @property
    def state(self) -> Record:
        """The session's own State, between two ticks."""
        return self._session.state

    def advance(self, seconds: float, ring: Curves) -> None:
        """Run as many ticks as the time asks for; a machine that is too slow runs slower, and drops the rest."""
        if self.status.paused or self.stopped or self._session.fault is not None:
            return
        self._owed += min(seconds, 0.1) * self._speed
        count = int(self._owed / self.model.period)
        self._owed -= count * self.model.period
        try:
            while count > 0 and not self.stopped:
                part = min(count, max(1, round(0.04 / self.model.period)))  # the switch is held for 80 ms a word
                if self._held:
                    self._session.hold(True)
                self._session.run(part * self.model.period, each=lambda: ring.add(self.state), every=5)
                count -= part
        except DeviceFaultError:
            self.status.faults = self._session.statistics.faults
        self.status.tick_us = self._session.times.summary()["p99"]

    def pause(self) -> str:
        """Pause, or go on."""
        self.status.paused = not self.status.paused
        return ""

    def hold(self, held: bool) -> None:
        """Say whether the operator holds the run key."""
        self._held = held
        self._session.hold(held)

    def beat(self) -> None:
        """Do nothing: the session rests when the window does."""

    def save(self) -> str:
        """Save a snapshot."""
        try:
            self._session.save(self._save_to)
        except ItouchError as error:
            return str(error)
        return f"saved {self._save_to}"

    def rearm(self) -> str:
        """Re-arm after a fault."""
        try:
            self._session.rearm()
        except ItouchError as error:
            return str(error)
        self.status.faults = []
        return "re-armed"

    def steer(self, step: tuple[float, float, float] | None) -> str:
        """Move the finger's target by a step [m], or give it back to its script."""
        try:
            self._session.steer(self.model.probes[0].name, step)
        except (ItouchError, IndexError) as error:
            return str(error)
        return ""

    def stop(self) -> None:
        """Make every device safe."""
        self.stopped = True
        self._session.close()
