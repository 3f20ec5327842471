"""The arm as a device: it tracks the finger and pushes it; three translations, rotations locked or sensed."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import (
    ROTATIONS,
    Attached,
    Channel,
    DeviceError,
    Emulation,
    FingerTwin,
    Fit,
    Fitted,
    ImpedanceArm,
    Mechanics,
    Opening,
    Record,
    Timing,
    Twin,
    line_through,
    pose,
    schema,
    wrench,
)
from itouch_usb_arm.emulator import ArmEmulator
from itouch_usb_arm.errors import FalconError, FirmwareError, NotFound, NotHomed
from itouch_usb_arm.falcon import FORCE_SCALE, Falcon
from itouch_usb_arm.link import Remote, find
from itouch_usb_arm.wire import PRODUCT, VENDOR, Buttons

#: Greatest force [N] and stiffness [N/m] of a Novint Falcon, as stated by CHAI3D 3.3.
FORCE, STIFFNESS = 8.0, 3000.0
#: A force scale outside these limits [counts/(N m)] comes from a mistake in reading the scale.
_LOW, _HIGH = 100.0, 20000.0

#: Number of frames without force over which the latency is measured.
FRAMES = 200


def force_scale(params: Any, samples: NDArray[np.float64]) -> Fitted:
    """Return the force scale with which the arm gives the force asked for: the one in use, times asked over given.

    ``samples``, shape (n, 2): forces asked and given [N].
    """
    asked, given = samples.T
    slope, _, residual = line_through(asked, given)
    if slope <= 0.0:
        raise ValueError("the scale shows less when the arm is asked for more: check the signs")
    scale = params.force_scale / slope
    if not _LOW <= scale <= _HIGH:
        raise ValueError(
            f"a force scale of {scale:.0f} counts/(N m) is beyond {_LOW:.0f} to {_HIGH:.0f}: check the units"
        )
    return Fitted({"force_scale": scale}, residual, "N")


FORCE_SCALE_FIT = Fit(
    "force-scale",
    "put a scale under the grip, ask the arm for some forces along one direction, and write down what it shows",
    ("asked [N]", "given [N]"),
    180.0,
    force_scale,
)


@dataclass(frozen=True, slots=True)
class UsbArmParams:
    """A Novint Falcon on USB.

    The frame is that of `itouch_usb_arm.kinematics`; ``grip`` is the fingertip's centre in the grip's frame.
    """

    serial: str = schema.text(default="any", doc="serial number of the arm, or any")
    firmware: str = schema.text(default="", doc="the arm's firmware file; needed after it was powered on")
    usbip: str = schema.text(default="", doc="HOST:PORT of a USB/IP server that has the arm; empty: this machine's USB")
    grip: tuple[float, float, float] = schema.quantity(
        "m", size=3, low=-0.2, high=0.2, default=(0.0, 0.0, 0.0), doc="from the grip's centre to the fingertip's"
    )
    force_scale: float = schema.quantity(
        "", low=100.0, high=20000.0, default=FORCE_SCALE, doc="motor counts per N m; too low is safe: calibrate yours"
    )
    homing_time: float = schema.quantity(
        "s",
        low=0.1,
        high=3600.0,
        default=60.0,
        doc="how long the operator may take to pull the grip out and push it in",
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

    def __post_init__(self) -> None:
        schema.validate(self)
        if self.usbip:
            try:
                schema.host_port(self.usbip)
            except ValueError as error:
                raise ValueError(f"usbip = {error}, for example 127.0.0.1:3240") from error


class UsbArmTwin(FingerTwin):
    """The finger hangs on the arm: the twin's pose is read through encoders of finite resolution."""


class UsbArm(ImpedanceArm[Falcon]):
    """A desktop haptic arm (Novint Falcon) presented with six degrees of freedom."""

    Params = UsbArmParams
    reads = (pose(),)
    commands = (wrench(force=FORCE),)
    Twin: ClassVar[type[Twin] | None] = UsbArmTwin
    timing = Timing(blocking=True)
    #: When a process dies, the system releases its interface, so that another process can send zero force.
    opening = Opening(moves_on_open=True, second_opener=True)
    emulation = Emulation(Emulator=ArmEmulator, calibrations=(FORCE_SCALE_FIT,))
    mechanics = Mechanics(max_stiffness=STIFFNESS, damping=0.0)

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels: rotations are locked unless sensed, and a dead-man's switch is read if one is chosen."""
        locked = ROTATIONS if params.rotations == "locked" else ()
        reads, commands = super().channels(params)
        return (pose(locked=locked), *reads[1:]), commands

    @classmethod
    def wires(cls, params: UsbArmParams) -> tuple[str, ...]:
        """Name the arm by its serial number, or as the attached one, and the USB it is on: local or a server's."""
        where = f"the USB/IP server {params.usbip}" if params.usbip else "USB"
        arm = "the arm that is attached" if params.serial == "any" else f"the arm {params.serial}"
        return (f"{arm} on {where}",)

    @classmethod
    def discover(cls) -> tuple[Attached, ...]:
        """Look for arms on the USB bus."""
        return look()

    @classmethod
    def unavailable_reason(cls, bound: UsbArmParams) -> str:
        """Say why no arm can be used: by a look on the USB bus, or at what the USB/IP server has; empty if one can."""
        if bound.usbip:
            try:
                with Remote(bound.usbip) as remote:
                    find(remote.backend, bound.serial)
            except FalconError as error:
                return f"USB/IP server {bound.usbip}: {error}"
            return ""
        found = look()
        if any(one.usable for one in found):
            return ""
        return "; ".join(f"{one.where}: {one.note}" for one in found) or "no arm is on the USB bus: check its plug"

    def __init__(self, params: UsbArmParams) -> None:
        super().__init__(params)
        #: A pyusb backend object; None: the system's, or that of the USB/IP server in the parameters.
        self.backend: Any = None
        self._remote: Remote | None = None
        self._held = 0 if params.deadman == "none" else Buttons[params.deadman.upper()]

    def make_driver(self, *, safe: bool = False) -> Falcon:
        """Return the driver of the arm on this machine's bus, or on the USB/IP server."""
        p, backend = self.params, self.backend
        if backend is None and p.usbip:
            self._remote = Remote(p.usbip)
            backend = self._remote.backend
        return Falcon(
            p.firmware or None, backend, serial=p.serial, force_scale=p.force_scale,
            resume=True, patience=self.timeout_factor, trace=self.trace,
        )  # fmt: skip

    def open(self) -> None:
        """Open the arm, load its firmware if needed, and wait until it is homed.

        Raises
        ------
        DeviceError
            If it is missing, refuses, or is not homed in time; the message says what to do.
        """
        if self.params.rotations != "locked":
            raise DeviceError('the arm cannot sense rotations: write rotations="locked"')
        driver = self.make_driver()
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

    def close(self) -> None:
        """Send zero force and release the arm."""
        super().close()
        self._hang_up()

    def _hang_up(self) -> None:
        remote, self._remote = self._remote, None
        if remote is not None:
            remote.close()

    def read(self, reading: Record) -> bool:
        """Exchange one frame; the pose is the fingertip's.

        Raises
        ------
        DeviceError
            If the arm does not answer, sends invalid frames, is gone, or is no longer homed.
        """
        found = self.opened().read()
        if not found.valid:
            raise NotHomed("the arm has lost its homing; home it again")
        self.write_reading(reading, found.position, bool(found.buttons & self._held))
        return True

    def make_safe(self, safe: Record) -> None:
        """Set the force to zero: opening the arm sends zero motor commands, and nothing more is needed."""
        try:
            super().make_safe(safe)
        finally:
            self._hang_up()


def look(backend: Any = None) -> tuple[Attached, ...]:
    """Tell which arms are attached, whether they can be used, and how fast they answer.

    Each arm on the bus is opened, and exchanges frames without force; its homing is kept.
    """
    try:
        devices = find(backend)
    except NotFound as error:
        return () if "is attached" in str(error) else (Attached("USB", False, str(error)),)
    return tuple(_look_at(device, several=len(devices) > 1) for device in devices)


def _look_at(device: Any, *, several: bool) -> Attached:
    where = f"Novint Falcon {VENDOR:04x}:{PRODUCT:04x}"
    if several:
        where += f" (bus {device.bus}, device {device.address})"
    try:
        with Falcon(device=device, resume=True) as arm:
            homed = False
            for _ in range(FRAMES):
                homed = arm.read().valid
            note = f"{arm.timing}, {'homed' if homed else 'not homed: pull the grip out, then push it in'}"
            return Attached(where, True, note)
    except FirmwareError:
        note = 'it was powered on and waits for its firmware: write firmware="FILE" in its <usb-arm:hardware>'
        return Attached(where, True, note)
    except FalconError as error:
        return Attached(where, False, str(error))
