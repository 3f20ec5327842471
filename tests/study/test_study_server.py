"""Serving a study, step by step in this process: who reads slowly, and what an enabling re-arms."""

from __future__ import annotations

import json
import socket
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from itouch.loop import LatchedError, Status
from itouch_tools.study.rig_session import RigSession
from itouch_tools.study.server import BACKLOG, LONGEST, MOST, Caller, Request, StudyServer


class Slow:
    """A line whose other end takes so many bytes, and no more."""

    def __init__(self, room: int) -> None:
        self.room, self.closed = room, False

    def send(self, data: bytes) -> int:
        if not self.room:
            raise BlockingIOError
        taken = min(self.room, len(data))
        self.room -= taken
        return taken

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize(("waiting", "room", "gone"), [(1000, 600, False), (BACKLOG + 600, 600, False),
                                                       (BACKLOG + 601, 600, True)])  # fmt: skip
def test_who_reads_slowly_is_waited_for_until_too_much_waits(
    waiting: int, room: int, gone: bool, tmp_path: Path
) -> None:  # fmt: skip
    server, line = StudyServer(tmp_path / "key.json"), Slow(room)
    caller = Caller(line, 0.0, known=True, going=bytearray(waiting))  # type: ignore[arg-type]
    server.callers.append(caller)
    server._send(caller)
    assert (caller.gone, line.closed, caller in server.callers) == (gone, gone, not gone)
    assert len(caller.going) == waiting - room
    server.close()


def _busy(server: StudyServer, then: bytes) -> tuple[socket.socket, Request]:
    """Return a line whose caller has asked for a wait that is not over, and has sent ``then`` behind it."""
    line = socket.create_connection(("127.0.0.1", server.port), timeout=60.0)
    line.sendall(json.dumps({"token": json.loads(server.path.read_text())["token"]}).encode() + b"\n")
    line.sendall(b'{"do":"wait","seconds":3600}\n' + then)
    request = _looked(server, lambda found: found is not None)
    assert request is not None
    return line, request


def _looked(server: StudyServer, so: Any) -> Request | None:
    """Look at the server until what it returns is ``so``, 60 s at most."""
    end = time.monotonic() + 60.0
    while not so(found := server.look(0.01)):
        assert time.monotonic() < end
    return found


def test_who_goes_while_it_waits_is_noticed_whatever_it_had_sent_behind(tmp_path: Path) -> None:
    """Such callers kept their places, so that nobody else came in, and time went on for them."""
    with StudyServer(tmp_path / "key.json") as server:
        for _ in range(MOST):
            line, _ = _busy(server, b'{"do":"now"}\n' * 7000)  # more than is read before it is answered
            line.close()
        _looked(server, lambda found: not server.callers)
        line, _ = _busy(server, b"")
        assert len(server.callers) == 1
        line.close()


def test_what_stands_behind_a_wait_is_answered_after_it(tmp_path: Path) -> None:
    many = 7000
    with StudyServer(tmp_path / "key.json") as server:
        line, request = _busy(server, b"".join(b'{"do":"now","id":%d}\n' % number for number in range(many)))
        with line, line.makefile("rb") as stream:
            _looked(server, lambda found: len(request.caller.coming) > LONGEST)
            server.answer(request, met=False)
            for _ in range(many):
                asked = _looked(server, lambda found: found is not None)
                assert asked is not None
                server.answer(asked)
            answers = [json.loads(stream.readline()) for _ in range(many + 2)]
        assert [told.get("id") for told in answers] == [None, None, *range(many)]


def test_a_line_that_is_too_long_is_hung_up_on_though_its_caller_waits(tmp_path: Path) -> None:
    with StudyServer(tmp_path / "key.json") as server:
        line, request = _busy(server, b'{"do":"now","x":"' + b"y" * LONGEST + b'"}\n')
        with line:
            _looked(server, lambda found: len(request.caller.coming) > LONGEST)
            server.answer(request, met=False)
            assert _looked(server, lambda found: not server.callers) is None


def test_who_sends_too_much_behind_a_wait_is_hung_up_on(tmp_path: Path) -> None:
    with StudyServer(tmp_path / "key.json") as server:
        line, request = _busy(server, b"")
        with line:
            request.caller.coming += b"\n" * BACKLOG
            line.sendall(b"\n")
            _looked(server, lambda found: not server.callers)


class Latched:
    """A session that can be enabled, unless something in it has tripped."""

    def __init__(self, latched: bool, *devices: tuple[bool, Status]) -> None:
        self.latched, self.rearmed = latched, 0
        self.runners = [
            SimpleNamespace(model=SimpleNamespace(twin=twin), latch=SimpleNamespace(status=status))
            for twin, status in devices
        ]

    def enable(self) -> None:
        if self.latched:
            raise LatchedError("arm: K1")

    def rearm(self) -> None:
        self.rearmed += 1


@pytest.mark.parametrize(
    ("latched", "devices", "rearmed"),
    [
        (False, [(True, Status.ENABLED), (False, Status.ENABLED)], 0),
        (True, [(False, Status.ENABLED)], 1),
        (False, [(True, Status.FAULT), (False, Status.ENABLED)], 1),  # a twin beside hardware
        (False, [(True, Status.ENABLED), (False, Status.FAULT)], 0),
    ],
)
def test_enabling_rearms_what_has_tripped_and_nothing_else(
    latched: bool, devices: list[tuple[bool, Status]], rearmed: int
) -> None:
    session = Latched(latched, *devices)
    held: Any = SimpleNamespace(session=session)
    RigSession._enable(held)
    assert session.rearmed == rearmed
