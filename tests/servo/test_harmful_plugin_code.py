"""Code that harms the program from inside its process: what stops a device then, and who tells it.

The device here is hardware as far as the program knows: it writes each command that it is given into a file, with the
process that gave it.  Where nothing inside can help, what stands outside must: the guardian, by its second opener.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import campaign
import pytest
from punctuality import skip_unless_punctual
from third_party_plugins import install

from itouch.platforms import lives

PLUGIN = """
import builtins, ctypes, gc, os, signal, sys, threading, time
from dataclasses import dataclass
from itouch.plugin import Device, Modality, Opening, deadman, pose, wrench

@dataclass(frozen=True, slots=True)
class Nothing:
    "Nothing to set."

class Stick(Device):
    "An arm that stands in a block, held by somebody."
    Params = Nothing
    reads = (pose(), deadman())
    commands = (wrench(force=3.0),)
    opening = Opening(second_opener=True)
    count = 0
    def open(self):
        self.log("open")
    def close(self):
        self.log("close")
    def log(self, what):
        handle = os.open(FILE, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(handle, f"{{os.getpid()}} {{what}}\\n".encode())
        os.close(handle)
    def read(self, reading):
        self.count += 1
        reading["pose"] = (0, 0, 0.019 + 1e-6 * (self.count % 7), 1, 0, 0, 0)
        reading["deadman"] = 1.0
        return True
    def write(self, command):
        self.log(float(abs(command["wrench"]).max()))
    def make_safe(self, command):
        self.write(command)

def _address(state, field):
    view = state[field]
    return view.ctypes.data

class Evil(Modality):
    "Does wrong, once."
    Params = Nothing
    def compile(self, name, params, world):
        return params
    def reset(self, model, state):
        pass
    def update(self, model, state, period):
        if int(state["tick"]) == 300:
            self.act(state)
    def act(self, state):
{act}

FILE = {file!r}
"""
SCENE = """<itouch version="1.0" xmlns:evil="urn:itouch:plugin:evil">
  <materials><material name="m"><contact stiffness="300 N/m"/></material></materials>
  <world><box name="floor" size="100 100 20 mm" pos="0 0 10 mm" material="m"/></world>
  <devices><device name="stick" plugin="stick" twin="no"/></devices>
  <interaction><probe name="tip" radius="0" pose-from="stick" force-to="stick"/><evil:it name="evil"/></interaction>
</itouch>
"""
PROGRAM = "from itouch_tools.cli import main; raise SystemExit(main())"


Ran = tuple[subprocess.CompletedProcess[str], dict[str, Any] | None, list[list[str]]]


def run_in_time(folder: Path, act: str) -> Ran:
    """Run as `run` does, again if the machine left the process without a processor for so long that the guardian came."""
    for number in range(3):
        found = run(folder / str(number), act)
        if "hung (no beat" not in found[0].stderr:
            return found
    skip_unless_punctual(0.05)
    return found


def run(folder: Path, act: str) -> Ran:
    """Run the stick for a second beside this act; return what the program said, its report, and the device's log."""
    log, report = folder / "log", folder / "report.json"
    text = "\n".join(f"        {line}" for line in act.splitlines())
    listed = "[itouch.modalities]\nevil.it = evil:Evil\n[itouch.devices]\nstick = evil:Stick\n"
    install(folder, "evil", listed, code=PLUGIN.format(act=text, file=str(log)))
    (folder / "scene.xml").write_text(SCENE, encoding="utf-8")
    words = [str(folder / "scene.xml"), "--headless", "--for", "1 s", "--report", str(report)]
    path = os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", "")))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, "run", *words], capture_output=True, text=True, timeout=600, check=False,
        env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    told = json.loads(report.read_text(encoding="utf-8")) if report.exists() else None
    return done, told, [line.split() for line in log.read_text(encoding="utf-8").splitlines()]


def forces(log: list[list[str]]) -> list[float]:
    """Return the forces that the device was given, one after the other [N]."""
    return [float(what) for _, what in log if what not in ("open", "close")]


def test_without_harm_it_pushes_to_the_end(tmp_path: Path) -> None:
    done, report, log = run_in_time(tmp_path, "pass")
    assert done.returncode == 0, done.stderr
    assert report is not None and report["faults"] == []
    assert max(forces(log)) > 0.2 and len(forces(log)) > 900


#: Written over a status again and again, by a thread that nothing stops.
OVERWRITE = """
at = _address(state, "stick.status")
def go_on():
    while True:
        ctypes.memset(at, {}, 1)
        time.sleep(1e-4)
threading.Thread(target=go_on, daemon=True).start()
{}"""
REPLACED = ("isinstance", "len", "float", "bool", "type", "next", "BaseException")


#: What a plugin may do, and what is said of it; one of each kind is tried always.
ACTS = [
    *((f"builtins.{name} = None", f"a plugin had replaced '{name}' for the whole Python process") for name in REPLACED),
    ("builtins.min = lambda *a: 3.0", "a plugin had replaced 'min' for the whole Python process"),
    ("vars(builtins).clear()", "a plugin had replaced 'abs', "),
    ("vars(builtins).clear()\nraise ValueError", "a plugin had replaced 'abs', "),
    ("sys.setrecursionlimit(len(__import__('inspect').stack()) + 6)\nraise ValueError", "sys.setrecursionlimit"),
    ("raise KeyboardInterrupt", "KeyboardInterrupt (evil.py, line {}), in update of modality 'evil'"),
    ("def trace(*_):\n  raise ValueError('trace')\nsys.settrace(trace)", "ValueError: trace (evil.py, "),
    *(
        (f"class Odd(Exception):\n  {odd}\nraise Odd('x')", "'evil', which failed in update: Odd: ")
        for odd in (
            "__traceback__ = property(lambda self: 1 / 0)",
            "def __getattribute__(self, name): raise SystemExit(4)",
            "__str__ = None",
        )
    ),
    (
        "Meta = type('Meta', (type,), {{'__name__': property(lambda self: 1 / 0)}})\nraise Meta('Odd', (Exception,), {{}})('x')",
        "'evil', which failed in update: Odd: x",
    ),
    *((OVERWRITE.format(number, "raise ValueError('now')"), "ValueError: now") for number in (0, 1, 2, 99)),
    *((OVERWRITE.format(number, "pass"), "status") for number in (0, 1, 99)),
]  # fmt: skip
ALWAYS = (
    "builtins.isinstance",
    "builtins).clear()\nraise",
    "raise KeyboardInterrupt",
    "__getattribute__",
    "memset(at, 99, 1)",
)


@pytest.mark.parametrize(("act", "says"), campaign.some(ACTS, lambda act: any(part in act[0] for part in ALWAYS)))
def test_what_a_plugin_does_to_its_process_lets_go_of_the_finger_first_and_is_told(
    tmp_path: Path, act: str, says: str
) -> None:
    done, report, log = run_in_time(tmp_path, act.replace("{{", "{").replace("}}", "}"))
    assert forces(log)[-1] == 0.0
    assert log[-1][1] == "close"
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert report is not None
    (fault,) = report["faults"]
    assert says.partition("{}")[0] in fault["cause"]
    assert report["devices"]["stick"]["status"] in ("FAULT", "CLOSED")
    assert fault["cause"] in done.stdout.replace("\n", " ") or fault["cause"][:40] in done.stdout + done.stderr


@pytest.mark.parametrize("name", campaign.some(["print", "open", "__import__"], lambda name: name == "open"))
def test_what_only_the_end_of_a_run_needs_is_there_again_at_its_end(tmp_path: Path, name: str) -> None:
    done, report, log = run_in_time(tmp_path, f"builtins.{name} = None")
    assert done.returncode == 0, done.stderr
    assert report is not None and report["devices"]["stick"]["status"] == "CLOSED"
    assert forces(log)[-1] == 0.0
    assert log[-1][1] == "close"


@pytest.mark.parametrize(
    ("act", "says"),
    campaign.some([
        ("os._exit(0)", "the servo process ended with code 0; the servo process died; stick made safe by the guardian"),
        ("ctypes.string_at(0)", "was killed by SIGSEGV; the servo process died; stick made safe by the guardian"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "was killed by SIGKILL; the servo process died; stick made safe by"),
        ("time.sleep(1000)", r"the servo process hung \(no beat for \d+ ms\); stick made safe by the guardian"),
        ("import itouch.safety.lifecycle as all\nall.Lifecycle.close = None\n"
         "import itouch.safety.sequence as all\nall.SafeSequence.carry_out = None\nraise ValueError",
         "stick made safe by the guardian"),
    ], lambda act: act[0].startswith(("os._exit", "time.sleep"))),
)  # fmt: skip
def test_where_nothing_inside_the_process_can_help_the_guardian_does(tmp_path: Path, act: str, says: str) -> None:
    done, _, log = run(tmp_path, act)
    assert done.returncode == 1, done.stderr
    assert re.search(says, done.stderr)
    assert "Traceback" not in done.stderr
    (last, force), pushed = log[-1], next(who for who, what in log if what != "open")
    assert force == "0.0"
    assert last != pushed  # it was another process


def test_what_the_loop_can_not_give_its_safe_command_the_guardian_does(tmp_path: Path) -> None:
    """A driver that failed in `write` failed in the safe sequence, too: the last force stood when all had ended."""
    done, report, log = run_in_time(tmp_path, "Stick.write = lambda *a: 1 / 0")
    assert done.returncode == 1, done.stderr
    assert report is not None
    assert report["faults"][0]["cause"].startswith("failed in write: ZeroDivisionError: division by zero (")
    pushed = next(who for who, what in log if what != "open")
    last = next(entry for entry in reversed(log) if entry[1] != "close")
    assert last[1] == "0.0" and last[0] != pushed
    assert len([who for who, what in log if who != pushed and what == "0.0"]) == 1


def test_a_driver_that_does_not_return_from_closing_is_not_waited_for(tmp_path: Path) -> None:
    """The guardian ended the program after 90 s, and its report was lost."""
    done, report, log = run_in_time(tmp_path, "Stick.close = lambda self: time.sleep(1000)")
    assert done.returncode == 2
    assert "device 'stick' could not be released: did not return from closing within 2 s" in done.stderr
    assert report is not None and report["faults"] == [] and "ended_by" not in report
    assert forces(log)[-1] == 0.0


#: A copy of the servo process that lives on, and holds whatever that had open but the test's own pipes.
COPY = """
if os.fork() == 0:
    with open(FILE + '.copy', 'w') as stream:
        print(os.getpid(), file=stream)
    for name in os.listdir('/proc/self/fd'):
        try:
            if 'pipe:' in os.readlink('/proc/self/fd/' + name):
                os.close(int(name))
        except OSError:
            pass
    time.sleep(900)
    os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize("ends", campaign.some(["os.kill(os.getpid(), 9)", "pass"], lambda end: end != "pass"))
def test_the_end_of_a_servo_process_is_told_though_a_copy_of_it_lives(tmp_path: Path, ends: str) -> None:
    """Whoever had launched it heard of its end when the copy had ended."""
    done, report, log = run_in_time(tmp_path, COPY + ends)
    copies = [int(path.read_text()) for path in tmp_path.glob("*/log.copy")]
    assert copies and all(lives(copy) for copy in copies)
    for copy in copies:
        os.kill(copy, signal.SIGKILL)
    assert forces(log)[-1] == 0.0
    assert (done.returncode, report is None) == ((0, False) if ends == "pass" else (1, True))
    assert (
        ends == "pass"
        or "the servo process was killed by SIGKILL; the servo process died; stick made safe" in done.stderr
    )
