"""A machine that is short of memory, files or a folder: one sentence, no traceback."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest
from program import program
from shipped import SCENES

import itouch_tools.cli
from itouch.servo import guardian_link
from itouch.session import is_session

FIRST = str(SCENES / "first_touch.xml")


def test_memory_that_runs_out_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def run_out(words: list[str]) -> int:
        raise MemoryError

    monkeypatch.setattr(itouch_tools.cli, "_dispatch", run_out)
    done = program("check", FIRST)
    assert done.returncode == 2
    assert done.stderr.startswith("error: memory has run out\n")


@pytest.mark.skipif(os.name != "posix", reason="limits of a process are those of POSIX")
@pytest.mark.parametrize(
    ("limit", "value", "said"),
    [
        (
            "RLIMIT_FSIZE",
            40_000,
            "error: no file may be as large as is needed\n  = help: raise the limit (ulimit -f)\n",
        ),
        ("RLIMIT_NOFILE", 8, "error: too many files are open\n  = help: raise the limit (ulimit -n)\n"),
    ],
)
def test_a_limit_of_the_system_that_is_met_is_told(limit: str, value: int, said: str, tmp_path: Path) -> None:
    code = (
        f"import resource, sys; resource.setrlimit(resource.{limit}, ({value},) * 2);"
        "from itouch_tools.cli import main; sys.exit(main())"
    )
    words = [sys.executable, "-c", code, FIRST, "--for", "50ms", "--record", str(tmp_path / "r.mcap")]
    done = subprocess.run(words, capture_output=True, text=True, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"})
    assert done.returncode == 2, done.stderr
    assert done.stderr.endswith(said), done.stderr


def test_a_thread_that_can_not_be_started_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python has no error of its own for it, and gives no number."""
    words = iter(["can't start new thread", "another"])

    def refused(*_: object) -> int:
        raise RuntimeError(next(words))

    monkeypatch.setattr(itouch_tools.cli, "_dispatch", refused)
    done = program("check", FIRST)
    assert done.returncode == 2
    assert done.stderr.startswith("error: no more threads can be started, or processes\n")
    with pytest.raises(RuntimeError, match="another"):
        program("check", FIRST)


def test_a_part_of_the_program_that_is_missing_is_told_and_no_other_module(monkeypatch: pytest.MonkeyPatch) -> None:
    """While the program is upgraded in place, its files are replaced one after the other."""

    def missing(words: list[str]) -> int:
        raise ModuleNotFoundError(f"No module named '{name}'", name=name)

    monkeypatch.setattr(itouch_tools.cli, "_dispatch", missing)
    name = "itouch.servo.error_transport"
    done = program("check", FIRST)
    assert done.returncode == 2
    assert done.stderr.startswith("error: a part of the program is missing (itouch.servo.error_transport)\n")
    name = "another"
    with pytest.raises(ModuleNotFoundError):
        program("check", FIRST)


@pytest.mark.parametrize("words", ["check --json {scene} -o {out}", "safety-report {scene} -o {out}", "report {session} -o {out}",
                                   "bench sessions --scene {scene} --json {out}"])  # fmt: skip
@pytest.mark.parametrize(
    ("number", "why"), [(errno.ENOSPC, "No space left on device"), (errno.EIO, "Input/output error")]
)
def test_a_disk_that_refuses_leaves_the_earlier_file_and_is_told(
    words: str, number: int, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The earlier page or table was empty afterwards, and some commands ended with a traceback."""
    session, out = tmp_path / "s.itouch", tmp_path / "out.html"
    assert (
        program("run", FIRST, "--for", "0.01", "--headless", "--pace", "fast", "--save", str(session)).returncode == 0
    )
    out.write_text("earlier")
    monkeypatch.setattr("itouch_evidence.sessions.measure", lambda _: [])

    def refused(handle: int) -> None:
        raise OSError(number, why)

    monkeypatch.setattr(os, "fsync", refused)
    done = program(*words.format(scene=FIRST, session=session, out=out).split())
    assert done.returncode == 2
    assert done.stderr.endswith(f"cannot write '{out}': {why}\n")
    assert out.read_text() == "earlier"
    assert {one.name for one in tmp_path.iterdir()} == {"s.itouch", "out.html"}


def test_a_current_folder_that_was_removed_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def looks(words: list[str]) -> int:
        (tmp_path / "gone").rmdir()
        return len(os.getcwd())

    (tmp_path / "gone").mkdir()
    monkeypatch.setattr(itouch_tools.cli, "_dispatch", looks)
    done = program("check", FIRST, cwd=tmp_path / "gone")
    assert done.returncode == 2
    assert done.stderr.startswith("error: the current folder has been removed\n")


def test_a_session_whose_processes_can_not_be_started_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(guardian_link.os, "pipe", refused)
    done = program(FIRST, "--headless", "--pace", "real", "--for", "0.1s")
    assert done.returncode == 2
    assert done.stderr == "cannot start the session's processes: Too many open files\n"


def test_asking_whether_a_scene_is_a_session_takes_no_more_memory_than_the_scene() -> None:
    tracemalloc.start()
    try:
        assert not is_session(FIRST)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()
