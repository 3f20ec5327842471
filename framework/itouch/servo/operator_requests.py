"""The commands that a running session obeys between two ticks.

``enable``; ``pause`` and ``resume`` (twins only); ``steer`` with a probe and a step or null; ``rearm``; ``reconnect``
with a device; ``inject`` with a device, a kind and the other arguments of ``Engine.inject``; ``mark`` with a name and
perhaps a payload; ``save`` with a file; ``report``, which is answered to the launcher; and ``DEVICE.CHANNEL`` with a
value, for a channel that nothing in the scene writes.  To stop, and for the dead-man's switch, there are control words.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from itouch.plugin import DeviceError, Role
from itouch.schema import ItouchError
from itouch.servo.launcher_pipe import Outbox
from itouch.servo.shared_memory import ServoError
from itouch.session import Session
from itouch.world import Model

#: How long [s] to re-arm may wait for a device that is being reconnected: nobody is to be surprised when all moves.
PROMPT = 0.5


@dataclass(slots=True)
class OperatorRequests:
    """What the operator has asked of the loop: whether devices may be enabled, and whether it is to pause."""

    enabled: bool = False
    paused: bool = False


class Commands:
    """Obeys commands; one that can't be obeyed changes nothing, and the launcher is told."""

    def __init__(
        self, session: Session, outbox: Outbox, asked: OperatorRequests, report: Callable[[], dict[str, Any]]
    ) -> None:  # fmt: skip
        self._session, self._outbox, self._asked, self._reported = session, outbox, asked, report
        #: The commands that were obeyed, each with the tick before which it took effect.
        self.log: list[dict[str, Any]] = []
        #: The devices that are being closed and opened anew, beside the loop.
        self.reconnecting: list[str] = []
        #: A command to re-arm that waits for them, and until when.
        self._put_off: tuple[dict[str, Any], float] | None = None
        self._verbs: dict[str, Callable[[Any], None]] = {
            "enable": self._enable,
            "pause": self._pause,
            "resume": self._resume,
            "steer": self._steer,
            "rearm": self._rearm,
            "reconnect": self._reconnect,
            "inject": self._inject,
            "report": self._report,
            "mark": self._mark,
            "save": self._save,
        }

    def carry_out(self, message: dict[str, Any]) -> None:
        """Obey the command in a message; to re-arm is put off while a device is being reconnected, but not for long."""
        if message.get("what") == "rearm" and self.reconnecting:
            self._put_off = message, time.monotonic() + PROMPT
            return
        self._obey(message)

    def _obey(self, message: dict[str, Any]) -> None:
        what, value = str(message.get("what")), message.get("value")
        try:
            if "." in what:
                self._write(what, value)
            elif what in self._verbs:
                self._verbs[what](value)
            else:
                known = ", ".join(self._verbs)
                raise ServoError(f"there is no command '{what}'; commands are: {known}, and DEVICE.CHANNEL")
        except (ItouchError, ValueError, TypeError, KeyError) as error:
            self._outbox.tell("refused", {"what": what, "cause": str(error) or type(error).__name__})
            return
        if what != "report":
            self.log.append({"tick": self._session.ticks, "what": what, "value": value})

    def _enable(self, value: Any) -> None:
        self._asked.enabled = True

    def _pause(self, value: Any) -> None:
        devices = self._session.model.devices.values()
        if any(not device.twin for device in devices):
            raise ServoError("a session with hardware can't pause; stop it")
        self._asked.paused = True

    def _resume(self, value: Any) -> None:
        self._asked.paused = False

    def _steer(self, value: Any) -> None:
        step = value["step"]
        if step is not None:
            x, y, z = step
            step = (float(x), float(y), float(z))
        self._session.steer(str(value["probe"]), step)

    def _rearm(self, value: Any) -> None:
        self._session.rearm()

    def _reconnect(self, value: Any) -> None:
        device = str(value)
        self._session.begin_reconnect(device)
        if not self._session.reconnected(device):
            self.reconnecting.append(device)

    def settle(self) -> bool:
        """Take the results of devices that are open by now; why one is not, the launcher is told.

        Then obey what was put off until then; tell whether anything was done.
        """
        before = len(self.reconnecting)
        for device in tuple(self.reconnecting):
            try:
                if not self._session.reconnected(device):
                    continue
            except DeviceError as error:
                self._outbox.tell("refused", {"what": "reconnect", "cause": str(error)})
            self.reconnecting.remove(device)
        put_off = self._put_off
        if put_off is not None and (not self.reconnecting or time.monotonic() > put_off[1]):
            self._put_off = None
            self._obey(put_off[0])
        return len(self.reconnecting) < before

    def _inject(self, value: Any) -> None:
        at, duration, amount = (value.get(key) for key in ("at", "duration", "amount"))
        self._session.inject(
            str(value["device"]), str(value["kind"]), at=at, duration=duration, channel=str(value.get("channel", "")),
            amount=math.nan if amount is None else float(amount), slot=int(value.get("slot", 0)),
        )  # fmt: skip

    def _report(self, value: Any) -> None:
        self._outbox.tell("report", {"report": self._reported()})

    def _mark(self, value: Any) -> None:
        named = {"name": value} if isinstance(value, str) else value
        self._session.mark(str(named["name"]), named.get("payload"))

    def _save(self, value: Any) -> None:
        self._session.save(str(value))

    def _write(self, what: str, value: Any) -> None:
        device, _, channel = what.partition(".")
        session = self._session
        field = f"{device}.command.{channel}"
        if field not in session.state:
            raise ServoError(f"there is no command channel '{what}'")
        if what in _written(session.model):
            raise ServoError(f"'{what}' is written by the scene; each command has one writer")
        numbers = np.asarray(value, np.float64)
        if numbers.shape != session.state[field].shape or not np.isfinite(numbers).all():
            raise ValueError(f"'{what}' takes {session.state[field].size} finite numbers")
        session.state[field] = numbers
        session.note_outside("command")


def _written(model: Model) -> set[str]:
    """Return the command channels that probes and modalities write."""
    written = {command for modality in model.modalities for command in modality.commands}
    for probe in model.scene.probes:
        for name, role in ((probe.force_to, Role.FORCE_ON_OPERATOR), (probe.surface_to, Role.SURFACE_POSE)):
            channel = model.devices[name].command(role) if name in model.devices else None
            written |= {f"{name}.{channel.name}"} if channel is not None else set()
    return written
