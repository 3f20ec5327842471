"""Examples of what is legal in a scene, but odd."""

from __future__ import annotations

from itouch_tools.cli.explain.example import Example, scene
from itouch_tools.cli.explain.problems import ARM, SIZE, WOOD, box

_STIFF = WOOD.replace("1 N/mm", "600 N/mm")
_TWO = (
    '<materials>\n  <material name="wood"><contact stiffness="1 N/mm"/></material>\n'
    '  <material name="foam"><contact stiffness="0.2 N/mm"/></material>\n</materials>\n'
)
_TABLE = '<devices>\n  <device name="arm" plugin="usb-arm"/>\n  <device name="table" plugin="xyz-table"/>\n</devices>\n'
_PLATE = (
    '<devices>\n  <device name="table" plugin="xyz-table"/>\n'
    '  <device name="peltier" plugin="thermal"><mount on="table"/></device>\n</devices>\n'
)
_FINGER = '<probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"{more}/>'


def _touched(where: str, more: str = "") -> str:
    probe = _FINGER.format(more=more)
    return (
        f"<interaction>\n  {probe}\n"
        f'  <operator probe="finger"><motion><to pos="0 0 50 mm" in="0.2 s"/><to pos="{where}" in="0.6 s"/></motion>'
        "</operator>\n</interaction>"
    )


ODD: dict[str, Example] = {
    "metres": scene(box('size="60 60 20" material="wood"')),
    "overlap": scene(f'{_TWO}<world>\n  <box name="a" size="20 20 20 mm" material="wood"/>\n'
                     '  <box name="b" size="20 20 20 mm" pos="10 0 0 mm" material="foam"/>\n</world>'),
    "clipped-stiffness": scene(f'{_STIFF}{ARM}<world>\n  <box name="block" {SIZE}/>\n</world>\n'
                               + _touched("0 0 0 mm")),
    "out-of-band": scene(_PLATE + box(f'{SIZE} temperature="5 degC"')),
    "untouched": scene(f'{ARM}{box(SIZE)}\n' + _touched("0 0 30 mm")),
    "two-heights": scene(f'{WOOD}{_TABLE}<world>\n'
                         '  <box name="low" size="20 20 20 mm" pos="-11 0 10 mm" material="wood"/>\n'
                         '  <box name="high" size="20 20 26 mm" pos="11 0 13 mm" material="wood"/>\n</world>\n'
                         + _touched("0 0 30 mm", ' surface-to="table"')),
    "slow-servo": scene(f'{WOOD}{_TABLE}<rates servo="500 Hz"/>\n<world>\n'
                        '  <box name="block" size="20 20 20 mm" pos="0 0 10 mm" material="wood"/>\n</world>\n'
                        + _touched("0 0 26 mm", ' surface-to="table"')),
}  # fmt: skip
