"""Scenes with surfaces that are not flat, touched with an arm and a table: a template, ramps and balls."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from itouch.plugin.discovery import Catalog
from itouch.session import Session, build

RADIUS = 8.0  # radius of the finger [mm]
HIGHEST = 45.0  # height to which the table can bring its plate, with a little to spare [mm]

_SCENE = """<?xml version="1.0" encoding="utf-8"?>
<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal" xmlns:xyz-table="urn:itouch:plugin:xyz-table"
        xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <include file="materials.xml"/>
  <materials>
    <material name="stuff" base="aluminium">
      <contact stiffness="{stiffness} N/mm" damping="2 N*s/m" static-friction="{friction}"
               dynamic-friction="{friction}"/>
    </material>{materials}
  </materials>
  <defaults><mesh scale="1 mm"/></defaults>
  <world temperature="23 degC">{world}</world>
  <devices>
    <device name="arm" plugin="usb-arm">
      <mount pos="0 250 0 mm" rpy="0 0 180 deg"/><limits force="3 N"/><usb-arm:hardware/>
    </device>
    <device name="table" plugin="xyz-table">
      <mount pos="0 0 {mount} mm" mount-error="0 0 {error} mm"/><limits speed="0.25 m/s"/>
      {calibration}<xyz-table:hardware travel="200 140 80 mm"{noise}/>
    </device>
    {display}
  </devices>
  <interaction>
    <probe name="finger" radius="{radius:g} mm" pose-from="arm" force-to="arm" surface-to="table"{probe}/>
    <operator probe="finger" mass="80 g" stiffness="300 N/m" damping="6 N*s/m" skin-temperature="33 degC"{pad}>
      <motion>{motion}</motion>
    </operator>
    {heat}
  </interaction>
  {rates}<safety force="{force} N" contact-time="{contact_time} s"/>
</itouch>
"""
_DISPLAY = """<device name="peltier" plugin="thermal"><mount on="table" pos="0 0 4 mm"/>
      <limits current="6 A" temperature="15 40 degC"/><thermal:hardware>{hardware}</thermal:hardware></device>"""
_HEAT = """<thermal:heat probe="finger"{press}>{heat}</thermal:heat>
    <thermal:flux-control display="peltier" desired-from="heat"/>"""


@dataclass(frozen=True, slots=True)
class Slope:
    """The variable parts of a scene: XML of ``world``, hand ``motion`` and ``heat``, and numbers in the file's units.

    ``stiffness`` [N/mm] and ``friction`` of the material, the limit ``force`` [N], the ``error`` of the table's
    mounting height [mm] and ``contact_time`` [s]; ``warm`` puts a thermal display on the table, ``touch_off`` has its
    mount calibrated; ``probe``: more attributes of the probe; ``seed`` is that of the session.

    ``rate`` of the loop [Hz], ``radius`` of the finger and ``clearance`` of the withdrawn plate [mm], stiffness [N/m]
    and damping [N s/m] of the finger's ``pad``, ``noise`` of the plate's force sensor [mN] and time constant ``press``
    of the heat [s]; None: what a scene has that does not say it.  ``materials``: XML of further ones.
    """

    world: str
    motion: str
    stiffness: float = 1.2
    friction: float = 0.0
    force: float = 3.0
    error: float = 0.0
    warm: bool = False
    touch_off: bool = False
    heat: str = ""
    seed: int = 0
    contact_time: float = 10.0
    probe: str = ""
    rate: int | None = None
    radius: float = RADIUS
    clearance: float | None = None
    pad: tuple[float, float] | None = None
    noise: float | None = None
    press: float | None = None
    materials: str = ""

    def text(self, hardware: str = "") -> str:
        """Return the text of the scene file; ``hardware``: XML inside the display's hardware element."""
        stiffness, damping = self.pad or (0.0, 0.0)
        heat = _HEAT.format(heat=self.heat, press=_said(self.press, ' press="{:g} s"'))
        return _SCENE.format(
            world=self.world, motion=self.motion, stiffness=self.stiffness, friction=self.friction, force=self.force,
            error=self.error, display=_DISPLAY.format(hardware=hardware) if self.warm else "",
            heat=heat if self.warm else "", mount=-34 if self.warm else -30, contact_time=self.contact_time,
            probe=_said(self.clearance, ' clearance="{:g} mm"') + _said(self.probe or None, " {}"), radius=self.radius,
            pad=_said(self.pad, f' pad-stiffness="{stiffness:g} N/m" pad-damping="{damping:g} N*s/m"'),
            noise=_said(self.noise, ' force-noise="{:g} mN"'), rates=_said(self.rate, '<rates servo="{} Hz"/>\n  '),
            calibration='<calibration method="touch-off"/>' if self.touch_off else "", materials=self.materials,
        )  # fmt: skip

    def build(self, folder: Path, hardware: str = "", catalog: Catalog | None = None) -> Session:
        """Write the scene to a folder with the shipped scenes, and build its session; ``hardware`` as in `text`."""
        path = folder / "slope.xml"
        path.write_text(self.text(hardware), encoding="utf-8")
        return build(path, seed=self.seed, catalog=catalog)


def _said(value: object, text: str) -> str:
    """Return the XML of a value, ``text`` with it; nothing if it is None."""
    return "" if value is None else text.format(value)


def ramp(degrees: float, deep: float = 5.0) -> tuple[str, str]:
    """Return world and motion: a ramp, and a touch along its normal whose target is ``deep`` mm below its surface."""
    tilt = math.radians(degrees)

    def off(distance: float) -> str:
        return f"{distance * math.sin(tilt):.3f} 0 {distance * math.cos(tilt):.3f} mm"

    world = f'<box name="ramp" pos="0 0 0 mm" rpy="0 {degrees} 0 deg" size="60 60 10 mm" material="stuff"/>'
    away, on = off(5.0 + RADIUS + 12.0), off(5.0 + RADIUS - deep)
    return world, (
        f'<to pos="{away}" in="0.1 s" hold="0.1 s"/><to pos="{on}" in="0.5 s" hold="0.4 s"/>'
        f'<to pos="{away}" in="0.4 s" hold="0.05 s"/>'
    )


def ball(degrees: list[float], each: float, radius: float = 30.0, deep: float = 4.0) -> tuple[str, str]:
    """Return world and motion: a ball whose top the table reaches, and a stroke over it from angle to angle.

    ``each``: duration of each part [s]; ``radius`` of the ball, and how ``deep`` the targets are in it [mm].
    """
    middle = min(0.0, HIGHEST - radius)
    world = f'<sphere name="ball" pos="0 0 {middle:g} mm" radius="{radius} mm" material="stuff"/>'
    reach = radius + RADIUS - deep

    def on(angle: float) -> str:
        there = math.radians(angle)
        return f"{reach * math.sin(there):.3f} 0 {middle + reach * math.cos(there):.3f} mm"

    strokes = "".join(f'<to pos="{on(angle)}" in="{each} s"/>' for angle in degrees)
    above = f"0 0 {middle + radius + RADIUS + 12.0} mm"
    return world, (
        f'<to pos="{above}" in="0.1 s" hold="0.1 s"/><to pos="{on(0.0)}" in="0.5 s" hold="0.3 s"/>{strokes}'
        f'<to pos="{above}" in="0.4 s"/>'
    )
