"""The disk fails while a recording is written: what came before is readable, and the message names file and cause."""

from __future__ import annotations

import errno
import os
import resource
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from campaign import size, tell
from made import rows_of, track
from shipped import SCENES

import itouch
from itouch.recording.chunking import message
from itouch.recording.reader import read_content
from itouch.recording.sink import Sink
from itouch.recording.spec import Spec
from itouch.recording.writer import McapWriter

CHUNKS, ROWS = 210, 5


class Failing(Sink):
    """Fails, writes less, or dies in the middle, at its n-th write."""

    def __init__(self, path: str, number: int, kind: str) -> None:
        super().__init__(path)
        self.left, self.kind = number, kind

    def put(self, view: memoryview) -> int:
        self.left -= 1
        if self.left != 0:
            return super().put(view)
        if self.kind == "short":
            return super().put(view[: max(1, len(view) // 3)])
        super().put(view[: len(view) // 2])  # some of it may be on the disk
        if self.kind == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        raise OSError(getattr(errno, self.kind), os.strerror(getattr(errno, self.kind)))


def write(sink: Sink) -> int:
    """Write a recording chunk by chunk; return how many rows were written before the disk failed."""
    one = track()
    spec = Spec((one,), {}, {}, 1e-3, 0, {"manifest": {}, "layout": []}, {})
    writer = McapWriter(sink, (one,), start_ns=0, period=1e-3)
    done = 0
    try:
        writer.start({})
        writer.chunk({}, [("/log/session", 0, spec.first_message())])
        for index in range(CHUNKS):
            writer.chunk({one.name: rows_of(one, index * ROWS, ROWS)}, [("/log/marks", 0, message(0, 1e-3, name="m"))])
            done += ROWS
        writer.finish()
    except OSError:
        sink.close()
        return done
    sink.close()
    return done


def expected(count: int) -> bytes:
    blocks = [rows_of(track(), begin, ROWS) for begin in range(0, count, ROWS)]
    return np.concatenate(blocks).tobytes() if blocks else b""


@pytest.mark.campaign
@pytest.mark.parametrize("kind", ["ENOSPC", "EIO", "short", "kill"])
def test_the_nth_write_fails(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    for number in range(1, 201, size(29, 1)):
        if kind == "kill":
            child = os.fork()
            if child == 0:
                write(Failing(str(path), number, kind))
                os._exit(0)
            assert os.WIFSIGNALED(os.waitpid(child, 0)[1])
            done = max(0, (number - 3) * ROWS)
        else:
            done = write(Failing(str(path), number, kind))
        if number <= 2 and kind != "short":
            with pytest.raises(itouch.RecordingError, match=r"r\.mcap"):
                itouch.read(path)
            continue
        content = read_content(str(path))
        assert content.rows["probe"].tobytes() == expected(done)
        assert content.whole == (kind == "short")
        assert bool(content.losses) == (kind != "short")
    tell(f"{kind} at each of the first 200 writes: all that was written before is read")


def test_a_disk_that_fills_up_while_recording(tmp_path: Path) -> None:
    """The limit is set on the writing process itself: the loop goes on, and a fault names file and cause."""
    session = itouch.build(SCENES / "first_touch.xml")
    recorder = session.record(tmp_path / "r.mcap")
    session.run(0.5)
    deadline = time.monotonic() + 300.0
    while len(itouch.read(tmp_path / "r.mcap").ticks) < 500 and time.monotonic() < deadline:
        time.sleep(0.05)
    full = recorder.written + 10_000
    resource.prlimit(recorder.process_id, resource.RLIMIT_FSIZE, (full, full))
    while not session.report()["faults"] and time.monotonic() < deadline:
        session.run(0.5)
        time.sleep(0.1)
    before = int(session.state["tick"])
    session.run(0.2)
    fault = session.report()["faults"][0]
    assert (fault["device"], fault["trip"]) == ("recorder", "recording")
    assert fault["cause"] == f"cannot write '{tmp_path / 'r.mcap'}': File too large"
    assert int(session.state["tick"]) == before + 200
    session.close()
    recording = itouch.read(tmp_path / "r.mcap")
    assert len(recording.ticks) >= 500
    assert np.array_equal(recording.ticks, np.arange(len(recording.ticks)))
    assert not recording.whole


@pytest.mark.parametrize("replaced", [False, True])
def test_a_file_that_is_removed_while_recording_is_a_loss_that_is_told(replaced: bool, tmp_path: Path) -> None:
    """What is written from then on belongs to no name: all of it is gone when the file is closed."""
    path = tmp_path / "r.mcap"
    session = itouch.build(SCENES / "first_touch.xml")
    session.record(path)
    session.run(0.2)
    path.unlink()
    if replaced:
        path.write_text("of somebody else")
    deadline = time.monotonic() + 300.0
    while not session.report()["faults"] and time.monotonic() < deadline:
        session.run(0.2)
        time.sleep(0.05)
    fault = session.report()["faults"][0]
    assert (fault["device"], fault["trip"]) == ("recorder", "recording")
    assert fault["cause"] == f"cannot write '{path}': the file was removed or replaced while it was being written"
    session.close()
    assert path.exists() == replaced


def test_a_file_that_is_removed_just_before_the_end_is_told_when_the_session_is_closed(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    session.record(tmp_path / "r.mcap")
    session.run(0.1)
    (tmp_path / "r.mcap").unlink()
    with pytest.raises(itouch.RecordingError, match=r"r\.mcap.*removed or replaced"):
        session.close()
