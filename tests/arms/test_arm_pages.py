"""The scenes in the arms' pages are accepted as they stand there, and the tables name every parameter."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from shipped import SCENES

from itouch.arms import Gamepad, Keyboard, Mouse, Recorded
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.schema.fields import specs, xml_name
from itouch.world import Model
from itouch_arms.haply import Haply
from itouch_arms.openhaptics import OpenHaptics
from itouch_tools.cli import main

DOCS = Path(__file__).parents[2] / "docs"
PAGES = {
    "reference/device-haply.md": (Haply,),
    "reference/device-openhaptics.md": (OpenHaptics,),
    "reference/device-virtual-arms.md": (Mouse, Keyboard, Gamepad, Recorded),
}
SCENE = """<itouch version="1.0" {spaces}><devices>{device}</devices>
  <interaction><probe name="finger" pose-from="arm" force-to="arm"/></interaction></itouch>"""
ROWS = "t,x,y,z\n0,0,0,0\n1,0.01,0,0\n"


@pytest.mark.parametrize("page", PAGES)
def test_the_examples_are_scenes(page: str) -> None:
    devices = re.findall(r"```xml\n(<device .*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL)
    assert devices
    for device in devices:
        plugin = re.search(r'plugin="([^"]+)"', device)
        assert plugin is not None
        text = SCENE.format(spaces=f'xmlns:{plugin[1]}="urn:itouch:plugin:{plugin[1]}"', device=device)
        text = text.replace("touch.mcap", "touch.csv")
        model = Model.of(loads(text.encode(), Catalog(), files={"touch.csv": ROWS.encode()}), Catalog())
        assert model.devices["arm"].plugin == plugin[1]


def test_the_rig_of_the_guide_goes_under_a_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = (DOCS / "how-to/drive-real-devices.md").read_text(encoding="utf-8")
    (rig,) = re.findall(r"```xml\n(<itouch .*?)```", page, re.DOTALL)
    (tmp_path / "inverse3.xml").write_text(rig)
    (tmp_path / "mouse.xml").write_text(re.sub(r'plugin="haply".*?</device>', 'plugin="mouse"/>', rig, flags=re.DOTALL))
    assert main(["check", str(SCENES / "first_touch.xml"), "--rig", str(tmp_path / "inverse3.xml")]) == 0
    words = [
        "run",
        str(SCENES / "first_touch.xml"),
        "--rig",
        str(tmp_path / "mouse.xml"),
        "--headless",
        "--pace",
        "fast",
    ]
    assert main(words) == 0
    assert "block" in capsys.readouterr().out


@pytest.mark.parametrize("page", PAGES)
def test_every_parameter_is_explained(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    for cls in PAGES[page]:
        for name in specs(cls.Params):
            assert f"`{xml_name(name)}`" in text, f"{cls.__name__}: {name}"
