"""Signals in the first instants of a program: said in one sentence, whatever is being imported meanwhile."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from program import program
from shipped import SCENES

from itouch.session import Session
from itouch_tools.cli.shutdown import Stopping

FIRST = str(SCENES / "first_touch.xml")
STARTED = "stopped by SIGINT during the start; nothing was enabled\n"
#: Runs the program with a part of it replaced, in a process of its own as it handles signals.
PROGRAM = """
import os, signal, sys
import itouch_tools.cli as cli

def interrupted(*words):
    {what}

cli.{part} = interrupted
sys.argv = ["itouch-py", "check", "x.xml"]
sys.exit(cli.main())
"""
BROKEN_IMPORT = """
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except KeyboardInterrupt:
        raise {error}("cannot import name 'x' from partially initialized module 'y'") from None
"""


@pytest.mark.parametrize(
    ("part", "what"),
    [
        ("_need_streams", "os.kill(os.getpid(), signal.SIGINT)"),
        ("_dispatch", BROKEN_IMPORT.format(error="ImportError")),
        ("_dispatch", BROKEN_IMPORT.format(error="AttributeError")),
        ("_dispatch", BROKEN_IMPORT.format(error="OSError")),
    ],
)
def test_an_interrupt_is_no_traceback_whatever_an_import_makes_of_it(part: str, what: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(part=part, what=what)], capture_output=True, text=True, timeout=300
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


def test_an_error_without_an_interrupt_stays_one() -> None:
    script = PROGRAM.format(part="_dispatch", what="raise ImportError('a bug')")
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    assert done.returncode == 1
    assert "ImportError: a bug" in done.stderr


#: What asks a command to end, besides Ctrl-C.
ENDING = [name for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
HALF = """
    from itouch.schema.durable import replacing
    with replacing({path!r}) as part:
        try:
            os.kill(os.getpid(), signal.{name})
        finally:
            os.kill(os.getpid(), signal.{name})
            open(part + ".seen", "w").close()
"""


@pytest.mark.parametrize("name", ["SIGINT", *ENDING])
def test_a_command_that_is_asked_to_end_removes_what_is_half_written_even_if_it_is_asked_twice(
    name: str, tmp_path: Path
) -> None:
    """A terminal that is closed sends SIGHUP, and its shell does, too; `timeout`, a cluster and systemd send SIGTERM."""
    script = PROGRAM.format(part="_dispatch", what=HALF.format(path=str(tmp_path / "t.csv"), name=name))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    by = "" if name == "SIGINT" else f" by {name}"
    assert (done.returncode, done.stdout, done.stderr) == (128 + getattr(signal, name), "", f"interrupted{by}\n")
    (seen,) = tmp_path.iterdir()
    assert seen.suffix == ".seen"


def test_a_command_that_ends_in_order_when_it_is_asked_to_says_by_what_it_was_ended() -> None:
    what = """
    try:
        os.kill(os.getpid(), signal.{name})
    except KeyboardInterrupt:
        return 0
    """
    for name, code in (("SIGINT", 0), ("SIGTERM", 143)):
        script = PROGRAM.format(part="_dispatch", what=what.format(name=name))
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
        assert (done.returncode, done.stderr) == (code, "")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system forks no processes")
def test_a_process_that_a_command_has_forked_is_ended_as_any_other() -> None:
    what = """
    child = os.fork()
    if child == 0:
        os.kill(os.getpid(), signal.SIGTERM)
        os._exit(3)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGTERM
    return 0
    """
    script = PROGRAM.format(part="_dispatch", what=what)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="this system has no SIGHUP")
def test_nohup_keeps_a_command_from_ending_with_its_terminal() -> None:
    script = PROGRAM.format(part="_dispatch", what="os.kill(os.getpid(), signal.SIGHUP); return 0")
    ignoring = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
    done = subprocess.run([sys.executable, "-c", ignoring + script], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_second_signal_during_the_start_does_not_take_the_report_of_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from itouch.servo import prepare
    from itouch_tools.cli import shutdown

    write = shutdown.write_report

    def asked(*words: Any, **named: Any) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        write(*words, **named)

    monkeypatch.setattr(prepare, "prepare", lambda *words, **named: os.kill(os.getpid(), signal.SIGINT))
    monkeypatch.setattr(shutdown, "write_report", asked)
    done = program(FIRST, "--headless", "--report", str(tmp_path / "r.json"))
    assert (done.returncode, done.stdout, done.stderr) == (130, "", STARTED)
    assert json.loads((tmp_path / "r.json").read_text())["stopped_by"] == "SIGINT"


def test_a_run_answers_signals_before_it_imports_what_takes_long(tmp_path: Path) -> None:
    script = (
        "import sys, itouch_tools.cli.run\nfrom itouch_tools.cli.shutdown import unstarted\n"
        f"unstarted(2, {{}}, 0.0, {str(tmp_path / 'r.json')!r})\nassert 'numpy' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, STARTED)
    assert json.loads((tmp_path / "r.json").read_text())["stopped_by"] == "SIGINT"


@pytest.mark.parametrize("then", ["goes on", "raises"])
def test_a_signal_that_an_import_has_swallowed_still_ends_the_start(
    then: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from itouch.servo import prepare

    build = prepare.prepare

    def swallowing(*words: Any, **named: Any) -> Session:
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(20.0)
        except KeyboardInterrupt:
            if then == "raises":
                raise AttributeError("partially initialized module 'numba.core.types'") from None
        return build(*words, **named)

    monkeypatch.setattr(prepare, "prepare", swallowing)
    done = program(FIRST, "--headless", "--report", str(tmp_path / "r.json"), "--save", str(tmp_path / "s.itouch"))
    assert (done.returncode, done.stdout, done.stderr) == (130, "", STARTED)
    assert json.loads((tmp_path / "r.json").read_text())["stopped_by"] == "SIGINT"
    assert not (tmp_path / "s.itouch").exists()


@pytest.mark.parametrize("read", [True, False], ids=["read before", "not read yet"])
def test_a_signal_when_the_session_is_just_built_is_no_start_where_nothing_was_enabled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: bool
) -> None:
    """In real time the twins run from then on, before the program has taken note of it, or has read any State."""
    from itouch.servo.handle import Handle

    await_ready = Handle.await_ready

    def signalled(handle: Handle) -> None:
        await_ready(handle)
        while read and handle.seconds < 0.1:
            time.sleep(0.01)
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(20.0)

    monkeypatch.setattr(Handle, "await_ready", signalled)
    done = program(FIRST, "--headless", "--pace", "real", "--report", str(tmp_path / "r.json"))
    assert done.returncode == 130
    assert done.stderr.endswith("stopped by SIGINT; the devices are safe\n")
    told = json.loads((tmp_path / "r.json").read_text())
    assert told["simulated_s"] > 0.0
    assert "stopped_by" not in told


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="this system has no SIGHUP")
def test_nohup_keeps_a_run_from_ending_with_its_terminal() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Stopping() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert stop.unstarted == 0
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
