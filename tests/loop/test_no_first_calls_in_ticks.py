"""No tick is the first to call a compiled function from Python: finding its form, or loading it, takes milliseconds.

Each case is a process of its own, in which nothing else has warmed anything.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCENES = Path(__file__).parents[2] / "scenes"

_WATCH = """
import itouch
from itouch_tools.cli.lockstep import Lockstep
from itouch.loop.engine import Engine
from itouch.monitors import Trip
from numba.core.dispatcher import Dispatcher

first, inside = [], []
compile_for, tick, make_safe = Dispatcher._compile_for_args, Engine.tick, Engine.make_safe


def noting(self, *values, **named):
    if inside:
        first.append(f"{self.py_func.__module__}.{self.py_func.__qualname__} in tick {inside[-1]}")
    return compile_for(self, *values, **named)


def within(method):
    def run(self, *values):
        inside.append(self.ticks)
        try:
            method(self, *values)
        finally:
            inside.pop()
    return run


Dispatcher._compile_for_args, Engine.tick, Engine.make_safe = noting, within(tick), within(make_safe)
"""

_WIRED = """
Lockstep(SCENE).run(SECONDS)
print(first)
"""

_HERE = """
session = itouch.build(SCENE)
session.run(SECONDS)
session.make_safe(itouch.DeviceFaultError(list(session.model.devices)[-1], session.ticks, Trip.DEVICE_ERROR, "failed"))
session.rearm()
session.run(0.05)
print(first)
"""


def _first_calls(what: str, scene: str, seconds: float) -> str:
    text = _WATCH + what.replace("SCENE", repr(str(SCENES / scene))).replace("SECONDS", repr(seconds))
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1]


def test_neither_an_ordinary_tick_nor_a_fault_calls_anything_first() -> None:
    assert _first_calls(_HERE, "four_materials.xml", 0.05) == "[]"


def test_a_plate_that_withdraws_calls_nothing_first(tmp_path: Path) -> None:
    folder = tmp_path / "scenes"
    shutil.copytree(SCENES, folder)
    scene = folder / "four_materials.xml"
    scene.write_text(scene.read_text().replace('force="3 N"/>', 'force="3 N" contact-time="0.5 s"/>'))
    told = _HERE.replace(
        "session.run(SECONDS)", "session.run(SECONDS)\nassert session.state['table.surface.withdrawn']"
    )
    assert _first_calls(told, str(scene), 9.0) == "[]"


@pytest.mark.long
@pytest.mark.parametrize("scene", ["four_materials_wire.xml", "four_materials_diy.xml"])
def test_no_tick_of_a_rig_behind_wires_calls_anything_first(scene: str) -> None:
    assert _first_calls(_WIRED, scene, 12.0) == "[]"


@pytest.mark.long
@pytest.mark.parametrize("scene", ["four_materials.xml", "two_fingers.xml", "thermal_display.xml", "moving.xml"])
def test_no_tick_of_a_rig_of_twins_calls_anything_first(scene: str) -> None:
    assert _first_calls(_HERE, scene, 12.0) == "[]"
