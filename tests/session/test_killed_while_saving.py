"""kill -9 at any instant and failing writes: a snapshot is the old or the new one, whole."""

from __future__ import annotations

import errno
import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from campaign import size, tell
from running import advance, digest
from shipped import SCENES

import itouch
from itouch.schema import durable
from itouch.schema.durable import write_whole
from itouch.session.snapshot import write_snapshot


@pytest.fixture(scope="module")
def packed() -> dict[int, bytes]:
    """Two snapshots of one run, by their ticks; and under 0 the digest of where it goes."""
    session = itouch.build(SCENES / "four_materials.xml", seed=6)
    found = {}
    for tick in (400, 800):
        advance(session, tick)
        found[tick] = session.pack()
    advance(session, 1000)
    found[0] = digest(session).encode()
    return found


def in_a_child(work: Callable[[], object]) -> int:
    """Do something in a child process; return how it ended."""
    child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)
    return os.waitpid(child, 0)[1]


def is_one_of_them(path: Path, packed: dict[int, bytes]) -> int:
    """Check that the file is the old or the new one, and return its tick."""
    data = path.read_bytes()
    ticks = [tick for tick in (400, 800) if packed[tick] == data]
    assert ticks, "the file is neither the old nor the new one"
    return ticks[0]


def resumes(path: Path, packed: dict[int, bytes]) -> None:
    session = itouch.restore(path)
    advance(session, 1000)
    assert digest(session).encode() == packed[0]


def points(packed: dict[int, bytes], folder: Path) -> list[str]:
    seen: list[str] = []
    write_whole(str(folder / "points"), packed[800], step=seen.append)
    return seen


@pytest.mark.campaign
def test_killed_at_every_write_point(packed: dict[int, bytes], tmp_path: Path) -> None:
    path, names = tmp_path / "s.itouch", points(packed, tmp_path)
    assert len(names) >= 40
    ticks = set()
    for number in sorted({*range(0, len(names), size(6, 1)), len(names) - 2, len(names) - 1}):
        path.write_bytes(packed[400])

        def die(where: str, left: list[int] = [number]) -> None:  # noqa: B006  # a counter of its own each time
            if left[0] == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left[0] -= 1

        ended = in_a_child(lambda die=die: write_whole(str(path), packed[800], step=die))
        assert os.WIFSIGNALED(ended)
        ticks.add(is_one_of_them(path, packed))
    assert ticks == {400, 800}
    resumes(path, packed)
    tell(
        f"killed at each of {len(names)} write points of a snapshot: the old or the new one, whole; resumes to the byte"
    )


@pytest.mark.campaign
def test_killed_at_random_instants(packed: dict[int, bytes], tmp_path: Path) -> None:
    path, generator, old = tmp_path / "s.itouch", random.Random(3), 0
    path.write_bytes(packed[400])

    def save_on_and_on() -> None:
        while True:
            for tick in (800, 400):
                write_whole(str(path), packed[tick])

    count = size(12, 500)
    for number in range(count):
        child = os.fork()
        if child == 0:
            save_on_and_on()
        time.sleep(generator.uniform(0.0, 0.03))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        old += is_one_of_them(path, packed) == 400
        if number % 50 == 0:
            resumes(path, packed)
    tell(
        f"killed at {count} random instants: {old} times the one, {count - old} times the other, always whole; resumes"
    )


@pytest.mark.campaign
@pytest.mark.parametrize("kind", ["ENOSPC", "EIO", "short"])
def test_the_nth_write_fails(
    kind: str, packed: dict[int, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Writes of several saves in a row are counted; the n-th fails."""
    real, path = os.write, tmp_path / "s.itouch"
    for number in range(1, 201, size(13, 1)):
        left = [number]

        def write(handle: int, data: memoryview, left: list[int] = left) -> int:
            left[0] -= 1
            if left[0] != 0:
                return real(handle, data)
            if kind == "short":
                return real(handle, data[: max(1, len(data) // 2)])
            raise OSError(getattr(errno, kind), os.strerror(getattr(errno, kind)))

        path.write_bytes(packed[400])
        monkeypatch.setattr(durable.os, "write", write)
        failed = ""
        try:
            for _ in range(5):
                write_snapshot(path, packed[800])
        except itouch.SessionError as error:
            failed = str(error)
        finally:
            monkeypatch.setattr(durable.os, "write", real)
        is_one_of_them(path, packed)
        assert sorted(p.name for p in tmp_path.iterdir()) == ["s.itouch"]
        if kind == "short":
            assert failed == ""
            assert path.read_bytes() == packed[800]
        else:
            assert failed == f"cannot save '{path}': {os.strerror(getattr(errno, kind))}"
    tell(f"{kind} at each of the first 200 writes: the earlier snapshot stays whole, the message names file and cause")


@pytest.mark.parametrize("call", ["fsync", "replace", "chmod"])
def test_other_calls_fail(call: str, packed: dict[int, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "s.itouch"
    path.write_bytes(packed[400])

    def fail(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(durable.os, call, fail)
    with pytest.raises(itouch.SessionError, match=f"cannot save '{path}': Input/output error"):
        write_snapshot(path, packed[800])
    assert is_one_of_them(path, packed) == 400
    assert sorted(p.name for p in tmp_path.iterdir()) == ["s.itouch"]
