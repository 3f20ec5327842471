"""The teleoperator: a session of itouch-py in a process of its own, read through shared memory, sent forces."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.teleoperators.teleoperator import Teleoperator

import itouch
from itouch.plugin import Role
from lerobot_teleoperator_itouch.config_itouch import ItouchTeleopConfig
from lerobot_teleoperator_itouch.feedback import Feedback, Floats

#: How long [s] an arm may take until its first reading.
_BEGIN = 30.0
_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
_FORCE = ("force.x", "force.y", "force.z")
_SCENE = """<itouch version="1.0">
  <materials><material name="far"><contact stiffness="1 N/mm"/></material></materials>
  <world><box name="far" size="10 10 2 mm" pos="0 0 -1001 mm" material="far"/></world>
  <devices><device name="arm" plugin="{plugin}"><limits force="{force} N"/></device></devices>
  <interaction><probe name="hand" radius="1 mm" pose-from="arm"/></interaction>
  <safety force="{force} N"/>
</itouch>
"""


class ItouchTeleop(Teleoperator):  # type: ignore[misc]
    """The pose and buttons of an arm as actions; feedback is a force, which itouch-py limits."""

    config_class = ItouchTeleopConfig
    name = "itouch"

    def __init__(self, config: ItouchTeleopConfig) -> None:
        super().__init__(config)
        self.config = config
        if not 0.0 < config.force <= 50.0:
            raise ValueError(f"force = {config.force}: the greatest force is above 0 and at most 50 N")
        self._handle: itouch.Handle | None = None
        self._feedback: Feedback | None = None
        with tempfile.TemporaryDirectory() as folder:
            self._scene = itouch.load(self._written(folder))
        session = itouch.build(self._scene, twin="all")  # opens no device: only to look at the arm
        devices = session.model.devices.values()
        session.close()
        arms = [device for device in devices if device.command(Role.FORCE_ON_OPERATOR) is not None]
        if len(arms) != 1 or not arms[0].field(Role.TRACKED_POSE):
            raise ValueError(f"the scene has {len(arms)} arms that give forces and are tracked; a teleoperator is one")
        self._pose, arm = arms[0].field(Role.TRACKED_POSE), arms[0]
        self._wrench = f"{arm.name}.{arm.command(Role.FORCE_ON_OPERATOR).name}"
        self._buttons = {f"{arm.name}.{channel.name}": channel.name for channel in arm.reads
                         if channel.role is Role.DEADMAN}  # fmt: skip

    def _written(self, folder: str) -> str:
        """Return the path of the scene: the user's, or one made for the plugin."""
        if self.config.scene:
            return self.config.scene
        path = Path(folder, "arm.xml")
        path.write_text(_SCENE.format(plugin=self.config.plugin, force=self.config.force), encoding="utf-8")
        return str(path)

    @property
    def action_features(self) -> dict[str, type]:
        """What ``get_action`` returns."""
        return dict.fromkeys((*_POSE, *self._buttons.values()), float)

    @property
    def feedback_features(self) -> dict[str, type]:
        """What ``send_feedback`` takes."""
        return dict.fromkeys(_FORCE, float)

    @property
    def is_connected(self) -> bool:
        """Whether the session runs and answers."""
        return self._handle is not None and self._handle.running and self._handle.link.alive

    @property
    def is_calibrated(self) -> bool:
        """Always true: calibrations belong to itouch-py and are stored beside the scene."""
        return True

    def connect(self, calibrate: bool = True) -> None:
        """Start the session in its own process, with the dead-man's switch held while this program answers.

        Raises
        ------
        itouch.ItouchError
            If the arm is missing or refuses.
        """
        if self.is_connected:
            raise _error("DeviceAlreadyConnectedError", f"{self} is connected")
        twin = "all" if self.config.simulated else None
        self._handle = handle = itouch.launch(self._scene, twin=twin, seconds=None, enable=True)
        self._feedback = Feedback(self._send, handle.hold, self.config.force)
        self._feedback.start()
        end = time.monotonic() + _BEGIN
        while handle.link.tick == 0:
            if not self.is_connected or time.monotonic() > end:
                self.disconnect()
                raise ConnectionError(f"{self}: the arm did not begin to read within {_BEGIN:.0f} s")
            time.sleep(0.01)

    def calibrate(self) -> None:
        """Do nothing: `itouch-py calibrate` does this."""

    def configure(self) -> None:
        """Do nothing: the scene holds the whole configuration."""

    def get_action(self) -> dict[str, float]:
        """Return the newest pose [m], in the arm's own frame, and the buttons."""
        state = self._running().link.state
        action = dict(zip(_POSE, np.ravel(state[self._pose]).tolist(), strict=True))
        return action | {name: float(np.ravel(state[field])[0]) for field, name in self._buttons.items()}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Let the operator feel a force [N]; it fades unless it is repeated within 0.1 s.

        Raises
        ------
        ValueError
            If it is not finite numbers; the force is then zero.
        """
        self._running()
        if self._feedback is not None:
            self._feedback.tell(np.array([float(feedback.get(name, 0.0)) for name in _FORCE]))

    def disconnect(self) -> None:
        """Send zero force, and end the session safely."""
        feedback, self._feedback = self._feedback, None
        handle, self._handle = self._handle, None
        if handle is None:
            return
        try:
            if feedback is not None:
                feedback.close()
        finally:
            handle.request_stop()
            handle.close()

    def _running(self) -> itouch.Handle:
        if self._handle is None or not self.is_connected:
            raise _error("DeviceNotConnectedError", f"{self} is not connected")
        return self._handle

    def _send(self, force: Floats) -> None:
        if self._handle is not None:
            self._handle.command(self._wrench, [*force.tolist(), 0.0, 0.0, 0.0])


def _error(name: str, words: str) -> Exception:
    """Return LeRobot's own exception of a name, with a message."""
    from lerobot.utils import errors

    found: Exception = getattr(errors, name)(words)
    return found
