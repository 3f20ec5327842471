"""A WebSocket client for text messages, without threads: every call returns within its time limit."""

from __future__ import annotations

import contextlib
import socket
import time
from collections import deque

from itouch.plugin import Trace, schema
from itouch_arms.errors import ArmError, Disconnected, NotFound, ProtocolError, Timeout

#: Greatest message [bytes]: an inventory of many devices takes some kilobytes.
MOST = 1 << 20
_BYTES = 65536
_ADVICE = 'start the Inverse Service (Haply Hub starts it), or write its address as service="HOST:PORT"'


def address_of(service: str) -> tuple[str, int]:
    """Return the host and port of ``HOST:PORT``.

    Raises
    ------
    NotFound
        If the text is not of that form.
    """
    try:
        return schema.host_port(service.removeprefix("ws://").rstrip("/"))
    except ValueError as error:
        raise NotFound(f"service = {error}, for example localhost:10001") from error


class Line:
    """An open WebSocket.

    Parameters
    ----------
    service
        ``HOST:PORT``.
    wait
        How long [s] connecting may take.
    trace
        Where to log the messages that go over the wire.

    Raises
    ------
    ArmError
        If nothing listens there, or it is not a WebSocket.
    """

    def __init__(self, service: str, *, wait: float = 2.0, trace: Trace | None = None) -> None:
        try:
            from websockets.client import ClientProtocol
            from websockets.uri import parse_uri
        except ImportError as error:
            raise NotFound("a Haply arm needs another package: pip install 'itouch-py[haply]'") from error
        host, port = address_of(service)
        self._trace, self._where = trace, f"{host}:{port}"
        self._messages: deque[str] = deque()
        self._parts, self._ended = b"", False
        try:
            self._socket = socket.create_connection((host, port), wait)
        except OSError as error:
            raise NotFound(
                f"no Inverse Service answers at {self._where} ({error.strerror or error}): {_ADVICE}"
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        named = f"[{host}]" if ":" in host else host
        self._protocol = ClientProtocol(parse_uri(f"ws://{named}:{port}/"), max_size=MOST)
        try:
            self._shake_hands(wait)
        except BaseException:
            self._socket.close()
            raise

    def _shake_hands(self, wait: float) -> None:
        from websockets.protocol import OPEN

        self._protocol.send_request(self._protocol.connect())
        self._flush()
        end = time.monotonic() + wait
        while self._protocol.state is not OPEN:
            if self._protocol.handshake_exc is not None:
                raise NotFound(
                    f"what answers at {self._where} is not an Inverse Service: {self._protocol.handshake_exc}"
                )
            self._take(end - time.monotonic())

    def send(self, text: str) -> None:
        """Send a message.

        Raises
        ------
        Disconnected
            If the connection is gone.
        """
        from websockets.exceptions import InvalidState

        if self._trace:
            self._trace.sent(text.encode())
        try:
            self._protocol.send_text(text.encode())
        except InvalidState as error:
            raise Disconnected(f"the Inverse Service at {self._where} has closed the connection") from error
        self._flush()

    def receive(self, wait: float) -> str:
        """Return the next message.

        Raises
        ------
        ArmError
            If none comes in time, or the connection is gone.
        """
        end = time.monotonic() + wait
        while not self._messages:
            self._take(end - time.monotonic())
        return self._messages.popleft()

    def waiting(self) -> str | None:
        """Return a message that has already arrived, or None."""
        return self._messages.popleft() if self._messages else None

    def close(self) -> None:
        """Close with a closing frame; a connection that is already gone is no error."""
        with contextlib.suppress(Exception):
            self._protocol.send_close(1000)
            self._flush()
        self._socket.close()

    def _flush(self) -> None:
        try:
            for data in self._protocol.data_to_send():
                if data:
                    self._socket.sendall(data)
                else:
                    self._socket.shutdown(socket.SHUT_WR)
        except OSError as error:
            raise self._gone(error) from error

    def _take(self, left: float) -> None:
        """Receive data, waiting at most ``left`` seconds.

        Raises
        ------
        ArmError
            If none arrives, or the other side closes the connection.
        """
        if left <= 0.0:
            raise self._late()
        self._socket.settimeout(left)
        try:
            data = self._socket.recv(_BYTES)
        except TimeoutError as error:
            raise self._late() from error
        except OSError as error:
            raise self._gone(error) from error
        try:
            if data:
                self._protocol.receive_data(data)
            elif not self._ended:
                self._ended = True
                self._protocol.receive_eof()
        except (AssertionError, EOFError) as error:  # what the library assumes never to be sent
            raise self._gone(error) from error
        for event in self._protocol.events_received():
            self._event(event)
        with contextlib.suppress(Disconnected):  # a pong, or the answer to a closing frame
            self._flush()
        if not self._messages and (not data or self._protocol.close_expected()):
            raise self._gone(self._protocol.parser_exc)

    def _event(self, event: object) -> None:
        from websockets.frames import Frame, Opcode

        if not isinstance(event, Frame) or event.opcode not in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
            return
        self._parts += event.data
        if not event.fin:
            return
        data, self._parts = bytes(self._parts), b""
        if self._trace:
            self._trace.received(data)
        try:
            self._messages.append(data.decode())
        except UnicodeDecodeError as error:
            raise ProtocolError("the Inverse Service sent something that is not text") from error

    def _late(self) -> ArmError:
        return Timeout(f"the Inverse Service at {self._where} did not answer in time")

    def _gone(self, reason: Exception | None) -> ArmError:
        text = getattr(reason, "strerror", None) or reason
        return Disconnected(f"the Inverse Service at {self._where} is gone{f': {text}' if text else ''}")
