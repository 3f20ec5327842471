"""A virtual rig that has an arm alone: in the air it gives no force, and its operator's motion must begin all the same."""

from __future__ import annotations

import json
from pathlib import Path

from program import program

SCENE = """<itouch version="1.0" xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <materials><material name="oak"><contact stiffness="800 N/m"/></material></materials>
  <world><box name="board" size="60 60 10 mm" pos="0 0 -20 mm" material="oak"/></world>
  <devices><device name="grip" plugin="usb-arm" twin="no">
    <mount pos="0 125 0 mm" rpy="90 0 0 deg"/><limits force="3 N"/>
    <usb-arm:hardware serial="any" usbip="127.0.0.1:3240" deadman="centre"/>
  </device></devices>
  <interaction>
    <probe name="pen" radius="8 mm" pose-from="grip" force-to="grip"/>
    <operator probe="pen" mass="200 g" stiffness="300 N/m" damping="8 N*s/m">
      <motion><to pos="0 0 0 mm" in="0.2 s"/><to pos="0 0 -10 mm" in="0.4 s" hold="0.3 s"/></motion>
    </operator>
  </interaction>
</itouch>
"""


def test_the_motion_begins_when_the_host_exchanges_with_it(tmp_path: Path) -> None:
    scene, report = tmp_path / "alone.xml", tmp_path / "report.json"
    scene.write_text(SCENE, encoding="utf-8")
    ended = program("virtual-rig", scene, "--run", "--for", "2.5 s", "--report", report)
    assert ended.returncode == 0, ended.stderr
    assert [contact["object"] for contact in json.loads(report.read_text())["contacts"]] == ["board"]
