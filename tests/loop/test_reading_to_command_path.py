"""A reading walks to a command through the files that the page on a tick names, and through no more than twelve."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "one-tick.md"
#: As many files as somebody may have to open who follows a reading.
MOST = 12

#: Prints the functions that a tick in contact calls, and those during which an arm's command changes; arguments: a
#: scene's file.  It runs with the compiler off, so that kernels are seen, too.
TRACE = """
import json, sys
from dataclasses import dataclass
from pathlib import Path

import itouch
from itouch.plugin import Device, deadman, pose, wrench
from itouch.plugin.discovery import Catalog, Found
from itouch.session import Session


@dataclass(frozen=True)
class Nothing:
    pass


class Arm(Device):
    Params, reads, commands, watchdog = Nothing, (pose(), deadman("grip")), (wrench(force=3.0),), 0.1
    height = 0.03

    def open(self):
        pass

    def close(self):
        pass

    def read(self, reading):
        Arm.height = max(0.0245, Arm.height - 2e-5)
        reading["pose"], reading["grip"] = (0.0, 0.0, Arm.height, 1.0, 0.0, 0.0, 0.0), 1.0

    def write(self, command):
        pass


class Entry:
    value = "a test's"

    def load(self):
        return Arm


Session.GUARDIAN = "no_guardian:watch"
catalog = Catalog(lambda group: {"lab": Found("lab", "t", "1", Entry())} if group == "itouch.devices" else {})
session = itouch.build(sys.argv[1], catalog=catalog)
session.enable()
session.run(0.3)  # the arm's share has grown since it was enabled, and the finger still sinks
core, command, open_calls, called, wrote = Path(itouch.__file__).parent, session.state["hand.command.wrench"], [], [], []


def place(code):
    file = Path(code.co_filename)
    return [str(file.relative_to(core)) if file.is_relative_to(core) else "", code.co_name]


def follow(frame, event, argument):
    if event == "call":
        called.append(place(frame.f_code))
        open_calls.append(command.tobytes())
    elif event == "return" and open_calls:
        if open_calls.pop() != command.tobytes():
            wrote.append(place(frame.f_code))
            open_calls[:] = [command.tobytes()] * len(open_calls)


sys.setprofile(follow)
session.tick()
sys.setprofile(None)
print(json.dumps({"called": called, "wrote": wrote, "force": session.state["hand.sent.wrench"][2].item()}))
session.close()
"""

SCENE = """<itouch version="1.0">
<materials><material name="wood"><contact stiffness="1.2 N/mm" damping="2 N*s/m" static-friction="0.4"/></material></materials>
<world><box name="block" size="40 40 20 mm" pos="0 0 10 mm" material="wood"/></world>
<devices><device name="hand" plugin="lab" twin="no"/></devices>
<interaction><probe name="finger" radius="8 mm" pose-from="hand" force-to="hand"/></interaction>
</itouch>"""


def on_the_page() -> list[list[str]]:
    """Return the rows of the page: a file below ``framework/itouch``, or nothing for the driver, and its function."""
    text = PAGE.read_text(encoding="utf-8")
    section = text[text.index("## From a reading to a command") : text.index("## Frames")]
    rows = re.findall(r"^\| (?:`([\w/.]+)`|the driver of the plugin) \| `(\w+)` \|", section, re.MULTILINE)
    return [list(row) for row in rows]


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[list[str]]]:
    scene = tmp_path_factory.mktemp("walk") / "scene.xml"
    scene.write_text(SCENE, encoding="utf-8")
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(__file__).parents[1])}
    said = subprocess.run(
        [sys.executable, "-c", TRACE, str(scene)], env=environment, capture_output=True, text=True, check=False
    )
    assert said.returncode == 0, said.stderr
    found: dict[str, list[list[str]]] = json.loads(said.stdout)
    return found


def test_a_reading_walks_through_the_files_that_the_page_names_in_this_order(
    traced: dict[str, list[list[str]]],
) -> None:
    rows = on_the_page()
    assert rows[0][1] == "run" and rows[-1] == ["", "write"]
    left = iter(traced["called"])
    for row in rows:
        assert row in left, f"{row} is not called after the row above it"  # what comes before it is used up
    assert traced["force"]  # what is followed reaches the wire


def test_these_are_no_more_than_twelve_files() -> None:
    assert len({file for file, _ in on_the_page()}) <= MOST


def test_no_other_rows_of_the_tick_decide_on_the_way(traced: dict[str, list[list[str]]]) -> None:
    """What is called of safety, monitors and loop beside them is run by the plan for other steps, or decides nothing."""
    beside = {
        "loop/engine.py", "loop/clock.py", "loop/tick_step.py", "loop/steps.py", "loop/timing.py",  # run the plan
        "loop/surface/ground.py", "safety/latch.py", "safety/device_link.py",  # asked by a row
        "loop/surface/force_estimate.py",  # asked how hard a surface is felt, of which there is none
        "loop/probe_steps.py",  # decides what is left to Python
        "loop/contact_log.py", "safety/hold_to_run.py",  # another step's
    }  # fmt: skip
    on_page = {file for file, _ in on_the_page()}
    called = {file for file, _ in traced["called"] if file.startswith(("loop/", "safety/", "monitors/"))}
    assert called - on_page == beside


def test_the_force_becomes_a_command_in_one_function(traced: dict[str, list[list[str]]]) -> None:
    assert traced["wrote"] == [["loop/surface/force.py", "push"]]
