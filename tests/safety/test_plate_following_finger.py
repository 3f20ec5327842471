"""A plate that follows a finger upwards at the distance where it is near, and where it must be slower (K5)."""

from __future__ import annotations

from pathlib import Path

import pytest

import itouch

SCENE = """<itouch version="1.0" xmlns:xyz-table="urn:itouch:plugin:xyz-table" xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <materials><material name="m"><contact stiffness="800 N/m"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 -20 mm" material="m"/></world>
  <devices>
    <device name="arm" plugin="usb-arm"><mount pos="0 250 0 mm" rpy="0 0 180 deg"/><usb-arm:hardware/></device>
    <device name="table" plugin="xyz-table"><mount pos="0 0 -40 mm"/><limits speed="0.25 m/s"/>
      <xyz-table:hardware travel="200 140 120 mm"/></device>
  </devices>
  <interaction>
    <probe name="tip" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table" clearance="{clearance} mm"/>
    <operator probe="tip"><motion>
      <to pos="0 0 15 mm" in="0.1 s" hold="0.6 s"/><to pos="0 0 100 mm" in="{rise} s" hold="0.5 s"/></motion></operator>
  </interaction>
</itouch>
"""


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("rise", [0.75, 0.9])
@pytest.mark.parametrize("clearance", [15, 18])
def test_a_plate_does_not_alternate_between_near_and_far_speeds(
    clearance: float, rise: float, compiled: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 20 mm it was fast in one tick and slow in the next: on an average faster than what stops it."""
    if not compiled:
        monkeypatch.setattr("itouch.loop.plan.can_join", lambda: False)
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(clearance=clearance, rise=rise), encoding="utf-8")
    with itouch.build(path) as session:
        session.run()
        state = session.state
        gap = state["tip.hand.position"][2].item() - 8e-3 - state["tip.plate_true_top"].item()
        assert gap == pytest.approx(1e-3 * clearance, abs=1e-4)
