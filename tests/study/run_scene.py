"""A small study that a session can run in a second: a finger goes down to a block and up again."""

from __future__ import annotations

from pathlib import Path

SCENE = """<itouch version="1.0">
  <materials>
    <material name="wood"><contact stiffness="1.2 N/mm" static-friction="0.4"/></material>
    <material name="steel"><contact stiffness="1.5 N/mm" static-friction="0.2"/></material>
    <material name="cork"><contact stiffness="0.6 N/mm" static-friction="0.6"/></material>
  </materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger">
      <motion>
        <to pos="0 0 32 mm" in="0.02 s"/>
        <to pos="0 0 27 mm" in="0.1 s" hold="0.15 s"/>
        <to pos="0 0 32 mm" in="0.1 s" hold="0.1 s"/>
      </motion>
    </operator>
  </interaction>
</itouch>"""


def write_study(folder: Path, *, repetitions: int = 3, more: str = "", contact: str = "") -> Path:
    """Write scene and study into a folder, and return the study's path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.xml").write_text(SCENE)
    path = folder / "study.xml"
    path.write_text(
        '<study version="1.0" scene="scene.xml" seed="5">\n'
        '  <factor name="material" levels="wood steel cork" set="block.material"/>\n'
        f'  <task kind="identify" factor="material"/>\n  <order repetitions="{repetitions}"/>\n  {more}\n'
        f'  <contact object="block" duration="0.1 s" pause="0 s" {contact}/>\n</study>\n'
    )
    return path
