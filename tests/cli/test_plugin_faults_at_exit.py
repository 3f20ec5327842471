"""What a plugin does to the end of a run on twins: none ends with 0 unless it has finished, and all end soon."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import campaign
import pytest
from shipped import SCENES
from third_party_plugins import install

from itouch.process_exit import LONGEST

PLUGIN = """
import atexit, builtins, ctypes, io, json, logging, os, signal, sys, threading, time, zipfile
from dataclasses import dataclass
from itouch.plugin import Modality

@dataclass(frozen=True, slots=True)
class Nothing:
    "Nothing to set."

class Evil(Modality):
    "Does wrong, once."
    Params = Nothing
    def compile(self, name, params, world):
        return params
    def reset(self, model, state):
        pass
    def update(self, model, state, period):
        if int(state["tick"]) == 30:
            act()

def act():
{act}
"""
#: Line of the plugin's file in which an act begins.
LINE = 22
PROGRAM = "from itouch_tools.cli import main; raise SystemExit(main())"
Ended = tuple[int, str, str, dict[str, Any] | None, float]


def run(folder: Path, act: str, pace: str = "fast") -> Ended:
    """Run 0.1 s beside this act; return exit code, what was said and complained of, the report and the time [s]."""
    text = "\n".join(f"    {line}" for line in act.splitlines())
    install(folder, "evil", "[itouch.modalities]\nevil.it = evil:Evil\n", code=PLUGIN.format(act=text))
    text = (SCENES / "first_touch.xml").read_text(encoding="utf-8")
    text = text.replace("<itouch ", '<itouch xmlns:evil="urn:itouch:plugin:evil" ', 1)
    (folder / "scene.xml").write_text(text.replace("</interaction>", '<evil:it name="evil"/></interaction>'))
    report, begin = folder / "report.json", time.monotonic()
    words = ["run", "scene.xml", "--headless", "--pace", pace, "--for", "0.1 s", "--report", str(report)]
    path = os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", "")))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *words, "--save", "s.itouch"], capture_output=True, text=True, timeout=600,
        check=False, cwd=folder, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    told = json.loads(report.read_text(encoding="utf-8")) if report.exists() else None
    return done.returncode, done.stdout, done.stderr, told, time.monotonic() - begin


@pytest.mark.parametrize(
    ("act", "what"),
    campaign.some([
        ("os._exit(0)", "os._exit(0)"), ("import posix\nposix._exit(3)", "os._exit(3)"),
        ("os.execlp('true', 'true')", "os.execv("), ("os.execve('/bin/true', ['true'], {{}})", "os.execve("),
    ], lambda one: one[0] == "os._exit(0)"),
)  # fmt: skip
def test_who_ends_the_program_at_once_is_refused_and_named(tmp_path: Path, act: str, what: str) -> None:
    """It ended with exit code 0, without a report and without a word."""
    code, said, complained, report, _ = run(tmp_path, act.replace("{{", "{").replace("}}", "}"))
    assert code == 1, complained
    assert report is not None and "ended_by" not in report
    (fault,) = report["faults"]
    assert "has lost its modality 'evil', which failed in update: " in fault["cause"]
    assert what in fault["cause"] and "was refused: a plugin does not end the program (" in fault["cause"]
    assert fault["cause"].endswith(f"(evil.py, line {LINE + act.count(chr(10))})") or "exec" in act
    assert fault["cause"] in said and "Traceback" not in complained


def test_a_thread_that_ends_the_program_at_once_is_refused_and_the_run_goes_on(tmp_path: Path) -> None:
    code, said, complained, report, _ = run(
        tmp_path, "one = threading.Thread(target=lambda: os._exit(0))\none.start()\none.join()"
    )
    assert code == 0, complained
    assert "0.100 s simulated" in said
    assert report is not None and report["faults"] == []
    assert complained == f"note: os._exit(0) was refused: a plugin does not end the program (evil.py, line {LINE})\n"


def test_processes_that_a_plugin_begins_end_as_they_like(tmp_path: Path) -> None:
    act = "child = os.fork()\nif not child:\n  os._exit(3)\nassert os.waitpid(child, 0)[1] >> 8 == 3"
    code, _, complained, _, _ = run(tmp_path, act)
    assert (code, complained) == (0, "")


@pytest.mark.parametrize("act", ["os.kill(os.getpid(), signal.SIGKILL)", "ctypes.CDLL(None)._exit(0)"])
def test_what_nothing_inside_can_refuse_leaves_a_report_that_is_not_whole(tmp_path: Path, act: str) -> None:
    _, _, _, report, _ = run(tmp_path, act)
    assert report is not None
    assert report["ended_by"].startswith("the program was ended before it had finished")


def test_a_function_at_the_end_does_not_change_the_exit_code(tmp_path: Path) -> None:
    code, said, complained, _, _ = run(tmp_path, "atexit.register(os._exit, 0)\nraise ValueError")
    assert (code, complained) == (1, "")
    assert "saved s.itouch" in said


#: What a plugin may take away, and what is said of it.
TAKEN = [
    ("os.close(1)", "'file 1'"), ("os.close(2)", "'file 2'"), ("os.closerange(0, 3)", "'file 0', 'file 1', 'file 2'"),
    ("sys.stdout.close()", "'sys.stdout'"), ("sys.stderr = None", "'sys.stderr'"),
    ("json.dumps = None", "'json.dumps'"), ("json.JSONEncoder = None", "'json.JSONEncoder'"),
    ("json.JSONEncoder.iterencode = None", "'JSONEncoder.iterencode'"), ("os.write = None", "'os.write'"),
    ("zipfile.ZipFile = None", "'zipfile.ZipFile'"), ("del io.BytesIO", "'io.BytesIO'"),
]  # fmt: skip


@pytest.mark.parametrize("pace", ["fast", "real"])
@pytest.mark.parametrize(
    ("act", "what"), campaign.some(TAKEN, lambda one: one[0] in ("os.close(1)", "json.dumps = None"))
)
def test_what_the_end_of_a_run_needs_is_put_back_and_told_as_a_fault(
    tmp_path: Path, act: str, what: str, pace: str
) -> None:
    """There was a traceback, and no report."""
    code, said, complained, report, _ = run(tmp_path, act, pace)
    assert code == 1, complained
    assert "Traceback" not in complained
    assert report is not None
    (fault,) = report["faults"]
    assert re.search(rf"a plugin had replaced( or closed)? {what} for the whole Python process", fault["cause"])
    assert fault["safe"]["reached"]
    assert fault["cause"] in said and "saved s.itouch" in said
    assert (tmp_path / "s.itouch").exists()


def test_all_files_closed_leave_a_report_and_an_exit_code(tmp_path: Path) -> None:
    code, _, _, report, _ = run(tmp_path, "os.closerange(0, 1024)")
    assert code == 1
    assert report is not None and "'file 1'" in report["faults"][0]["cause"]


@pytest.mark.parametrize("act", ["json.dumps = lambda *a, **k: 1 / 0", "builtins.print = lambda *a, **k: 1 / 0"])
def test_what_was_replaced_by_something_else_is_put_back(tmp_path: Path, act: str) -> None:
    """Another function may do the same and more: that is no fault, but the end of a run does without it."""
    code, said, complained, report, _ = run(tmp_path, act)
    assert (code, complained) == (0, "")
    assert report is not None and report["faults"] == [] and "saved s.itouch" in said


@pytest.mark.parametrize(
    "act",
    campaign.some([
        "class Left:\n  def __del__(self):\n    time.sleep(900)\none = Left()\none.me = one",
        "import gc\ngc.callbacks.append(lambda *a: time.sleep(900))",
    ], lambda one: "Left" in one),
)  # fmt: skip
def test_what_is_left_in_garbage_is_not_taken_apart_at_the_end(tmp_path: Path, act: str) -> None:
    """The interpreter did, when no thread ran any more that could end it: the guardian came after 90 s."""
    code, said, complained, report, took = run(tmp_path, act, "real")
    assert code == 0, complained
    assert "0.100 s simulated" in said
    assert report is not None and report["faults"] == []
    assert took < 600.0


@pytest.mark.parametrize(
    ("act", "what", "pace"),
    campaign.some([
        ("def wait():\n  time.sleep(900)\natexit.register(wait)", r"\(evil\.py, line 23\)", "fast"),
        ("atexit.register(time.sleep, 900)", r"\(registered with atexit, or holding a lock\)", "fast"),
        ("atexit.register(time.sleep, 900)", r"\(registered with atexit, or holding a lock\)", "real"),
        ("one = logging.StreamHandler()\nlogging.getLogger().addHandler(one)\n"
         "threading.Thread(target=lambda: (one.acquire(), time.sleep(900)), daemon=True).start()",
         r"\(registered with atexit, or holding a lock\)", "fast"),
        ("threading.Thread(target=lambda: (threading._active_limbo_lock.acquire(), time.sleep(900)), daemon=True).start()\n"
         "time.sleep(0.1)", r"\(registered with atexit, or holding a lock\)", "fast"),
        ("threading.Thread(target=time.sleep, args=(900,), name='listener').start()", r"\(thread 'listener'\)", "real"),
    ], lambda one: "wait" in one[0] or one[2] == "real"),
)  # fmt: skip
def test_what_is_left_for_the_end_is_not_waited_for(tmp_path: Path, act: str, what: str, pace: str) -> None:
    """The program went on for as long as that did."""
    code, said, complained, report, took = run(tmp_path, act, pace)
    assert code == 0, complained
    assert "0.100 s simulated" in said
    assert report is not None and report["faults"] == []
    assert re.search(
        f"note: what a plugin has left {what} does not end; all work is done, so the program ends anyway",
        complained,
    )
    assert LONGEST < took < 600.0
