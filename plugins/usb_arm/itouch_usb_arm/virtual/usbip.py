"""The virtual arm as a USB/IP server: any machine with a USB/IP client sees a Falcon on its bus.

The protocol (Linux kernel, Documentation/usb/usbip_protocol): a list of devices, an import, then one 48-byte header per
transfer, all big-endian.  One thread serves any number of connections; one at a time can import the arm.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import struct
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from itouch_usb_arm.link import IN, OUT
from itouch_usb_arm.virtual.requests import control
from itouch_usb_arm.virtual.virtual_falcon import StalledError, UnpluggedError, VirtualFalcon
from itouch_usb_arm.wire import PRODUCT, VENDOR

VERSION, BUS_ID = 0x0111, b"1-1"
_LIST, _IMPORT = 0x8005, 0x8003
_SUBMIT, _UNLINK, _SUBMITTED, _UNLINKED = 1, 2, 3, 4
_OP, _HEADER = struct.Struct(">HHI"), struct.Struct(">5I5i8s")
_STALL, _RESET, _GONE = -32, -104, -19
_FULL_SPEED = 2
#: How long [s] the server waits when nothing is due, and at least; greatest transfer [bytes] that it accepts.
_IDLE, _SHORT, _MOST = 0.05, 1e-4, 1 << 16


class _Waiting(NamedTuple):
    """A read request of the host that has not been answered yet."""

    sequence: int
    length: int


class _Host:
    """One connection."""

    def __init__(self, line: socket.socket) -> None:
        self.line = line
        self.received = bytearray()
        self.imported = False
        self.waiting: deque[_Waiting] = deque()

    def take(self, size: int) -> bytes:
        """Remove and return the first bytes received."""
        data = bytes(self.received[:size])
        del self.received[:size]
        return data


class UsbipServer:
    """Offers one virtual arm; ``address`` is (host, port), port 0 chooses a free one; ``listen`` makes the socket."""

    def __init__(
        self, arm: VirtualFalcon, address: tuple[str, int] = ("127.0.0.1", 3240),
        listen: Callable[[tuple[str, int]], socket.socket] = socket.create_server,
    ) -> None:  # fmt: skip
        self.arm = arm
        self._listener = listen(address)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ, None)
        self._hosts: list[_Host] = []

    @property
    def address(self) -> tuple[str, int]:
        """The address on which it listens."""
        host, port = self._listener.getsockname()[:2]
        return host, port

    def file_descriptors(self) -> list[int]:
        """Return the file descriptors on which data may arrive."""
        return [self._listener.fileno(), *(host.line.fileno() for host in self._hosts)]

    def close(self) -> None:
        """Drop all connections."""
        for host in list(self._hosts):
            self._drop(host)
        self._selector.close()
        self._listener.close()

    def serve(self, stop: Callable[[], bool]) -> None:
        """Serve until ``stop`` returns true; it is called many times a second."""
        while not stop():
            self.step()

    def step(self, *, wait: bool = True) -> None:
        """Do what is due; with ``wait``, wait for the next event if nothing is."""
        for key, _ in self._selector.select(self.service_interval() if wait else 0.0):
            if key.data is None:
                self._accept()
            else:
                self._hear(key.data)
        for host in list(self._hosts):
            self._give(host)

    def service_interval(self) -> float:
        """Return for how long [s] nothing will be due, unless a host sends a request."""
        if not any(host.waiting for host in self._hosts):
            return _IDLE
        return min(_IDLE, max(_SHORT, self.arm.next_packet - self.arm.time.now()))

    def _accept(self) -> None:
        line, _ = self._listener.accept()
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        line.settimeout(1.0)
        host = _Host(line)
        self._hosts.append(host)
        self._selector.register(line, selectors.EVENT_READ, host)

    def _drop(self, host: _Host) -> None:
        self._hosts.remove(host)
        self._selector.unregister(host.line)
        host.line.close()

    def _hear(self, host: _Host) -> None:
        try:
            data = host.line.recv(1 << 16)
        except OSError:
            data = b""
        host.received += data
        try:
            if not data:
                self._drop(host)
                return
            while self._work(host):
                pass
        except (OSError, UnpluggedError, ValueError):  # the host or the arm is gone, or this is not USB/IP
            self._drop(host)

    def _work(self, host: _Host) -> bool:
        """Handle one request if it has arrived completely; tell whether one was handled."""
        return self._transfer(host) if host.imported else self._operation(host)

    def _operation(self, host: _Host) -> bool:
        if len(host.received) < _OP.size:
            return False
        _, code, _ = _OP.unpack_from(host.received)
        if code == _LIST:
            host.take(_OP.size)
            self._list(host)
            return True
        if code != _IMPORT:
            raise ValueError(f"operation {code:#x}")
        if len(host.received) < _OP.size + 32:
            return False
        self._import(host, host.take(_OP.size + 32)[_OP.size :].rstrip(b"\0"))
        return True

    def _list(self, host: _Host) -> None:
        count = int(self.arm.attached)
        answer = _OP.pack(VERSION, _LIST & 0x7FFF, 0) + struct.pack(">I", count)
        if count:
            answer += self._description() + bytes((0xFF, 0xFF, 0xFF, 0))
        host.line.sendall(answer)

    def _import(self, host: _Host, bus_id: bytes) -> None:
        taken = any(other.imported for other in self._hosts)
        if bus_id != BUS_ID or not self.arm.attached or taken:
            host.line.sendall(_OP.pack(VERSION, _IMPORT & 0x7FFF, 1))
            return
        host.imported = True
        host.line.sendall(_OP.pack(VERSION, _IMPORT & 0x7FFF, 0) + self._description())

    def _description(self) -> bytes:
        return struct.pack(
            ">256s32sIIIHHHBBBBBB", b"/sys/devices/virtual-arm/usb1/1-1", BUS_ID, 1, 2, _FULL_SPEED,
            VENDOR, PRODUCT, 0x0600, 0, 0, 0, self.arm.configuration, 1, 1,
        )  # fmt: skip

    def _transfer(self, host: _Host) -> bool:
        if len(host.received) < _HEADER.size:
            return False
        command, sequence, _, inward, endpoint, first, length, _, _, _, setup = _HEADER.unpack_from(host.received)
        if command == _UNLINK:
            host.take(_HEADER.size)
            self._unlink(host, sequence, first)
            return True
        if command != _SUBMIT or not 0 <= length <= _MOST:
            raise ValueError(f"command {command}")
        data = b"" if inward else bytes(host.received[_HEADER.size : _HEADER.size + length])
        if not inward and len(data) < length:
            return False
        host.take(_HEADER.size + len(data))
        self._submit(host, sequence, endpoint, data, length, bytes(setup), inward=bool(inward))
        return True

    def _submit(
        self, host: _Host, sequence: int, endpoint: int, data: bytes, length: int, setup: bytes, *, inward: bool
    ) -> None:
        try:
            if endpoint == 0:
                answer = control(self.arm, setup)
                self._done(host, sequence, 0, answer[:length] if inward else b"", 0 if inward else len(data))
            elif inward and endpoint == IN & 0x0F:
                host.waiting.append(_Waiting(sequence, length))
            elif not inward and endpoint == OUT:
                self.arm.bulk_out(data)
                self._done(host, sequence, 0, b"", len(data))
            else:
                self._done(host, sequence, _STALL, b"", 0)
        except StalledError:
            self._done(host, sequence, _STALL, b"", 0)

    def _give(self, host: _Host) -> None:
        """Answer read requests with the packets that are due."""
        try:
            while host.waiting:
                try:
                    packet = self.arm.bulk_in()
                except StalledError:
                    self._done(host, host.waiting.popleft().sequence, _STALL, b"", 0)
                    continue
                if packet is None:
                    return
                waiting = host.waiting.popleft()
                self._done(host, waiting.sequence, 0, packet[: waiting.length], 0)
        except UnpluggedError:
            with contextlib.suppress(OSError):
                for waiting in host.waiting:
                    self._done(host, waiting.sequence, _GONE, b"", 0)
            self._drop(host)
        except OSError:
            self._drop(host)

    def _unlink(self, host: _Host, sequence: int, target: int) -> None:
        """Cancel a read request; the data that it would have got stays in the chip."""
        found = next((waiting for waiting in host.waiting if waiting.sequence == target), None)
        if found is not None:
            host.waiting.remove(found)
        status = _RESET if found is not None else 0
        host.line.sendall(struct.pack(">5Ii24x", _UNLINKED, sequence, 0, 0, 0, status))

    @staticmethod
    def _done(host: _Host, sequence: int, status: int, data: bytes, sent: int) -> None:
        length = len(data) or sent
        header = struct.pack(">5I5i8x", _SUBMITTED, sequence, 0, 0, 0, status, length, 0, 0, 0)
        host.line.sendall(header + data)
