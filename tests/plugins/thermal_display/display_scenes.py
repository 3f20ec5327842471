"""Small scenes with the shipped rig: two blocks of one height, touched in turn, with what a test wants to differ."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from itouch_thermal.flux.flux_model import FluxModel
from itouch_thermal.flux.onset import start_for

HEAT = '<thermal:heat probe="finger"/>'
CONTROL = '<thermal:flux-control display="peltier" desired-from="heat"/>'
LIMITS = '<limits current="6 A" temperature="15 40 degC"/>'

_SCENE = """<?xml version="1.0" encoding="utf-8"?>
<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal">
  <include file="materials.xml"/>
  <include file="rigs/twin.xml"/>
  <world temperature="{room}">
    <box name="left"  pos="-30 0 9 mm" size="50 60 18 mm" material="{left}"/>
    <box name="right" pos="30 0 9 mm"  size="50 60 18 mm" material="{right}"/>
  </world>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
    <operator probe="finger" mass="80 g" stiffness="300 N/m" damping="6 N*s/m" skin-temperature="33 degC">
      <motion>
        <to pos="-30 0 48 mm" in="0.5 s" hold="{wait}"/>
        <to pos="-30 0 22 mm" in="0.7 s" hold="{hold}"/>
        <to pos="-30 0 48 mm" in="0.6 s"/>
        <to pos="30 0 48 mm"  in="0.8 s" hold="{near}"/>
        <to pos="30 0 22 mm"  in="0.7 s" hold="{hold}"/>
        <to pos="30 0 48 mm"  in="0.6 s" hold="0.1 s"/>
      </motion>
    </operator>
    {heat}
    {control}
  </interaction>
  <rates servo="{servo}"{rates}/>
</itouch>
"""


@dataclass(slots=True)
class Display:
    """A scene to be: fields are what goes into its text; ``files`` are laid beside it."""

    left: str = "aluminium"
    right: str = "wood"
    heat: str = HEAT
    control: str = CONTROL
    hardware: str = "<thermal:hardware/>"
    limits: str = LIMITS
    room: str = "23 degC"
    wait: str = "0.6 s"
    near: str = "0.6 s"
    hold: str = "1.2 s"
    servo: str = "1 kHz"
    rates: str = ""
    files: dict[str, str] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write the scene into a folder that holds the shipped scenes; return its path."""
        rig = folder / "rigs" / "twin.xml"
        text = rig.read_text(encoding="utf-8")
        assert "<thermal:hardware/>" in text
        assert LIMITS in text
        text = text.replace("<thermal:hardware/>", self.hardware).replace(LIMITS, self.limits)
        rig.write_text(text, encoding="utf-8")
        for name, content in self.files.items():
            (folder / name).write_text(content, encoding="utf-8")
        path = folder / "display.xml"
        names = {name: getattr(self, name) for name in self.__slots__ if name not in ("files", "hardware", "limits")}
        path.write_text(_SCENE.format(**names), encoding="utf-8")
        return path


def start_of(model: FluxModel, index: int, skin: float, warmed: float = 0.0) -> float:
    """Return the start temperature [K] for an object whose flux is computed; see `onset.start_for`."""
    starts = model.starts[index]
    assert starts is not None
    return start_for(*starts, model.skin, model.temperatures[index], True, skin, warmed)
