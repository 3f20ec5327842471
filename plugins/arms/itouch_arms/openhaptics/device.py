"""A Phantom or Touch as a device: it tracks the finger and pushes it; three translations, rotations locked."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any, ClassVar

from itouch.plugin import Attached, Channel, Device, DeviceError, Record, Twin, deadman, pose, schema, wrench
from itouch_arms.errors import ArmError, NotCalibrated
from itouch_arms.finger import FingerTwin, force_of, put_pose
from itouch_arms.openhaptics.driver import Phantom

#: Greatest force [N] and stiffness [N/m] of a Phantom Omni, as OpenHaptics states them (3.3 N and 0.5 N/mm).
FORCE, STIFFNESS = 3.3, 500.0
_BUTTONS = {"none": 0, "button1": 1, "button2": 2}


@dataclass(frozen=True, slots=True)
class OpenHapticsParams:
    """What ``<openhaptics:hardware>`` may hold.

    The frame: x right, y away from the operator, z up; the origin is the library's.
    """

    name: str = schema.text(default="", doc="the arm's name in its maker's configuration; empty: the default one")
    library: str = schema.text(default="", doc="file of the library; empty: libHD.so where the system looks for it")
    grip: tuple[float, float, float] = schema.quantity(
        "m", size=3, low=-0.2, high=0.2, default=(0.0, 0.0, 0.0), doc="from the arm's end to the fingertip's centre"
    )
    calibration_time: float = schema.quantity(
        "s", low=0.0, high=3600.0, default=60.0, doc="how long the operator has to calibrate the arm"
    )
    deadman: str = schema.choice(*_BUTTONS, default="none", doc="button of the stylus that must be held to run")
    resolution: float = schema.quantity(
        "m", low=0.0, high=1e-3, default=5e-5, doc="of the twin: step of the position that the arm gives"
    )


class OpenHaptics(Device):
    """A Phantom or Touch arm through OpenHaptics, the maker's library, presented with six degrees of freedom."""

    Params = OpenHapticsParams
    reads = (pose(locked=(3, 4, 5)),)
    commands = (wrench(force=FORCE),)
    Twin: ClassVar[type[Twin] | None] = FingerTwin
    blocking: ClassVar[bool] = True
    #: The library of a process that died is gone with it: another process can open the arm, without force.
    second_opener: ClassVar[bool] = True
    max_stiffness: ClassVar[float | None] = STIFFNESS
    damping: ClassVar[float | None] = 0.0

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels; a switch is there if a button is one."""
        switch = () if params.deadman == "none" else (deadman(),)
        return (*cls.reads, *switch), cls.commands

    @classmethod
    def attached(cls) -> tuple[Attached, ...]:
        """Open the default arm without force, if the library is there."""
        arm = Phantom()
        try:
            arm.open()
        except ArmError as error:
            return (Attached(arm.model or "OpenHaptics", False, str(error)),)
        arm.close()
        return (Attached(arm.model or "an arm", True, f"calibrated; at most {arm.max_force:g} N"),)

    def __init__(self, params: OpenHapticsParams) -> None:
        super().__init__(params)
        self._switch = _BUTTONS[params.deadman]
        self.driver: Phantom | None = None

    def _make(self, calibration_time: float) -> Phantom:
        p = self.params
        return Phantom(
            p.name, p.library, calibration_time=calibration_time, patience=self.patience, trace=self.trace
        )  # fmt: skip

    def open(self) -> None:
        """Load the library, open the arm and wait until it is calibrated.

        Raises
        ------
        DeviceError
            If the library or the arm is missing, refuses, or is not calibrated in time; it says what to do.
        """
        driver = self._make(self.params.calibration_time)
        driver.open()
        self.driver = driver

    def close(self) -> None:
        """Send zero force and let the arm go."""
        driver, self.driver = self.driver, None
        if driver is not None:
            driver.close()

    def read(self, reading: Record) -> bool:
        """Take the newest frame; the pose is the fingertip's.

        Raises
        ------
        DeviceError
            If frames stop, or the library tells an error.
        """
        found = self._open().read()
        put_pose(reading, found.position, self.params.grip)
        if self._switch:
            reading["deadman"] = float(bool(found.buttons & self._switch))
        return True

    def write(self, command: Record) -> None:
        """Set the force, which the next frames send; the rotations are locked.

        Raises
        ------
        ValueError
            If a torque is asked for.
        """
        self._open().write(force_of(command))

    def make_safe(self, safe: Record) -> None:
        """Take the force away: opening the arm sends frames without force, calibrated or not."""
        driver = self._make(0.0)
        with contextlib.suppress(NotCalibrated):
            driver.open()
        driver.close()

    def _open(self) -> Phantom:
        if self.driver is None:
            raise DeviceError("the arm is not open")
        return self.driver
