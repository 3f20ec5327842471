"""Emulators: a device's wire with its simulated twin behind it, so that a driver runs as with the real device."""

from __future__ import annotations

import errno
import ipaddress
import socket
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from itouch.moved import HasOldNames
from itouch.plugin.record import Record


class Emulator(HasOldNames, ABC):
    """Speaks a device's protocol at the port or address that the device's parameters name.

    The physics is the twin's: `serve` is called many times a second with the twin's present readings, and fills in the
    commands of the host.
    """

    _OLD_NAMES = {
        "commanded": "command_received", "elsewhere": "with_private_address", "handles": "file_descriptors",
        "lives": "free_running", "patience": "service_interval", "reachable": "reachable_position",
        "somewhere": "with_default_address",
    }  # fmt: skip

    #: How much faster than the host's clock the timers of its transport run; set before ``open``.
    speed: float = 1.0

    #: True if it does something by itself in simulated time, as a simulated chip does: in step it is then served in
    #: every period, and its host's requests are answered as if in no time.
    free_running: bool = False

    #: True once a host has sent it any command, even one of zero force.  An arm in free space counts as not driven, but
    #: on a rig with nothing but arms the operator's motion must begin from then on.
    command_received: bool = False

    def __init__(self, params: Any) -> None:
        self.params = params

    @classmethod
    def with_default_address(cls, params: Any) -> Any:
        """Return the parameters with a port or address on this machine filled in, if they name none."""
        return params

    @classmethod
    def with_private_address(cls, params: Any, folder: str) -> Any:
        """Return the parameters with an address of its own: a file in ``folder``, or a free port of this machine.

        Used if driver and emulator run in one process, so that no other program can connect, whatever address is named.
        """
        return cls.with_default_address(params)

    @classmethod
    def reachable_position(cls, params: Any) -> tuple[float, float, float]:
        """Return a position [m] in the device's frame, with some room around it, that the real device can reach.

        It is called only for a device that tracks the finger.
        """
        return (0.0, 0.0, 0.0)

    @staticmethod
    def listener(address: tuple[str, int]) -> socket.socket:
        """Return a socket that listens at a host and a port of this machine; port 0 chooses a free one.

        Whoever connects to a simulated device can command it, as device protocols have no authentication: so no other
        machine may connect.

        Raises
        ------
        OSError
            If the address can be reached from other machines, is invalid, or is in use.
        """
        host, port = address
        found = socket.getaddrinfo(host or "0.0.0.0", port, type=socket.SOCK_STREAM)
        if not all(ipaddress.ip_address(entry[4][0]).is_loopback for entry in found):
            said = "a simulated device can be reached from this machine only: write 127.0.0.1"
            raise OSError(errno.EADDRNOTAVAIL, said)
        return socket.create_server(address)

    @abstractmethod
    def open(self) -> str:
        """Begin to listen; return where, in words for a person.

        Raises
        ------
        DeviceError
            If it cannot listen there.
        """

    @abstractmethod
    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Answer the host's requests, without waiting; tell whether the host drives the device.

        Parameters
        ----------
        now
            Simulated time [s].
        reading
            The twin's present readings.
        command
            The twin's command, to which the host's commands are written.
        """

    def service_interval(self) -> float:
        """Return for how long [s] it need not be served if no request comes."""
        return 1e-3

    def file_descriptors(self) -> Sequence[int]:
        """Return the file descriptors on which the host's next request will arrive."""
        return ()

    @abstractmethod
    def close(self) -> None:
        """Close the connection and stop listening; also called once if ``open`` has failed, to close what it opened."""
