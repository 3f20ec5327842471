"""Torque of an arm: limited as its force is (K1, K3), by default, and tightened in the scene's file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_devices import TABLE
from test_limits_per_finger import hand, press
from test_multiple_channels_per_device import HELD, built
from test_third_party_device_supervision import Nothing, catalog

from itouch.plugin import Channel, Device, Record, pose, wrench
from itouch.session.building import load_scene
from itouch.session.stored_limits import stated
from itouch.world.model import compile_scene
from itouch_tools.report.limits_in_words import limit_rows

PROBE = '<interaction><probe name="finger" pose-from="pad"/></interaction>'
HANDLE = wrench(force=8.0, torque=0.2)


class Handle(Device):
    """An arm of six degrees of freedom."""

    Params, watchdog = Nothing, 0.5
    reads, commands = (pose(), HELD), (HANDLE,)

    def open(self) -> None: ...
    def close(self) -> None: ...
    def read(self, reading: Record) -> None: ...


def still(count: int, reading: Record) -> None:
    reading["pose"] = (0.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0)


def turned(folder: Path, commands: tuple[Channel, ...] = (HANDLE,), more: str = "") -> tuple[Any, np.ndarray]:
    """Run a session whose arm is asked for a torque of 1 N m, and return the size of what it was sent, by tick."""
    session = built(folder, still, (pose(),), commands, elements=PROBE + more)
    sizes: list[float] = []

    def each() -> None:
        sizes.append(sum(float(np.linalg.norm(session.state[f"pad.sent.{c.name}"][3:])) for c in commands))
        for channel in commands:
            session.state[f"pad.command.{channel.name}"] = (0.0, 0.0, 0.0, 1.0, 1.0, -1.0)

    session.enable()
    session.run(1.5, each=each)
    return session, np.array(sizes)


@pytest.mark.parametrize("several", [1, 2])
def test_by_default_a_torque_stays_below_the_force_at_a_fingers_lever(tmp_path: Path, several: int) -> None:
    commands = tuple(replace(HANDLE, name=f"wrench{n}") for n in range(several))
    _, sizes = turned(tmp_path, commands)
    assert 0.0599 < sizes.max() <= 0.06 * (1.0 + 1e-9)
    assert np.diff(sizes).max() <= 0.020 * (1.0 + 1e-9)  # K3, and the ramp-in of hardware before it
    assert sizes[500] == pytest.approx(0.03, rel=0.01)


@pytest.mark.parametrize(
    ("more", "most", "by"),
    [
        ('<safety torque="20 mN*m"/>', 0.02, "<safety>"),
        ('<safety torque="5 N*mm"/>', 0.005, "<safety>"),
        ('<safety force="0.5 N"/>', 0.01, "<safety>"),  # as tight as the force that is asked for
        ('<safety force="2 N" torque="50 mN*m"/>', 0.04, "<safety>"),
    ],
)
def test_a_scene_tightens_the_torque(tmp_path: Path, more: str, most: float, by: str) -> None:
    session, sizes = turned(tmp_path, more=more)
    assert sizes.max() == pytest.approx(most, rel=1e-6)
    value, source = stated(session.model)["devices"]["pad"]["torque"]
    assert value == pytest.approx(most)
    assert source.startswith(by)


def test_the_rules_tell_of_the_torque_where_there_is_one(tmp_path: Path) -> None:
    session, _ = turned(tmp_path, more='<safety torque="20 mN*m"/>')
    said = {row.name: row for row in limit_rows(session.model.devices["pad"])}
    assert said["K1 torque on the finger"].value == "0.02 N m, never beyond 0.2 N m"
    assert said["K1 torque on the finger"].source.startswith("<safety>")
    assert said["K1 torque of all that turns one finger"].value == "0.02 N m"
    assert said["K3 increase of torque"].value == "20 N m/s"


@pytest.mark.parametrize("more", ['<limits torque="70 mN*m"/>', '<limits torque="20 mN*m"/>'])
@pytest.mark.parametrize("command", [HANDLE, wrench(force=8.0), wrench(force=8.0, torque=0.01)])
def test_a_torque_is_tightened_and_never_loosened(tmp_path: Path, more: str, command: Channel) -> None:
    kind = type("Of", (Handle,), {"commands": (command,)})
    path = tmp_path / "scene.xml"
    path.write_text(
        f'<itouch version="1.0"><devices><device name="pad" plugin="handle">{more}</device></devices></itouch>', "utf-8"
    )
    plugins = catalog({"handle": kind})
    model, problems = compile_scene(load_scene(path, catalog=plugins), plugins)
    codes = [one.code for one in problems if one.severity == "error"]
    if command.high[3] == 0.0:
        assert codes == ["limit-without-channel"]
    elif command is HANDLE and "20" in more:
        assert not codes
        assert model is not None
        assert model.devices["pad"].limits.torque == pytest.approx(0.02)
    else:
        assert codes == ["loosened-limit"]


def test_two_arms_on_one_finger_share_its_torque_and_give_way_to_a_plate() -> None:
    turning = (pose(),), (HANDLE,)
    _, (one, two, table), finger = hand({"one": turning, "two": turning, "table": TABLE})

    def turn(arm: Any, torque: float) -> float:
        arm.command["wrench"][3] = torque
        arm.gate.write(1)
        return float(arm.sent["wrench"][3])

    finger.check(1)
    assert turn(one, 0.04) == pytest.approx(0.02)  # in a tick
    assert turn(one, 0.04) == pytest.approx(0.04)
    assert turn(two, 0.06) == pytest.approx(0.02)
    assert turn(two, 0.06) == pytest.approx(0.02)
    press(table, 2.0)  # a newton is left: 20 mN m
    finger.check(1)
    assert (turn(two, 0.06), turn(one, 0.06)) == (0.0, pytest.approx(0.02))  # what both may together
