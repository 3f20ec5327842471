"""The arm's emulator: a virtual Inverse Service at the parameters' address; its cursor follows the arm's twin."""

from __future__ import annotations

import socket
import time
from dataclasses import replace
from typing import Any

from itouch.plugin import Emulator, Record
from itouch.plugin.impedance import Vector
from itouch_arms.haply.inverse3 import SERVICE
from itouch_arms.haply.line import address_of
from itouch_arms.haply.server import Server
from itouch_arms.haply.virtual import CENTRE, VirtualService


class HaplyEmulator(Emulator):
    """A calibrated arm whose operator holds the dead-man's switch."""

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        self.service = VirtualService()
        self.service.finger.led = True
        if params.device != "any":
            self.service.device = params.device
        if params.deadman in self.service.buttons:
            self.service.buttons[params.deadman] = True
        elif params.deadman == "button":
            self.service.buttons["button"] = True
        self._server: Server | None = None

    @classmethod
    def with_default_address(cls, params: Any) -> Any:
        """Name a free port of this machine if no service is named."""
        return params if params.service else cls.with_private_address(params, "")

    @classmethod
    def with_private_address(cls, params: Any, folder: str) -> Any:
        """Name a free port of this machine."""
        with socket.create_server(("127.0.0.1", 0)) as free:
            return replace(params, service=f"127.0.0.1:{free.getsockname()[1]}")

    @classmethod
    def reachable_position(cls, params: Any) -> Vector:
        """Return a position [m] in front of the arm that the fingertip can reach."""
        x, y, z = (a + b for a, b in zip(CENTRE, params.grip, strict=True))
        return x, y, z

    def open(self) -> str:
        """Listen at the address in the parameters, or at the service's usual one; return what listens where."""
        host, port = address_of(self.params.service or SERVICE)
        self._server = Server(self.service, (host, port))
        return f"Inverse Service on {host}:{port}"

    def close(self) -> None:
        """Close all connections."""
        server, self._server = self._server, None
        if server is not None:
            server.close()

    def file_descriptors(self) -> list[int]:
        """Return the file descriptors on which the server waits for data."""
        return self._server.file_descriptors() if self._server is not None else []

    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Set the cursor to the twin's position, answer the host, and give the twin the motors' force.

        Return whether the host has asked for a force, even a zero one: then it drives the arm.
        """
        x, y, z = (a - b for a, b in zip(reading["pose"].tolist()[:3], self.params.grip, strict=True))
        self.service.finger.position = (x, y, z)
        self.service.asked.clear()
        if self._server is not None:
            self._server.step(time.monotonic() * self.speed)
        command["wrench"] = (*self.service.force, 0.0, 0.0, 0.0)
        return bool(self.service.asked)
