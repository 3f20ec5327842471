"""A scene to measure on: arm, table and display as twins, and a finger that touches and lets go again and again."""

from __future__ import annotations

_HEAD = """<itouch version="1.0" xmlns:xyz-table="urn:itouch:plugin:xyz-table">
  <materials>
    <material name="wood"><contact stiffness="1.2 N/mm" damping="2 N*s/m" static-friction="0.4"/></material>
  </materials>
  <world temperature="23 degC"><box name="block" pos="0 0 10 mm" size="60 60 20 mm" material="wood"/></world>
  <devices>
    <device name="arm" plugin="usb-arm" twin="TWIN"/>
    <device name="table" plugin="xyz-table" twin="TWIN">
      <mount pos="0 0 -8 mm"/>
      <xyz-table:hardware travel="200 140 60 mm"/>
    </device>
    <device name="peltier" plugin="thermal" twin="TWIN"><mount on="table" pos="0 0 4 mm"/></device>
  </devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
    <operator probe="finger"><motion>
      <to pos="0 0 150 mm" in="0.1 s" hold="0.4 s"/>
"""
_TOUCH = """      <to pos="0 0 24 mm" in="0.7 s" hold="0.5 s"/>
      <to pos="0 0 60 mm" in="0.4 s" hold="0.2 s"/>
"""
_TAIL = """    </motion></operator>
  </interaction>
  <safety hold-to-run="HOLD"/>
</itouch>
"""


def scene(*, touches: int = 30, remote: bool = True, hold: bool = True) -> str:
    """Return the text of the scene.

    Parameters
    ----------
    touches
        How often the finger touches the block; each touch takes 1.8 s.
    remote
        Whether each twin runs in a process of its own.
    hold
        Whether somebody must hold the dead-man's switch.
    """
    text = _HEAD + touches * _TOUCH + _TAIL
    return text.replace("TWIN", "remote" if remote else "yes").replace("HOLD", "yes" if hold else "no")
