"""What impedance arms have in common: they report where their end is, and exert the force that they are commanded.

A plugin brings the driver; the position of the fingertip, the switch on the grip, the twin that the finger moves, the
driver's lifecycle and the safe command are the same for all of them.
"""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from collections.abc import Iterable
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np

from itouch.plugin.bound import Bound
from itouch.plugin.channel import ROTATIONS, Channel, deadman, pose
from itouch.plugin.device import Device, DeviceError, Twin, TwinInputs
from itouch.plugin.quantity import Role
from itouch.plugin.record import Field, Record

Vector = tuple[float, float, float]

_REST = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


class ArmDriver(Protocol):
    """The driver of an arm: it sends zero force in ``open`` and in ``close``."""

    def open(self) -> object:
        """Find the arm and send zero force; raise errors about the arm only after the zero was sent."""

    def close(self) -> None:
        """Send zero force and release the arm."""

    def write(self, force: Vector) -> None:
        """Set the force [N] that the next exchange sends."""


D = TypeVar("D", bound=ArmDriver)


class FingerTwin(Twin):
    """The finger holds the arm's end, whose position is read in steps of ``params.resolution`` [m]; 0: no steps.

    The readings are those of `ImpedanceArm`; a twin whose readings have other names overrides ``pose`` and ``switch``.
    """

    _OLD_NAMES = {"turns": "senses_rotation"}

    pose: ClassVar[str] = "pose"
    switch: ClassVar[str] = "deadman"

    @property
    def senses_rotation(self) -> bool:
        """Whether the arm's end can turn and its orientation is sensed: ``params.rotations``, if there is one."""
        return getattr(self.params, "rotations", "locked") != "locked"

    def fields(self) -> tuple[Field, ...]:
        """Return the true pose of the end."""
        return (Field("pose", "f8", 7, unit="m", doc="true pose of the end: position, quaternion w x y z"),)

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Start at the frame's origin, until the finger is attached."""
        state["pose"] = _REST

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound | None:
        """Return the step on these views as one compiled call; None if the finger is not attached."""
        from itouch.plugin.kernels import copied  # the compiler is loaded when an arm runs, not when it is listed

        return Bound(copied, touch.finger_pose, state["pose"]) if touch.finger_attached else None

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Follow the finger."""
        if touch.finger_attached:
            state["pose"] = touch.finger_pose

    def bound_read(self, state: Record, reading: Record) -> Bound:
        """Return the reading of these views as one compiled call."""
        from itouch.plugin.kernels import encoded

        switch = reading[self.switch] if self.switch in reading else np.zeros(0)
        step, turns = float(self.params.resolution), self.senses_rotation
        return Bound(encoded, state["pose"], step, turns, reading[self.pose], switch)

    def read(self, state: Record, reading: Record) -> bool | None:
        """Read the pose in steps of the encoders; the operator of a twin always holds the switch."""
        self.bound_read(state, reading)()
        return True


class ImpedanceArm(Device, Generic[D]):
    """An arm with a driver: it tracks the finger and pushes it; its rotations are locked.

    ``Params`` must have ``grip`` [m], the vector from the arm's end to the fingertip's centre, ``resolution`` [m] for
    the twin, and ``deadman``, the button that must be held to run, or ``"none"``.  The plugin defines ``make_driver``,
    which makes a driver, and ``read``.
    """

    _OLD_NAMES = {"harmless": "errors_after_zero_force", "make": "make_driver", "put": "write_reading"}

    reads = (pose(locked=ROTATIONS),)
    Twin: ClassVar[type[Twin] | None] = FingerTwin
    #: Errors that the driver's ``open`` raises after it has sent zero force; ``make_safe`` needs no more than that.
    errors_after_zero_force: ClassVar[tuple[type[Exception], ...]] = ()

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        self.driver: D | None = None
        reads, commands = self.channels(params)
        self._pose = _named(reads, Role.TRACKED_POSE)
        self._switch = _named(reads, Role.DEADMAN)
        self._force = _named(commands, Role.FORCE_ON_OPERATOR)

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels; with the dead-man's switch if ``params.deadman`` names a button."""
        switch = () if params.deadman == "none" else (deadman(),)
        return (*cls.reads, *switch), cls.commands

    @abstractmethod
    def make_driver(self, *, safe: bool = False) -> D:
        """Return a driver that is not open; ``safe``: it only takes the force away, and so waits for nobody."""

    def open(self) -> None:
        """Open the arm.

        Raises
        ------
        DeviceError
            If it is missing, refuses, or is not calibrated in time; the message says what to do.
        """
        driver = self.make_driver()
        driver.open()
        self.driver = driver

    def close(self) -> None:
        """Send zero force and release the arm."""
        driver, self.driver = self.driver, None
        if driver is not None:
            driver.close()

    def write(self, command: Record) -> None:
        """Set the force that the next exchange sends; the rotations are locked.

        Raises
        ------
        ValueError
            If a torque is commanded.
        DeviceError
            If the arm is not open.
        """
        x, y, z, *torque = command[self._force].tolist()
        if any(torque):
            raise ValueError(f"the arm's rotations are locked: no torque {torque} N m can be given")
        self.opened().write((x, y, z))

    def make_safe(self, safe: Record) -> None:
        """Take the force away: opening sends zero force, whether the arm is calibrated or not."""
        driver = self.make_driver(safe=True)
        try:
            with contextlib.suppress(*self.errors_after_zero_force):
                driver.open()
        finally:
            driver.close()

    def write_reading(self, reading: Record, position: Iterable[float], held: bool) -> None:
        """Write the fingertip's pose, from the position [m] of the arm's end, and whether the switch is held."""
        x, y, z = (a + b for a, b in zip(position, self.params.grip, strict=True))
        reading[self._pose] = (x, y, z, 1.0, 0.0, 0.0, 0.0)
        if self._switch:
            reading[self._switch] = float(held)

    def opened(self) -> D:
        """Return the driver.

        Raises
        ------
        DeviceError
            If the arm is not open.
        """
        if self.driver is None:
            raise DeviceError("the arm is not open")
        return self.driver


def _named(channels: tuple[Channel, ...], role: Role) -> str:
    return next((channel.name for channel in channels if channel.role is role), "")
