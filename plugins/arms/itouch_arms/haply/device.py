"""The Inverse3 as a device: it tracks the finger and pushes it; three translations, rotations locked."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any, ClassVar

from itouch.plugin import Attached, Channel, Device, DeviceError, Emulator, Record, Twin, deadman, pose, schema, wrench
from itouch_arms.errors import NotCalibrated, Refused
from itouch_arms.finger import FingerTwin, force_of, put_pose
from itouch_arms.haply.driver import SERVICE, Inverse3
from itouch_arms.haply.emulator import HaplyEmulator
from itouch_arms.haply.look import look

#: Greatest force [N] that is asked of the arm: ours, below what such arms can give.
FORCE = 5.0


@dataclass(frozen=True, slots=True)
class HaplyParams:
    """What ``<haply:hardware>`` may hold.

    The frame is the arm's own: x right, y away from the operator, z up, the origin at its base.
    """

    service: str = schema.text(default="", doc="HOST:PORT of the Inverse Service; empty: localhost:10001")
    device: str = schema.text(default="any", doc="the arm's number, such as 049D, or any for the only one")
    grip: tuple[float, float, float] = schema.quantity(
        "m", size=3, low=-0.2, high=0.2, default=(0.0, 0.0, 0.0), doc="from the arm's cursor to the fingertip's centre"
    )
    calibration_time: float = schema.quantity(
        "s", low=0.0, high=3600.0, default=60.0, doc="how long the operator has to calibrate the arm"
    )
    deadman: str = schema.choice(
        "none", "a", "b", "c", "button", default="none", doc="button of a VerseGrip that must be held to run"
    )
    resolution: float = schema.quantity(
        "m", low=0.0, high=1e-3, default=1e-5, doc="of the twin: step of the position that the arm gives"
    )


class Haply(Device):
    """A Haply Inverse3 behind its local service (WebSocket), presented with six degrees of freedom."""

    Params = HaplyParams
    reads = (pose(locked=(3, 4, 5)),)
    commands = (wrench(force=FORCE),)
    Twin: ClassVar[type[Twin] | None] = FingerTwin
    Emulator: ClassVar[type[Emulator] | None] = HaplyEmulator
    blocking: ClassVar[bool] = True
    #: The service answers some thousand times a second; asking more often than twice a tick only costs time.
    period: ClassVar[float] = 5e-4
    #: The service takes a connection of another process, which can send zero force.
    second_opener: ClassVar[bool] = True

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels; a switch is there if a button is one."""
        switch = () if params.deadman == "none" else (deadman(),)
        return (*cls.reads, *switch), cls.commands

    @classmethod
    def attached(cls) -> tuple[Attached, ...]:
        """Ask the service of this machine for its arms."""
        return look()

    def __init__(self, params: HaplyParams) -> None:
        super().__init__(params)
        self.driver: Inverse3 | None = None

    def _make(self, calibration_time: float) -> Inverse3:
        p = self.params
        return Inverse3(
            p.service or SERVICE, p.device, button=p.deadman, calibration_time=calibration_time,
            patience=self.patience, trace=self.trace,
        )  # fmt: skip

    def open(self) -> None:
        """Connect to the service, take the arm, and wait until it is calibrated.

        Raises
        ------
        DeviceError
            If it is missing, refuses, or is not calibrated in time; the message says what to do.
        """
        driver = self._make(self.params.calibration_time)
        driver.open()
        self.driver = driver

    def close(self) -> None:
        """Send zero force and hang up."""
        driver, self.driver = self.driver, None
        if driver is not None:
            driver.close()

    def read(self, reading: Record) -> bool:
        """Exchange a message; the pose is the fingertip's.

        Raises
        ------
        DeviceError
            If the service does not answer, answers nonsense, or the arm is gone.
        """
        found = self._open().read()
        if found is None:
            return False
        put_pose(reading, found.position, self.params.grip)
        if "deadman" in reading:
            reading["deadman"] = float(found.pressed)
        return True

    def write(self, command: Record) -> None:
        """Set the force, which the next exchange sends; the rotations are locked.

        Raises
        ------
        ValueError
            If a torque is asked for.
        """
        self._open().write(force_of(command))

    def make_safe(self, safe: Record) -> None:
        """Take the force away: opening sends zero force, calibrated or not."""
        driver = self._make(0.0)
        with contextlib.suppress(NotCalibrated, Refused):  # told after the zero was sent
            driver.open()
        driver.close()

    def _open(self) -> Inverse3:
        if self.driver is None:
            raise DeviceError("the arm is not open")
        return self.driver
