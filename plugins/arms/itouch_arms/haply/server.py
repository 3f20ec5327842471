"""A non-blocking WebSocket server for the virtual service; all its connections talk to the same service."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable
from typing import Any

from itouch.plugin import DeviceError, Emulator
from itouch_arms.haply.virtual import VirtualService

_BYTES = 65536


class _Connection:
    """One connection, with the answers still to be sent and the times at which they are due [s]."""

    def __init__(self, line: socket.socket) -> None:
        from websockets.server import ServerProtocol

        self.line, self.protocol = line, ServerProtocol()
        self.due: list[tuple[float, str]] = []


class Server:
    """Listens on an address and passes messages to a virtual service.

    Raises
    ------
    DeviceError
        If it cannot listen there, or the package ``websockets`` is missing.
    """

    def __init__(self, service: VirtualService, address: tuple[str, int]) -> None:
        try:
            import websockets.server  # noqa: F401
        except ImportError as error:
            raise DeviceError("a virtual Haply arm needs another package: pip install 'itouch-py[haply]'") from error
        try:
            self._listener = Emulator.listener(address)
        except OSError as error:
            where = f"{address[0]}:{address[1]}"
            raise DeviceError(f"no virtual Inverse Service can listen on {where}: {error.strerror or error}") from error
        self._listener.setblocking(False)
        self._service = service
        self._connections: list[_Connection] = []

    @property
    def port(self) -> int:
        """The port on which it listens."""
        port: int = self._listener.getsockname()[1]
        return port

    def file_descriptors(self) -> list[int]:
        """Return the file descriptors on which data may arrive."""
        return [self._listener.fileno(), *(connection.line.fileno() for connection in self._connections)]

    def step(self, now: float) -> None:
        """Accept new connections, and answer the messages that have arrived by a time [s]."""
        with contextlib.suppress(BlockingIOError):
            line, _ = self._listener.accept()
            line.setblocking(False)
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._connections.append(_Connection(line))
        for connection in list(self._connections):
            try:
                alive = self._attend(connection, now)
            except Exception:  # it is gone, closes, or sends what the library asserts never to be sent
                alive = False
            if not alive:
                self._connections.remove(connection)
                connection.line.close()

    def _attend(self, connection: _Connection, now: float) -> bool:
        with contextlib.suppress(BlockingIOError):
            data = connection.line.recv(_BYTES)
            if data:
                connection.protocol.receive_data(data)
            else:
                connection.protocol.receive_eof()
            for event in connection.protocol.events_received():
                if not self._take(connection, event, now):
                    return False
            if not data:
                return False
        while connection.due and connection.due[0][0] <= now:
            connection.protocol.send_text(connection.due.pop(0)[1].encode())
        return self._flush(connection)

    def _take(self, connection: _Connection, event: Any, now: float) -> bool:
        from websockets.frames import Frame, Opcode
        from websockets.http11 import Request

        if isinstance(event, Request):
            connection.protocol.send_response(connection.protocol.accept(event))
            if connection.protocol.handshake_exc is None:
                connection.protocol.send_text(self._service.inventory().encode())
        elif isinstance(event, Frame) and event.opcode is Opcode.TEXT:
            faults = self._service.faults
            answers = self._service.answer(bytes(event.data).decode(), now)
            if faults.hang_up:
                faults.hang_up = False
                connection.protocol.send_text(answers[-1].encode())
                data = b"".join(connection.protocol.data_to_send())
                connection.line.sendall(data[: len(data) // 2])
                return False
            due, faults.late = now + faults.late, 0.0
            connection.due += [(due, answer) for answer in answers]
        return True

    @staticmethod
    def _flush(connection: _Connection) -> bool:
        for data in connection.protocol.data_to_send():
            if not data:
                return False
            connection.line.sendall(data)
        return True

    def serve(self, stop: Callable[[], bool], clock: Callable[[], float], *, look: float = 2e-4) -> None:
        """Serve until ``stop`` returns true."""
        import select

        while not stop():
            select.select(self.file_descriptors(), [], [], look)
            self.step(clock())

    def close(self) -> None:
        """Close all connections without a closing handshake."""
        for connection in self._connections:
            connection.line.close()
        self._connections.clear()
        self._listener.close()
