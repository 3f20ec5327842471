"""Emulators: a device's wire with its simulated twin behind it, so that a driver can be run as on the real thing."""

from __future__ import annotations

import errno
import ipaddress
import socket
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from itouch.plugin.record import Record


class Emulator(ABC):
    """Speaks a device's protocol where the device's parameters say that the device is.

    The physics is the twin's: `serve` is called many times a second with what the twin reads now, and fills in what
    the host has commanded.
    """

    #: How much faster than the host's clock its transports' own timers run; set before ``open``.
    speed: float = 1.0

    #: True if it has a course of its own in simulated time, as a simulated chip has: in step it is then served in
    #: every period, and its host's requests are answered as in no time.
    lives: bool = False

    #: True once a host has commanded it anything, be it to exert no force.  An arm in the air is driven by nobody, but
    #: on a rig that has nothing but arms the operator's motion must go on from there.
    commanded: bool = False

    def __init__(self, params: Any) -> None:
        self.params = params

    @classmethod
    def somewhere(cls, params: Any) -> Any:
        """Return the parameters with a place on this machine where driver and emulator can meet, if they name none."""
        return params

    @classmethod
    def elsewhere(cls, params: Any, folder: str) -> Any:
        """Return the parameters with a place of its own: a file in ``folder``, or a free port of this machine.

        Asked where driver and emulator are in one process: whatever address is named, nobody else comes there.
        """
        return cls.somewhere(params)

    @classmethod
    def reachable(cls, params: Any) -> tuple[float, float, float]:
        """Return a position [m] in the device's frame, with some room around it, that the real device can take.

        Only asked of a device that tracks the finger.
        """
        return (0.0, 0.0, 0.0)

    @staticmethod
    def listener(address: tuple[str, int]) -> socket.socket:
        """Return a socket that listens at a host and a port of this machine; port 0 chooses a free one.

        Whoever reaches a simulated device can command it, and a device's own protocol asks for no name: nobody from
        another machine may.

        Raises
        ------
        OSError
            If the address can be reached from elsewhere, is none, or is taken.
        """
        host, port = address
        found = socket.getaddrinfo(host or "0.0.0.0", port, type=socket.SOCK_STREAM)
        if not all(ipaddress.ip_address(entry[4][0]).is_loopback for entry in found):
            said = "a simulated device can be reached from this machine only: write 127.0.0.1"
            raise OSError(errno.EADDRNOTAVAIL, said)
        return socket.create_server(address)

    @abstractmethod
    def open(self) -> str:
        """Begin to listen; return where, in words.

        Raises
        ------
        DeviceError
            If it cannot listen there.
        """

    @abstractmethod
    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Answer what the host has asked, without waiting; tell whether the host drives the device.

        Parameters
        ----------
        now
            Simulated time [s].
        reading
            What the twin reads now.
        command
            What the twin obeys; what the host has commanded is written to it.
        """

    def patience(self) -> float:
        """Return for how long [s] it need not be served if nothing comes."""
        return 1e-3

    def handles(self) -> Sequence[int]:
        """Return the file descriptors on which a host's next request will come."""
        return ()

    @abstractmethod
    def close(self) -> None:
        """Hang up."""
