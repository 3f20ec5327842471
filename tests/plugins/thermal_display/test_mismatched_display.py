"""Two fingers, a display at each: who writes the wrong one's name is told, for its heat is another finger's."""

from __future__ import annotations

from pathlib import Path

import pytest

import itouch

SCENE = """<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal">
  <materials>
    <material name="wood">
      <contact stiffness="1 N/mm"/>
      <thermal:material conductivity="0.11 W/(m*K)" specific-heat="2720 J/(kg*K)" density="415 kg/m^3"/>
    </material>
  </materials>
  <world><box name="block" size="60 60 18 mm" pos="0 0 9 mm" material="wood"/></world>
  <devices>
    <device name="arm-1" plugin="usb-arm"/>
    <device name="table-1" plugin="xyz-table"><calibration method="none"/></device>
    <device name="pad-1" plugin="thermal"><mount on="table-1" pos="0 0 4 mm"/></device>
    <device name="arm-2" plugin="usb-arm"/>
    <device name="table-2" plugin="xyz-table"><calibration method="none"/></device>
    <device name="pad-2" plugin="thermal"><mount on="table-2" pos="0 0 4 mm"/></device>
  </devices>
  <interaction>
    <probe name="thumb" pose-from="arm-1" force-to="arm-1" surface-to="table-1"/>
    <probe name="index" pose-from="arm-2" force-to="arm-2" surface-to="table-2"/>
    <thermal:heat name="heat-1" probe="thumb"/>
    <thermal:flux-control name="flux-1" display="pad-1" desired-from="heat-1"/>
    <thermal:heat name="heat-2" probe="PROBE"/>
    <thermal:flux-control name="flux-2" display="pad-2" desired-from="heat-2"/>
  </interaction>
</itouch>"""


@pytest.mark.parametrize(("probe", "astray"), [("index", False), ("thumb", True)])
def test_a_display_at_another_finger_than_the_one_it_follows_is_told(tmp_path: Path, probe: str, astray: bool) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.replace("PROBE", probe))
    engine = itouch.build(path)
    told = [notice for notice in engine.report()["notices"] if "another finger" in notice]
    engine.close()
    assert [
        notice.startswith("flux-2: 'pad-2' is at another finger than that of probe 'thumb'") for notice in told
    ] == ([True] * astray)
