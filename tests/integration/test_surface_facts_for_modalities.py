"""What the framework tells a modality of a surface that is brought to a finger: where its frame is, and what it may do."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import itouch

SCENE = """<itouch version="1.0" xmlns:xyz-table="urn:itouch:plugin:xyz-table" xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <materials><material name="m"><contact stiffness="800 N/m"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="m"/></world>
  <devices>
    <device name="arm" plugin="usb-arm"><mount pos="0 250 0 mm" rpy="0 0 180 deg"/><usb-arm:hardware/></device>
    {devices}
  </devices>
  <interaction>
    <probe name="tip" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>{probes}
    <operator probe="tip" pad-stiffness="700 N/m"><motion><to pos="0 0 40 mm" in="0.2 s" hold="4 s"/>
      <to pos="0 0 25 mm" in="0.5 s" hold="0.5 s"/></motion></operator>
  </interaction><safety force="2 N"/>
</itouch>
"""
TABLE = """<device name="{name}" plugin="xyz-table"><mount {mount}/><limits speed="0.25 m/s"/>{more}
  <xyz-table:hardware travel="200 140 80 mm"/></device>"""


def built(folder: Path, devices: str, probes: str = "") -> itouch.Session:
    """Build the scene with these devices beside the arm."""
    (folder / "scene.xml").write_text(SCENE.format(devices=devices, probes=probes), encoding="utf-8")
    return itouch.build(folder / "scene.xml")


def ready(session: itouch.Session) -> itouch.Session:
    """Run a session until its touch-off is over and the finger moves."""
    session.enable()
    session.run(9.0, until=lambda: bool(session.state["ready"]))
    assert session.state["ready"]
    session.run(0.05)
    return session


def test_the_frame_of_a_device_is_what_mount_touch_off_and_carrier_make_of_it(tmp_path: Path) -> None:
    """The upper table stands turned on the lower one, and its mount is 2 mm wrong."""
    lower = TABLE.format(name="lower", mount='pos="5 0 0 mm" rpy="0 0 30 deg"', more="")
    upper = TABLE.format(
        name="table", mount='on="lower" pos="0 0 -8 mm" rpy="0 0 40 deg" mount-error="0 0 2 mm"',
        more='<calibration method="touch-off"/>',
    )  # fmt: skip
    with ready(built(tmp_path, lower + upper)) as session:
        state = session.state
        calibration, moved = state["table.calibration"], state["lower.pose"]
        assert abs(calibration[2] + 2e-3) < 2e-4
        below, above = Rotation.from_euler("z", 30, degrees=True), Rotation.from_euler("z", 40, degrees=True)
        turn = below * above
        origin = np.array((5e-3, 0.0, 0.0)) + below.apply(
            moved[:3] + np.array((0.0, 0.0, -8e-3)) + above.apply(calibration[:3])
        )
        assert state["table.frame"][:3] == pytest.approx(origin, abs=1e-12)
        assert state["table.frame"][3:] == pytest.approx(turn.as_matrix().ravel(), abs=1e-12)
        assert state["arm.frame"][:3] == pytest.approx((0.0, 0.25, 0.0), abs=1e-12)
        assert "lower.frame" not in state


def test_surfaces_on_one_finger_share_its_force_and_its_pad(tmp_path: Path) -> None:
    """The second probe has no operator: its pad is that of the finger, whichever probe says it."""
    devices = "".join(
        TABLE.format(name=name, mount=f'pos="{x} 0 -8 mm"', more="") for name, x in (("table", 0), ("other", 300))
    )
    probe = '<probe name="side" radius="8 mm" pose-from="arm" surface-to="other"/>'
    with built(tmp_path, devices, probe) as session:
        tip, side = session.model.surfaces["tip"], session.model.surfaces["side"]
    assert (tip.device, tip.arm, side.device, side.arm) == ("table", "arm", "other", "")
    assert tip.pad_stiffness == side.pad_stiffness == 700.0
    assert tip.greatest_force == side.greatest_force == pytest.approx((2.0 - 0.15) / 2)
    assert not tip.touch_off


def test_the_face_is_where_what_stands_on_the_device_has_it(tmp_path: Path) -> None:
    table = TABLE.format(name="table", mount='pos="0 0 -8 mm"', more='<calibration method="touch-off"/>')
    display = '<device name="peltier" plugin="thermal"><mount on="table" pos="1 2 4 mm"/></device>'
    with built(tmp_path, table + display) as session:
        surface = session.model.surfaces["tip"]
    assert surface.face == pytest.approx((1e-3, 2e-3, 4e-3))
    assert surface.touch_off
    assert math.isfinite(surface.greatest_force)
