"""An arm on another machine, or a virtual one: pyusb over USB/IP, with the package ``pyusb-usbip-backend``."""

from __future__ import annotations

import contextlib
from types import TracebackType
from typing import Any, Self

from itouch_usb_arm.errors import FalconError


class Remote:
    """The connection to a USB/IP server; `Falcon` takes its ``backend``.

    Raises
    ------
    FalconError
        If the address is malformed, or the package is missing.
    """

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise FalconError(f"usbip = '{address}' must be HOST:PORT, for example 127.0.0.1:3240")
        try:
            from usbip_backend import get_backend
        except ImportError as error:
            raise FalconError("an arm over USB/IP needs a package more: pip install pyusb-usbip-backend") from error
        self.backend: Any = get_backend(host, int(port))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections: the package would keep them open, and a server lends an arm to one host at a time."""
        connections: dict[Any, Any] = getattr(self.backend, "_conns", {})
        for connection in connections.values():
            with contextlib.suppress(OSError):
                connection.close()
        connections.clear()
