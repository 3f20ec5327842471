"""The interface between window and session: where State comes from, and where the window's commands go."""

from __future__ import annotations

from typing import Protocol

from itouch.plugin import Record
from itouch.world import Model
from itouch_tools.viewer.overlay import SessionStatus
from itouch_tools.viewer.signals import Curves


class Source(Protocol):
    """What a window needs of a session; none of its methods may block."""

    @property
    def model(self) -> Model:
        """The compiled scene."""

    @property
    def state(self) -> Record:
        """The State to show."""

    @property
    def status(self) -> SessionStatus:
        """What is known besides State; the window writes ``picked`` and ``message`` into it."""

    def advance(self, seconds: float, ring: Curves) -> None:
        """Bring State up to date after ``seconds`` of the host's time, and feed the curves."""

    def pause(self) -> str:
        """Pause, or go on; return a message to show, if any."""

    def hold(self, held: bool) -> None:
        """Report whether the operator holds the dead-man's switch."""

    def beat(self) -> None:
        """Report that the window is responding to keys, between two pictures."""

    def save(self) -> str:
        """Save the session; return a message to show, if any."""

    def rearm(self) -> str:
        """Re-arm after a fault; return a message to show, if any."""

    def steer(self, step: tuple[float, float, float] | None) -> str:
        """Move the finger of a simulated session by a step [m]; None lets the hand follow its script again."""

    def stop(self) -> None:
        """End the session safely."""
