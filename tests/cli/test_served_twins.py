"""A virtual rig that cannot begin: it says which device cannot be served, and closes what it has opened, once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import itouch
from itouch.plugin import DeviceError, Emulator
from itouch_tools.cli import main
from itouch_tools.cli.served_twins import VirtualRig

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

ARM = '<device name="{}" plugin="usb-arm"/>'
SCENE = '<itouch version="1.0"><devices>\n{}\n{}\n</devices></itouch>'
MOVED = """<itouch version="1.0">
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion><to pos="0 0 0 mm" in="10 ms"/></motion></operator>
  </interaction>
</itouch>
"""
DISPLAY = """<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal"><devices>
  <device name="peltier" plugin="thermal" twin="no"><thermal:hardware><thermal:line port="port"/></thermal:hardware></device>
</devices></itouch>
"""


class Line(Emulator):
    """Listens nowhere, and notes what is done to it."""

    def __init__(self, why: Exception | None = None) -> None:
        super().__init__(None)
        self.why, self.calls = why, list[str]()

    def open(self) -> str:
        self.calls.append("open")
        if self.why is not None:
            raise self.why
        return "here"

    def serve(self, now: float, reading: Any, command: Any) -> bool:
        return False

    def close(self) -> None:
        self.calls.append("close")
        if self.why is not None:
            raise AttributeError("_peer")


@pytest.mark.parametrize(
    ("why", "said"),
    [
        (DeviceError("cannot listen at 192.168.0.10:4001"), "device 'second': cannot listen at 192.168.0.10:4001"),
        (KeyError("port"), "device 'second' failed in opening its emulator: KeyError: 'port' (test_served_twins.py, "),
    ],
)
def test_an_emulator_that_can_not_open_is_named_with_its_place(tmp_path: Path, why: Exception, said: str) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(ARM.format("first"), ARM.format("second")), "utf-8")
    with itouch.build(path) as session:
        first, second = Line(), Line(why)
        rig = VirtualRig(session, wires={"first": first, "second": second})
        with pytest.raises(itouch.ItouchError) as caught:
            rig.open()
        rig.close()  # as in a ``finally``
    assert said in str(caught.value)
    assert f"{path}:3:1" in str(caught.value)
    assert first.calls == second.calls == ["open", "close"]


def test_the_end_of_the_motion_is_told_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(MOVED, "utf-8")
    with itouch.build(path) as session:
        rig = VirtualRig(session, wires={"arm": Line()})
        rig.open()
        rests = iter([False] * 50 + [True])
        rig.run(lambda: next(rests))  # nobody drives it: the motion does not begin
        assert "motion" not in capsys.readouterr().err
        rig.driven = True
        rests = iter([False] * 50 + [True])
        rig.run(lambda: next(rests) if session.done else False)
        assert capsys.readouterr().err.count("the scene's motion has ended") == 1
        rig.close()


@pytest.mark.parametrize("pace", ["step", "real"])
def test_a_run_whose_switch_nobody_could_hold_says_what_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], pace: str
) -> None:
    (tmp_path / "scene.xml").write_text(DISPLAY, "utf-8")
    assert main(["virtual-rig", str(tmp_path / "scene.xml"), "--run", "--pace", pace, "--for", "0.1s"]) == 2
    said = capsys.readouterr().err
    assert "--run opens no window, and no device of this scene reads a switch" in said
    assert "in another terminal `itouch-py SCENE`" in said
