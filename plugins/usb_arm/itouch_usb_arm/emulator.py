"""The arm's emulator: a virtual Falcon on a USB/IP server, whose grip follows the arm's twin."""

from __future__ import annotations

import socket
from dataclasses import replace
from typing import Any

from itouch.plugin import DeviceError, Emulator, Record
from itouch_usb_arm import kinematics
from itouch_usb_arm.virtual.mechanics import Mechanics
from itouch_usb_arm.virtual.times import HostTime
from itouch_usb_arm.virtual.usbip import UsbipServer
from itouch_usb_arm.virtual.virtual_falcon import VirtualFalcon
from itouch_usb_arm.wire import Buttons


class Led(Mechanics):
    """Mechanics whose grip the twin moves."""

    def advance(self, now: float) -> None:
        """Do nothing: the twin sets the grip's position."""

    def lead(self, position: kinematics.Vector) -> None:
        """Move the grip to a position [m]; out of the arm's reach it stays where it is."""
        try:
            kinematics.jacobian(position)
        except kinematics.UnreachableError:
            return
        self.position = position


class ArmEmulator(Emulator):
    """A homed arm with running firmware at the address ``usbip``; its operator holds the dead-man's switch."""

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        self._led = Led(counts_per_torque=params.force_scale)
        self.arm = VirtualFalcon(running=True, homed=True, mechanics=self._led)
        if params.deadman != "none":
            self.arm.buttons = Buttons[params.deadman.upper()]
        self._server: UsbipServer | None = None
        self._place: list[float] = []

    @classmethod
    def with_default_address(cls, params: Any) -> Any:
        """Name a free port of this machine if no address is named."""
        return params if params.usbip else cls.with_private_address(params, "")

    @classmethod
    def with_private_address(cls, params: Any, folder: str) -> Any:
        """Name a free port of this machine."""
        with socket.create_server(("127.0.0.1", 0)) as free:
            return replace(params, usbip=f"127.0.0.1:{free.getsockname()[1]}")

    @classmethod
    def reachable_position(cls, params: Any) -> kinematics.Vector:
        """Return the middle of the arm's workspace [m], at the fingertip."""
        x, y, z = (a + b for a, b in zip(kinematics.CENTRE, params.grip, strict=True))
        return x, y, z

    def open(self) -> str:
        """Listen at the address in the parameters; return what listens where."""
        self.arm.time = HostTime(self.speed)
        host, _, port = self.params.usbip.rpartition(":")
        if not host or not port.isdigit():
            return "nothing: no usbip address is named"
        try:
            self._server = UsbipServer(self.arm, (host, int(port)), self.listener)
        except OSError as error:
            raise DeviceError(f"no virtual arm can listen on {host}:{port}: {error.strerror or error}") from error
        return f"Falcon over USB/IP on {host}:{port}"

    def close(self) -> None:
        """Close all connections."""
        server, self._server = self._server, None
        if server is not None:
            server.close()

    def service_interval(self) -> float:
        """Return for how long [s] nothing is due."""
        return self._server.service_interval() if self._server is not None else 1e-3

    def file_descriptors(self) -> list[int]:
        """Return the file descriptors on which the server waits for data."""
        return self._server.file_descriptors() if self._server is not None else []

    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Move the grip to the twin's position, answer the host, and give the twin the motors' force.

        Return whether the host drives a motor.
        """
        place = reading["pose"].tolist()[:3]
        if place != self._place:
            self._place = place
            x, y, z = (a - b for a, b in zip(place, self.params.grip, strict=True))
            self._led.lead((x, y, z))
        if self._server is not None:
            self._server.step(wait=False)
        self.command_received = self.command_received or bool(self.arm.commands)
        driven = any(self._led.motors)
        command["wrench"] = (*self._led.motor_force(), 0.0, 0.0, 0.0) if driven else 0.0
        return driven
