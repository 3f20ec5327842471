"""The scene on the display that anyone can build: its program in a simulated chip, driver, loop, supervisor, twins."""

from __future__ import annotations

import hashlib
import io
import os
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import requirements
from shipped import SCENES

from itouch.plugin import read_trace
from itouch_thermal.bench_wire import ADDS, CORNER, DIFFERS, OWN_RIG, differ
from itouch_thermal.chip.program import missing
from itouch_tools.cli import lockstep
from itouch_tools.cli.lockstep import Lockstep

from free_ports import free_port  # isort: skip

MOTION = '<to pos="-11 0 44 mm" in="0.5 s" hold="{hold} s"/><to pos="-11 0 22 mm" in="0.6 s" hold="{touch} s"/>'


def scene(folder: Path, hold: float, touch: float) -> Path:
    """Write the scene at addresses of its own, with one touch of pyrex."""
    if lacking := missing():
        requirements.missing(f"the simulated chip needs {lacking}")
    text = (SCENES / "four_materials_diy.xml").read_text()
    begin, end = text.index("<motion>"), text.index("</motion>")
    (folder / "rigs").mkdir(parents=True)
    path = folder / "scene.xml"
    path.write_text(text[:begin] + "<motion>" + MOTION.format(hold=hold, touch=touch) + text[end:])
    (folder / "materials.xml").write_text((SCENES / "materials.xml").read_text())
    rig = (SCENES / "rigs/diy.xml").read_text().replace("127.0.0.1:3241", f"127.0.0.1:{free_port()}")
    (folder / "rigs/diy.xml").write_text(rig.replace("/tmp/itouch-diy", f"{folder}/diy"))
    return path


def run(path: Path, seconds: float | None = None) -> tuple[dict, np.ndarray]:  # type: ignore[type-arg]
    """Run in step; return the report, and rows of (time, desired, true flux, in contact)."""
    both = Lockstep(str(path))
    host, world, rows = both.host.state, both.world.state, []
    both.host.taps.append(
        lambda tick: rows.append(
            (
                tick * 1e-3,
                host["heat.desired"].item(),
                world["peltier.twin.true_flux"].item(),
                host["heat.in_contact"].item(),
            )  # fmt: skip
        )
    )
    report = both.run(seconds)
    return report, np.array(rows)


def true_error(rows: np.ndarray, since: float = 0.1) -> float:  # type: ignore[type-arg]
    """Return the rms of the finger's true flux error [1], from some time after the touch until the flux ends."""
    touching = rows[(rows[:, 3] > 0.0) & (rows[:, 2] != 0.0)]
    late = touching[touching[:, 0] >= touching[0, 0] + since]
    return float(np.sqrt(np.mean(((late[:, 2] - late[:, 1]) / np.maximum(np.abs(late[:, 1]), 50.0)) ** 2)))


def test_a_corner_of_the_simulated_chip_is_within_its_bound(tmp_path: Path) -> None:
    """The short form of `bench wire scenes/four_materials_diy.xml --alone --corners`: one corner, one touch.

    What differs most from what the controller is told are the first moments: contact, module, delay and sensors.
    """
    path = scene(tmp_path / "one", 6.0, 1.2)
    assert differ(path.parent / "rigs" / "diy.xml", {"contact-resistance": -0.2, "seebeck": -0.1, "delay": 5e-3}) == 1
    report = Lockstep(str(path), only=["peltier"]).run()
    assert report["faults"] == []
    (contact,) = report["contacts"]
    assert contact["true_error_rms"] < CORNER * OWN_RIG


def test_a_bad_line_to_the_simulated_chip_adds_at_most_one_percentage_point(tmp_path: Path) -> None:
    """The short form of `bench wire scenes/four_materials_diy.xml --alone --unsteady`, on a plant that differs besides."""
    path = scene(tmp_path / "one", 6.0, 1.2)
    assert differ(path.parent / "rigs" / "diy.xml", DIFFERS) == 1
    errors = []
    for unsteady in (False, True):
        report = Lockstep(str(path), only=["peltier"], unsteady=unsteady, seed=1).run()
        assert report["faults"] == []
        (contact,) = report["contacts"]
        errors.append(contact["true_error_rms"])
    assert errors[0] < OWN_RIG
    assert errors[1] < errors[0] + ADDS


@pytest.mark.long
def test_the_last_of_four_materials_is_within_its_bound_in_the_corner_that_is_worst_for_it(tmp_path: Path) -> None:
    """Whoever does not know the slew of the current lays it to the finger's account: polystyrene was 15 % off."""
    shutil.copytree(SCENES, tmp_path / "scenes")
    corner = {"contact-resistance": -0.2, "seebeck": 0.1, "delay": 5e-3, "sensor-lag": 0.3}
    assert differ(tmp_path / "scenes" / "rigs" / "diy.xml", corner) == 1
    report = Lockstep(str(tmp_path / "scenes" / "four_materials_diy.xml"), only=["peltier"]).run()
    assert report["faults"] == []
    assert [contact["object"] for contact in report["contacts"]] == ["aluminium", "pyrex", "wood", "polystyrene"]
    assert all(contact["true_error_rms"] < CORNER * OWN_RIG for contact in report["contacts"])


@pytest.mark.long
def test_a_touch_on_the_simulated_chip_is_felt_as_it_should_be(tmp_path: Path) -> None:
    report, rows = run(scene(tmp_path / "one", 6.0, 1.2))
    assert report["faults"] == []
    (contact,) = report["contacts"]
    assert contact["object"] == "pyrex"
    assert contact["plate"]
    assert contact["mean_flux_W_m2"] > 1000.0
    assert true_error(rows) < 0.05


def told(
    path: Path, seconds: float, only: Sequence[str] = (), slow: float = 0.0
) -> tuple[list[bytes], dict[str, list[bytes]]]:
    """Run in step; return digests of all State of host and world, a tick each, and what went over each device's wire.

    Of each wire in its own order: devices are opened side by side.  ``slow``: so long [s] a tick takes besides.
    """
    states, wires = list[bytes](), io.StringIO()
    both = Lockstep(str(path), trace=wires, only=only)

    def look(tick: int) -> None:
        states.append(hashlib.sha256(both.host.state.tobytes() + both.world.state.tobytes()).digest())
        time.sleep(slow)

    both.host.taps.append(look)
    assert both.run(seconds)["faults"] == []
    lines: dict[str, list[bytes]] = {}
    for entry in read_trace(wires.getvalue().splitlines()):
        lines.setdefault(entry.device, []).append(entry.mark.encode() + entry.data)
    return states, lines


@contextmanager
def busy() -> Iterator[None]:
    """Keep every core of this machine busy."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def test_when_the_wires_are_looked_at_changes_nothing_in_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was asked for in a tick counts in it, whether the thread that serves the wires came to it by then or not."""
    path = scene(tmp_path / "one", 6.0, 1.2)
    often = told(path, 0.1, ["peltier"], slow=3e-3)
    monkeypatch.setattr(lockstep, "LOOK", 0.05)
    seldom = told(path, 0.1, ["peltier"])
    assert seldom == often
    assert list(often[1]) == ["peltier"]
    assert len(often[1]["peltier"]) > 10


def test_a_rig_that_gets_no_processor_for_seconds_is_not_asked_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Processes of real-time priority kept the thread of the wires waiting: a servo was asked twice, an arm was lost."""
    path, waits = scene(tmp_path / "one", 6.0, 1.2), 0

    def starved(*given: Any) -> Any:
        nonlocal waits
        waits += 1
        if waits in (20, 60):
            time.sleep(1.5)
        return select.select(*given)

    quiet = told(path, 0.1, ["arm", "table"])
    monkeypatch.setattr(lockstep, "select", SimpleNamespace(select=starved))
    assert told(path, 0.1, ["arm", "table"]) == quiet
    assert waits > 60


@pytest.mark.long
def test_in_step_the_chip_does_the_same_again_beside_other_work(tmp_path: Path) -> None:
    """Bit by bit, with every device on its wire: what they do depends on no clock of this machine."""
    path = scene(tmp_path / "one", 6.0, 1.2)
    quiet = told(path, 2.0)
    with busy():
        found = told(path, 2.0)
    assert found[0] == quiet[0]
    assert found[1] == quiet[1]
    assert set(quiet[1]) == {"arm", "table", "peltier"}
