"""The arm as a device: it tracks the finger and pushes it; three translations, rotations locked or sensed."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from itouch.plugin import (
    Attached,
    Bound,
    Channel,
    Device,
    DeviceError,
    Emulator,
    Field,
    Fit,
    Record,
    Touch,
    Twin,
    deadman,
    pose,
    schema,
    wrench,
)
from itouch_usb_arm.emulator import ArmEmulator
from itouch_usb_arm.errors import NotHomed
from itouch_usb_arm.falcon import FORCE_SCALE, Falcon
from itouch_usb_arm.fits import FORCE_SCALE_FIT
from itouch_usb_arm.look import look
from itouch_usb_arm.remote import Remote
from itouch_usb_arm.wire import Buttons

#: Greatest force [N] and stiffness [N/m] of a Novint Falcon, as CHAI3D 3.3 states them.
FORCE, STIFFNESS = 8.0, 3000.0
#: Adding and subtracting it rounds a number to an integer, and leaves NaN what it is.
_TO_INTEGER = 1.5 * 2.0**52


@dataclass(frozen=True, slots=True)
class UsbArmParams:
    """What ``<usb-arm:hardware>`` may hold.

    The frame is that of `itouch_usb_arm.kinematics`; ``grip`` is where the fingertip's centre is in the grip's frame.
    """

    serial: str = schema.text(default="any", doc="serial number of the arm, or any")
    firmware: str = schema.text(default="", doc="the arm's firmware file; needed after it was powered on")
    usbip: str = schema.text(default="", doc="HOST:PORT of a USB/IP server that has the arm; empty: the own USB bus")
    grip: tuple[float, float, float] = schema.quantity(
        "m", size=3, low=-0.2, high=0.2, default=(0.0, 0.0, 0.0), doc="from the grip's centre to the fingertip's"
    )
    force_scale: float = schema.quantity(
        "", low=100.0, high=20000.0, default=FORCE_SCALE, doc="motor counts a N m; low is safe, calibrate yours"
    )
    homing_time: float = schema.quantity(
        "s", low=0.1, high=3600.0, default=60.0, doc="how long the operator has to pull the grip out and push it in"
    )
    deadman: str = schema.choice(
        "none", "plus", "forward", "centre", "minus", default="none", doc="button of the grip that must be held to run"
    )
    rotations: str = schema.choice(
        "locked", "sensed", default="locked", doc="whether the arm's end cannot turn, or its turning is sensed"
    )
    resolution: float = schema.quantity(
        "m", low=0.0, high=1e-3, default=3e-5, doc="of the twin: step of the position that the encoders give"
    )


class UsbArmTwin(Twin):
    """The finger hangs on the arm: the twin reads its pose through encoders of finite resolution."""

    def fields(self) -> tuple[Field, ...]:
        """Return the true pose of the end."""
        return (Field("pose", "f8", 7, unit="m", doc="true pose of the end: position, quaternion w x y z"),)

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Begin at the frame's origin until the finger is attached."""
        state["pose"] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

    def bound_step(self, state: Record, command: Record, touch: Touch, period: float) -> Bound | None:
        """Return the step on these views as one compiled call."""
        from itouch.plugin.kernels import copied  # the compiler is loaded when an arm runs, not when it is listed

        return Bound(copied, touch.finger_pose, state["pose"]) if touch.finger_attached else None

    def step(self, state: Record, command: Record, touch: Touch, period: float) -> None:
        """Go with the finger."""
        if touch.finger_attached:
            state["pose"] = touch.finger_pose

    def read(self, state: Record, reading: Record) -> bool | None:
        """Give the pose in steps of the encoders."""
        values: list[float] = state["pose"].tolist()
        step = self.params.resolution
        if step > 0.0:
            x, y, z = values[0:3]
            values[0:3] = (
                (x / step + _TO_INTEGER - _TO_INTEGER) * step,
                (y / step + _TO_INTEGER - _TO_INTEGER) * step,
                (z / step + _TO_INTEGER - _TO_INTEGER) * step,
            )
        if self.params.rotations == "locked":
            values[3:] = (1.0, 0.0, 0.0, 0.0)
        reading["pose"] = values
        if "deadman" in reading:
            reading["deadman"] = 1.0
        return True


class UsbArm(Device):
    """A desktop haptic arm (Novint Falcon) presented with six degrees of freedom."""

    Params = UsbArmParams
    reads = (pose(),)
    commands = (wrench(force=FORCE),)
    Twin = UsbArmTwin
    fits: ClassVar[tuple[Fit, ...]] = (FORCE_SCALE_FIT,)
    Emulator: ClassVar[type[Emulator] | None] = ArmEmulator
    blocking: ClassVar[bool] = True
    moves_on_open: ClassVar[bool] = True
    #: A process that dies lets go of the interface, so that another one can send zero force.
    second_opener: ClassVar[bool] = True
    max_stiffness: ClassVar[float | None] = STIFFNESS
    damping: ClassVar[float | None] = 0.0

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels; what is not sensed is locked, a switch is there if a button is one."""
        locked = (3, 4, 5) if params.rotations == "locked" else ()
        switch = () if params.deadman == "none" else (deadman(),)
        return (pose(locked=locked), *switch), cls.commands

    @classmethod
    def attached(cls) -> tuple[Attached, ...]:
        """Look for arms on the USB bus."""
        return look()

    def __init__(self, params: UsbArmParams) -> None:
        super().__init__(params)
        #: A pyusb backend object; None: the system's, or the USB/IP server that the parameters name.
        self.backend: Any = None
        self._remote: Remote | None = None
        self.driver: Falcon | None = None
        self._switch = None if params.deadman == "none" else Buttons[params.deadman.upper()]

    def open(self) -> None:
        """Open the arm, load its firmware if it must be, and wait until it is homed.

        Raises
        ------
        DeviceError
            If it is missing, refuses, or is not homed in time; the message says what to do.
        """
        if self.params.rotations != "locked":
            raise DeviceError('the arm cannot sense rotations: write rotations="locked"')
        driver = self._make()
        try:
            driver.open()
            if not driver.homed and not driver.read().valid:
                logging.getLogger(__name__).warning("arm: pull its grip fully out, then push it in, to home it")
            driver.home(self.params.homing_time)
        except BaseException:
            driver.close()
            self._hang_up()
            raise
        self.driver = driver

    def _make(self) -> Falcon:
        p, backend = self.params, self.backend
        if backend is None and p.usbip:
            self._remote = Remote(p.usbip)
            backend = self._remote.backend
        return Falcon(
            p.firmware or None, backend, serial=p.serial, force_scale=p.force_scale,
            resume=True, patience=self.patience, trace=self.trace,
        )  # fmt: skip

    def close(self) -> None:
        """Send zero force and release the arm."""
        driver, self.driver = self.driver, None
        if driver is not None:
            driver.close()
        self._hang_up()

    def _hang_up(self) -> None:
        remote, self._remote = self._remote, None
        if remote is not None:
            remote.close()

    def read(self, reading: Record) -> bool:
        """Exchange a frame; the pose is the fingertip's.

        Raises
        ------
        DeviceError
            If the arm does not answer, answers nonsense, is gone, or is not homed any more.
        """
        found = self._open().read()
        if not found.valid:
            raise NotHomed("the arm has lost its homing; home it again")
        pose = reading["pose"]
        pose[:3] = found.position
        pose[:3] += self.params.grip
        pose[3:] = (1.0, 0.0, 0.0, 0.0)
        if self._switch is not None:
            reading["deadman"] = float(bool(found.buttons & self._switch))
        return True

    def write(self, command: Record) -> None:
        """Set the force, which the next exchange sends; the rotations are locked.

        Raises
        ------
        ValueError
            If a torque is asked for.
        """
        x, y, z, *torque = command["wrench"].tolist()
        if any(torque):
            raise ValueError(f"the arm's rotations are locked: no torque {torque} N m can be given")
        self._open().write((x, y, z))

    def make_safe(self, safe: Record) -> None:
        """Take the force away: opening the arm sends zero motors, and nothing else is needed."""
        driver = self._make()
        try:
            driver.open()
        finally:
            driver.close()
            self._hang_up()

    def _open(self) -> Falcon:
        if self.driver is None:
            raise DeviceError("the arm is not open")
        return self.driver
