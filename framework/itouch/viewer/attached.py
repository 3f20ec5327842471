"""A servo process as the window's session: it reads what is published, and asks by commands."""

from __future__ import annotations

from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.servo import Link, ServoError
from itouch.viewer.overlay import Situation
from itouch.viewer.signals import Ring
from itouch.world import Model


class Attached:
    """Shows a running session; closing the window ends the session only if ``owner`` says so."""

    def __init__(self, link: Link, *, owner: bool = False, save_to: str = "session.itouch") -> None:
        self._link, self._owner, self._save_to = link, owner, save_to
        self.model = Model.of(loads(link.scene_xml.encode(), Catalog(), shown=link.source), Catalog())
        self.state: Record = link.state
        self.situation = Situation(pace="real")
        self._held = False

    def advance(self, seconds: float, ring: Ring) -> None:
        """Copy the newest State; say so when the session has ended or hangs."""
        self._link.refresh(self.state)
        ring.add(self.state)
        if self._held:
            self._link.hold()
        timing = self._link.timing
        figures = timing.summary()
        self.situation.tick_us, self.situation.overruns = figures["p99"], timing.overruns
        if not self._link.alive:
            self.situation.message = f"the session is over ({self._link.phase})"

    def pause(self) -> str:
        """Ask a simulated session to pause, or to go on."""
        self.situation.paused = not self.situation.paused
        return self._ask("pause" if self.situation.paused else "resume")

    def hold(self, held: bool) -> None:
        """Hold the dead-man's switch as long as the key is down; a window that hangs lets go by itself."""
        self._held = held
        self._link.hold(held)

    def save(self) -> str:
        """Ask for a snapshot."""
        return self._ask("save", self._save_to) or f"saving {self._save_to}"

    def rearm(self) -> str:
        """Ask to re-arm after a fault."""
        return self._ask("rearm")

    def steer(self, step: tuple[float, float, float] | None) -> str:
        """Ask for a step of the twin's finger [m]; None gives it back to its script."""
        if not self.model.probes:
            return "the scene has no probe"
        return self._ask("steer", {"probe": self.model.probes[0].name, "step": step})

    def _ask(self, what: str, value: object = None) -> str:
        try:
            self._link.command(what, value)
        except ServoError as error:
            return str(error)
        return ""

    def stop(self) -> None:
        """Let go; end the session if this window owns it."""
        self._link.hold(False)
        if self._owner:
            self._link.stop()  # the launcher closes its link when all is over
        else:
            self._link.close()
