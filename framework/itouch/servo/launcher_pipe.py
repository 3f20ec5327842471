"""The pipe between servo process and launcher: one line of JSON for each message; the loop never waits for it."""

from __future__ import annotations

import contextlib
import json
import select
import socket
from collections.abc import Iterator, Mapping
from typing import Any

#: How much may wait to be sent [bytes]; beyond that, further messages are dropped, but never the last one.
BACKLOG = 8 << 20
#: How long [s] the last message may take: the launcher may be suspended (Ctrl-Z).  All is safe and written by then; a
#: launcher that has died is noticed at once.
LAST_WAIT = 60.0


class Outbox:
    """The servo process's end of the pipe; it buffers what the launcher does not take at once."""

    def __init__(self, line: socket.socket) -> None:
        self._line = line
        self._waiting = bytearray()
        line.setblocking(False)

    def tell(self, kind: str, content: Mapping[str, Any]) -> None:
        """Send a message now, or with a later ``flush``."""
        text = json.dumps({"kind": kind, **content}).encode() + b"\n"
        if len(self._waiting) + len(text) <= BACKLOG:
            self._waiting += text
        self.flush()

    def flush(self) -> None:
        """Send as much as the launcher takes without waiting."""
        with contextlib.suppress(BlockingIOError, InterruptedError):
            while self._waiting:
                try:
                    sent = self._line.send(self._waiting[:65536])
                except (BrokenPipeError, ConnectionError):
                    self._waiting.clear()
                    return
                del self._waiting[:sent]

    def finish(self, content: Mapping[str, Any]) -> None:
        """Send the last message, waiting some seconds for the launcher to take it, and close the pipe."""
        text = json.dumps({"kind": "end", **content}).encode() + b"\n"
        with contextlib.suppress(OSError):  # the launcher has gone, or somebody has closed the line
            self._line.setblocking(True)
            self._line.settimeout(LAST_WAIT)
            self._line.sendall(bytes(self._waiting) + text)
        with contextlib.suppress(OSError):
            self._line.close()


def messages(line: socket.socket, process: int | None = None) -> Iterator[dict[str, Any]]:
    """Yield the messages as they come, until the other end closes.

    ``process``: file descriptor (pidfd) of the sending process, whose end also ends the messages: a forked copy of it
    that a plugin has left behind would hold the line open.
    """
    rest, poller = b"", None
    if process is not None:
        poller = select.poll()
        poller.register(line, select.POLLIN)
        poller.register(process, select.POLLIN)
    while True:
        if poller is not None and line.fileno() not in {handle for handle, _ in poller.poll()}:
            return
        try:
            piece = line.recv(1 << 16)
        except OSError:
            return
        if not piece:
            return
        *whole, rest = (rest + piece).split(b"\n")
        for text in whole:
            with contextlib.suppress(ValueError):
                message = json.loads(text)
                if isinstance(message, dict):
                    yield message
