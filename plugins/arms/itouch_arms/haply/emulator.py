"""The arm's wire: a virtual Inverse Service where the parameters say, whose cursor goes where the arm's twin is."""

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
    """A calibrated arm; its operator holds the switch."""

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
    def somewhere(cls, params: Any) -> Any:
        """Name a free port of this machine if no service is named."""
        return params if params.service else cls.elsewhere(params, "")

    @classmethod
    def elsewhere(cls, params: Any, folder: str) -> Any:
        """Name a free port of this machine."""
        with socket.create_server(("127.0.0.1", 0)) as free:
            return replace(params, service=f"127.0.0.1:{free.getsockname()[1]}")

    @classmethod
    def reachable(cls, params: Any) -> Vector:
        """Return a place in front of the arm, at the fingertip."""
        x, y, z = (a + b for a, b in zip(CENTRE, params.grip, strict=True))
        return x, y, z

    def open(self) -> str:
        """Listen where the parameters say."""
        host, port = address_of(self.params.service or SERVICE)
        self._server = Server(self.service, (host, port))
        return f"Inverse Service on {host}:{port}"

    def close(self) -> None:
        """Hang up."""
        server, self._server = self._server, None
        if server is not None:
            server.close()

    def handles(self) -> list[int]:
        """Return what the server listens to."""
        return self._server.handles() if self._server is not None else []

    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Take the cursor to where the twin is, answer the host, and give the twin the motors' force.

        A host that asks for a force drives the arm, be it zero.
        """
        x, y, z = (a - b for a, b in zip(reading["pose"].tolist()[:3], self.params.grip, strict=True))
        self.service.finger.position = (x, y, z)
        self.service.asked.clear()
        if self._server is not None:
            self._server.step(time.monotonic() * self.speed)
        command["wrench"] = (*self.service.force, 0.0, 0.0, 0.0)
        return bool(self.service.asked)
