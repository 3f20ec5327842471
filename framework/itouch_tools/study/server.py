"""The server of a study: JSON lines over TCP, from this machine only, behind a key; polled between two ticks.

No thread serves it: once a tick the loop asks the kernel whether anything has come, and takes at most one request.
What a caller sends faster than that waits in the kernel; a caller that does not read its answers is disconnected, and
never holds up the loop.
"""

from __future__ import annotations

import contextlib
import hmac
import json
import math
import os
import secrets
import selectors
import socket
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from itouch.schema import ItouchError

#: Version of the protocol (of the lines), which is in the first answer.
LINES = 1
#: Longest line [bytes]; most [bytes] of a caller's answers that it has not read, and of its requests while one is not
#: answered; most callers; and how long [s] a key may take to come.
LONGEST, BACKLOG, MOST, PATIENCE = 1 << 16, 8 << 20, 8, 5.0
_HOST = "127.0.0.1"


class StudyServerError(ItouchError):
    """A server that can't be opened."""


@dataclass(slots=True, eq=False)
class Caller:
    """A connected program: bytes that came and were not taken, bytes not sent yet, and whether it has shown the key."""

    line: socket.socket
    since: float
    known: bool = False
    coming: bytearray = field(default_factory=bytearray)
    going: bytearray = field(default_factory=bytearray)
    #: Whether its last request has not been answered yet; until then its next one waits.
    busy: bool = False
    gone: bool = False


@dataclass(frozen=True, slots=True)
class Request:
    """A caller's request: its word, and the whole line that was given."""

    caller: Caller
    what: str
    given: dict[str, Any]


class StudyServer:
    """Listens to callers; also a context manager that writes the key's file, and removes it at the end.

    Parameters
    ----------
    key
        File for address and key, which only this user can read.
    port
        TCP port; 0: any free one.

    Raises
    ------
    StudyServerError
        If the port is taken, or the file can't be written, or leads to a study that is served now.
    """

    def __init__(self, key: Path, port: int = 0) -> None:
        self.path, self._token = key, secrets.token_urlsafe(24)
        if _answers(key):
            raise StudyServerError(
                f"'{key}' belongs to a study that is being served; end that one, or name another --key FILE"
            )
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            if os.name == "posix":  # elsewhere this option would let two programs listen on one port
                self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind((_HOST, port))
        except (OSError, OverflowError) as error:
            self._listener.close()
            raise StudyServerError(
                f"cannot listen on port {port}: {getattr(error, 'strerror', None) or error}"
            ) from error
        self._listener.listen(MOST)
        self._listener.setblocking(False)
        self.port = int(self._listener.getsockname()[1])
        self._events = selectors.DefaultSelector()
        self._events.register(self._listener, selectors.EVENT_READ)
        self.callers: list[Caller] = []

    def __enter__(self) -> StudyServer:
        """Write the key's file: from now on the server is polled."""
        content = {"host": _HOST, "port": self.port, "token": self._token, "process": os.getpid()}
        try:
            _write(self.path, content)
        except OSError as error:
            self.close()
            raise StudyServerError(f"cannot write '{self.path}': {error.strerror or error}") from error
        return self

    def __exit__(self, *exception: object) -> None:
        with contextlib.suppress(OSError):
            self.path.unlink()
        self.close()

    def close(self) -> None:
        """Disconnect all callers, and stop listening."""
        for caller in list(self.callers):
            self._hang_up(caller)
        self._events.close()
        self._listener.close()

    def look(self, rest: float = 0.0) -> Request | None:
        """Read what has come and send what waits, and return a request if there is one.

        Parameters
        ----------
        rest
            How long to wait for something to come [s].
        """
        if any(not caller.busy and b"\n" in caller.coming for caller in self.callers):
            rest = 0.0
        for entry, _ in self._events.select(rest):
            if entry.fileobj is self._listener:
                self._let_in()
            else:
                self._hear(entry.data)
        for caller in list(self.callers):
            if caller.going:
                self._send(caller)
            if not caller.known and time.monotonic() - caller.since > PATIENCE:
                self._hang_up(caller)
        for caller in self.callers:
            request = self._taken(caller)
            if request is not None:
                self.callers.remove(caller)  # next time the others come first
                self.callers.append(caller)
                return request
        return None

    def answer(self, request: Request, **content: Any) -> None:
        """Answer a request; the answer contains the request's ``id``, if it has one."""
        caller = request.caller
        caller.busy = False
        if "id" in request.given:
            content = {"id": request.given["id"], **content}
        self._say(caller, content)

    def refuse(self, request: Request, code: str, sentence: str) -> None:
        """Answer that a request can't be carried out, and why."""
        self.answer(request, error={"code": code, "message": sentence})

    def _say(self, caller: Caller, content: dict[str, Any]) -> None:
        if caller.gone:
            return
        caller.going += json.dumps(content, separators=(",", ":"), allow_nan=False).encode() + b"\n"
        self._send(caller)

    def _let_in(self) -> None:
        with contextlib.suppress(OSError):
            line, _ = self._listener.accept()
            line.setblocking(False)
            if len(self.callers) >= MOST and not self._make_room():
                line.close()
                return
            with contextlib.suppress(OSError):
                line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            caller = Caller(line, time.monotonic())
            self.callers.append(caller)
            self._events.register(line, selectors.EVENT_READ, caller)

    def _make_room(self) -> bool:
        """Disconnect the caller without a key that has been here longest, so that such callers do not keep others out.

        Tell whether there was one.
        """
        strangers = [caller for caller in self.callers if not caller.known]
        if strangers:
            self._hang_up(min(strangers, key=lambda caller: caller.since))
        return bool(strangers)

    def _hear(self, caller: Caller) -> None:
        if len(caller.coming) >= LONGEST:
            # A line without an end.  Of a caller who is not answered yet all is read that comes: its end stands behind
            # what it has sent, and one that has gone must neither keep its place nor let time go on for it.
            too_much = len(caller.coming) >= BACKLOG if caller.busy else b"\n" not in caller.coming
            if too_much:
                self._hang_up(caller)
            if too_much or not caller.busy:
                return
        try:
            piece = caller.line.recv(LONGEST)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            piece = b""
        if not piece:
            self._hang_up(caller)
        caller.coming += piece

    def _send(self, caller: Caller) -> None:
        try:
            while caller.going:
                sent = caller.line.send(caller.going[:LONGEST])
                del caller.going[:sent]
        except (BlockingIOError, InterruptedError):
            if len(caller.going) > BACKLOG:
                self._hang_up(caller)
        except OSError:
            self._hang_up(caller)

    def _hang_up(self, caller: Caller) -> None:
        if caller.gone:
            return
        caller.gone = True
        self.callers.remove(caller)
        with contextlib.suppress(KeyError, ValueError):
            self._events.unregister(caller.line)
        caller.line.close()

    def _taken(self, caller: Caller) -> Request | None:
        """Return a caller's next request; the first line is the key."""
        end = caller.coming.find(b"\n")
        if caller.busy or end < 0:
            return None
        if end > LONGEST:
            self._hang_up(caller)
            return None
        text = bytes(caller.coming[:end])
        del caller.coming[: end + 1]
        try:
            given = json.loads(text)
        except (ValueError, RecursionError):
            given = None
        if not caller.known:
            self._admit(caller, given)
            return None
        if not isinstance(given, dict) or not isinstance(given.get("do"), str) or not _comes_back(given.get("id", "")):
            said = 'a line is JSON: {"do": WORD, ...}; an "id" is a text or a number'
            self._say(caller, {"error": {"code": "bad-line", "message": said}})
            return None
        caller.busy = True
        return Request(caller, given["do"], given)

    def _admit(self, caller: Caller, given: Any) -> None:
        told = given.get("token") if isinstance(given, dict) else None
        # JSON may contain half of a surrogate pair, which can't be encoded as UTF-8
        if isinstance(told, str) and hmac.compare_digest(told.encode(errors="replace"), self._token.encode()):
            caller.known = True
            self._say(caller, {"itouch": LINES})
            return
        said = f"the first line is the key: {{\"token\": ...}}, as it stands in '{self.path.name}'"
        self._say(caller, {"error": {"code": "no-key", "message": said}})
        self._hang_up(caller)


def _comes_back(number: Any) -> bool:
    """Tell whether a caller's ``id`` can be returned in an answer: JSON has no NaN, and nesting has a limit."""
    return isinstance(number, str | int) or (isinstance(number, float) and math.isfinite(number))


def _answers(path: Path) -> bool:
    """Tell whether a program listens at the address in a key's file."""
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        socket.create_connection((_HOST, int(told["port"])), timeout=1.0).close()
    except (OSError, ValueError, TypeError, KeyError, OverflowError):
        return False
    return True


def _write(path: Path, content: dict[str, Any]) -> None:
    """Write a file that only this user can read, completely or not at all."""
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as stream:
            json.dump(content, stream)
        os.replace(draft, path)
    except OSError:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise
