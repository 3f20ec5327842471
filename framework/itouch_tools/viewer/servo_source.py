"""A servo process as the window's session: read through what it publishes, controlled through commands."""

from __future__ import annotations

from typing import Any

from itouch.loop import Status
from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.safety import Trip
from itouch.servo import Handle, Link, ServoError
from itouch.world import Model
from itouch_tools.viewer.deadman_switch import DeadMansSwitch
from itouch_tools.viewer.fault_messages import told
from itouch_tools.viewer.overlay import SessionStatus
from itouch_tools.viewer.signals import Curves

#: Seconds without a tick after which a session counts as paused, by this window or by another.
STILL = 0.25
#: Time between two samples of the curves [s].
SAMPLE = 0.01


class Attached:
    """Shows a running session.

    Parameters
    ----------
    link
        The link to the servo process.
    handle
        The launcher's handle on it: with it, closing the window ends the session, and faults are shown with their
        cause.
    save_to
        The file that the key S writes.
    """

    def __init__(self, link: Link, *, handle: Handle | None = None, save_to: str = "session.itouch") -> None:
        self._link, self._handle, self._save_to = link, handle, save_to
        self.model = Model.of(link.scene(), Catalog())
        self.state: Record = link.state
        self.status = SessionStatus(pace="real")
        self._refused = 0
        #: The last State that the curves have: they are sampled as the session runs, not as pictures are drawn.
        self._seen, self._every = 0, max(1, round(SAMPLE / self.model.period))
        self._passing = Record(link.dtype)
        self._holding = DeadMansSwitch(link)
        self._still = 0.0

    def advance(self, seconds: float, ring: Curves) -> None:
        """Copy the newest State and how the loop keeps time; say so when the session has ended."""
        before = int(self.state["tick"])
        self._holding.beat()
        for number in self._link.skim(self._seen, self._every, self._passing):
            self._seen = number
            if int(self._passing["tick"]) > before:  # the State that was shown last is in the curves already
                ring.add(self._passing)
            self._holding.beat()  # catching up takes its time on a busy machine
        self._link.refresh(self.state)
        ring.add(self.state)
        self._holding.beat()
        timing, now = self._link.timing, self.status
        now.tick_us, now.late_us, now.overruns = timing.summary()["p99"], timing.lateness()["p99"], timing.overruns
        now.faults = self._faults()
        now.losses = self._losses()
        self._still = 0.0 if int(self.state["tick"]) != before else self._still + seconds
        now.paused = self._still > STILL and self._link.phase == "running" and not now.faults
        now.waiting = self._link.phase == "ready"
        if self._handle is not None and len(self._handle.refused) > self._refused:
            now.message = self._handle.refused[-1]
            self._refused = len(self._handle.refused)
        if not self._link.alive:
            now.message = f"the session is over ({self._link.phase})"

    def _losses(self) -> list[str]:
        """Return what is no longer being kept: in the launcher's words, else only that it is so."""
        if self._handle is not None:
            return [told(loss) for loss in self._handle.losses]
        return [f"{trip.upper()} LOST: the program that launched the session says why" for trip in self._link.losses]

    def _faults(self) -> list[dict[str, Any]]:
        """Return the faults that are present: with the cause if the launcher knows it, else as State says."""
        failed = [name for name in self.model.devices if int(self.state[f"{name}.status"]) == Status.FAULT]
        if not failed:
            return []
        told = [] if self._handle is None else [f for f in self._handle.faults if f["device"] in failed]
        if told:
            return told[-1:]
        return [{"trip": Trip(int(self.state[f"{name}.trip"])).label, "device": name, "cause": "has failed"}
                for name in failed]  # fmt: skip

    def pause(self) -> str:
        """Ask a simulated session to pause, or to go on; return why not, or nothing."""
        if any(not device.twin for device in self.model.devices.values()):
            return "a session with hardware can't pause: Esc stops it"
        return self._ask("resume" if self.status.paused else "pause")

    def hold(self, held: bool) -> None:
        """Hold the dead-man's switch as long as the key is down; if the window hangs, it is let go by itself."""
        self._holding.hold(held)

    def beat(self) -> None:
        """Report that the window is responding, so that the switch may stay held."""
        self._holding.beat()

    def save(self) -> str:
        """Ask for a snapshot."""
        return self._ask("save", self._save_to) or f"saving {self._save_to}"

    def rearm(self) -> str:
        """Ask to re-arm after a fault."""
        if not self.status.faults:
            return "there is nothing to re-arm"
        return self._ask("rearm") or "re-arming"

    def steer(self, step: tuple[float, float, float] | None) -> str:
        """Ask for a step (3,) [m] of the twin's finger; None returns the finger to its script."""
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
        """Let go; end the session if this window is its launcher's."""
        self._holding.close()
        if self._handle is not None:
            self._link.stop()  # the launcher closes its link when everything has ended
        else:
            self._link.close()
