"""Serving a study, step by step in this process: who reads slowly, and what an enabling re-arms."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from itouch.loop import LatchedError, Status
from itouch_tools.study.rig_session import RigSession
from itouch_tools.study.server import BACKLOG, Caller, StudyServer


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
