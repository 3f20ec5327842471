"""Arms that a person leads, in a window on a virtual screen: from its first frame on, without a key."""

from __future__ import annotations

import pytest
from windows import drive, scripts_of

SCENE = """<itouch version="1.0" xmlns:PLUGIN="urn:itouch:plugin:PLUGIN">
  <materials><material name="wood"><contact stiffness="0.8 N/mm"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices><device name="arm" plugin="PLUGIN"><PLUGIN:hardware start="0 0 40 mm" WAY/></device></devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/></interaction></itouch>"""


@pytest.mark.parametrize(
    ("plugin", "way"),
    [
        ("mouse", 'step="0.2 mm"'),
        pytest.param("keyboard", 'speed="50 mm/s"', marks=pytest.mark.long),
        pytest.param("gamepad", 'speed="50 mm/s"', marks=pytest.mark.long),
    ],
)
def test_a_person_leads_the_finger(plugin, way, screen, tmp_path):
    scene = tmp_path / f"{plugin}.xml"
    scene.write_text(SCENE.replace("PLUGIN", plugin).replace("WAY", way))
    said = drive(scripts_of(f"interactive_arms_window/{plugin}"), [str(scene)], screen, tmp_path)
    assert not any(said.values()), "\n".join(said.values())
