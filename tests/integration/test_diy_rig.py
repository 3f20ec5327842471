"""The scene on the display that anyone can build: its program in a simulated chip, driver, loop, supervisor, twins."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

from itouch_thermal.bench_wire import CORNER, OWN_RIG, differ
from itouch_thermal.chip.program import missing
from itouch_tools.cli.lockstep import Lockstep

from test_wire_rig import free_port  # isort: skip

MOTION = '<to pos="-11 0 44 mm" in="0.5 s" hold="{hold} s"/><to pos="-11 0 22 mm" in="0.6 s" hold="{touch} s"/>'


def scene(folder: Path, hold: float, touch: float) -> Path:
    """Write the scene at addresses of its own, with one touch of pyrex."""
    if missing():
        (pytest.fail if os.environ.get("CI") else pytest.skip)(f"the simulated chip needs {missing()}")
    text = (SCENES / "four_materials_diy.xml").read_text()
    begin, end = text.index("<motion>"), text.index("</motion>")
    (folder / "rigs").mkdir(parents=True)
    path = folder / "scene.xml"
    path.write_text(text[:begin] + "<motion>" + MOTION.format(hold=hold, touch=touch) + text[end:])
    (folder / "materials.xml").write_text((SCENES / "materials.xml").read_text())
    rig = (SCENES / "rigs/diy.xml").read_text().replace("127.0.0.1:3241", f"127.0.0.1:{free_port()}")
    (folder / "rigs/diy.xml").write_text(rig.replace("/tmp/itouch-diy", f"{folder}/diy"))
    return path


def run(path: Path, seconds: float | None = None) -> tuple[dict, np.ndarray, bytes]:  # type: ignore[type-arg]
    """Run in step; return report, rows of (time, desired, true flux, in contact), and the twins' State at the end."""
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
    return report, np.array(rows), bytes(world["peltier.twin.memory"].tobytes())


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


@pytest.mark.long
def test_a_touch_on_the_simulated_chip_is_felt_as_it_should_be(tmp_path: Path) -> None:
    report, rows, _ = run(scene(tmp_path / "one", 6.0, 1.2))
    assert report["faults"] == []
    (contact,) = report["contacts"]
    assert contact["object"] == "pyrex"
    assert contact["plate"]
    assert contact["mean_flux_W_m2"] > 1000.0
    assert true_error(rows) < 0.05


@pytest.mark.long
def test_in_step_the_chip_does_the_same_again(tmp_path: Path) -> None:
    """Bit by bit: what the chip does depends on no clock of this machine."""
    ends = [run(scene(tmp_path / name, 1.0, 0.5), 2.5)[2] for name in ("one", "two")]
    assert ends[0] == ends[1]
