"""For each code of a problem in a file, or of what is legal there but odd, the smallest input that causes it."""

from __future__ import annotations

from itouch_tools.cli.explain.example import Example, scene

WOOD = '<materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>\n'
ARM = '<devices><device name="arm" plugin="usb-arm"/></devices>\n'
_DOCUMENT = '<itouch version="1.0"/>\n'
_CHAIN = {f"f{n}.xml": f'<itouch version="1.0"><include file="f{n + 1}.xml"/></itouch>\n' for n in range(1, 18)}


def box(attributes: str, inside: str = "") -> str:
    """Return a world of one box of wood."""
    end = f">{inside}</box>" if inside else "/>"
    return f'{WOOD}<world>\n  <box name="block" {attributes}{end}\n</world>'


SIZE = 'size="20 20 20 mm" material="wood"'

FILES = {
    "no-such-file": scene('<include file="absent.xml"/>'),
    "outside-folder": scene('<include file="../materials.xml"/>'),
    "include-cycle": scene('<include file="b.xml"/>',
                           {"b.xml": '<itouch version="1.0">\n  <include file="scene.xml"/>\n</itouch>\n'}),
    "duplicate-include": scene('<include file="b.xml"/>\n<include file="b.xml"/>', {"b.xml": _DOCUMENT}),
    "too-many-includes": scene('<include file="f1.xml"/>', _CHAIN,
                               note="scene.xml includes f1.xml, which includes f2.xml, and so on to f18.xml"),
    "too-large": Example({"scene.xml": b"<itouch>" + b" " * (9 << 20)}, note="a scene.xml of 9 MiB"),
    "not-a-scene": scene('<include file="end.itouch"/>', {"end.itouch": b"PK\x03\x04" + bytes(26) + b"scene.xml"}),
    "not-utf-8": Example({"scene.xml": '<itouch version="1.0"><!-- für --></itouch>'.encode("latin-1")},
                         note='<itouch version="1.0"><!-- für --></itouch>\n(saved in Latin-1)'),
    "not-well-formed": scene("<world>"),
    "doctype": Example({"scene.xml": f"<!DOCTYPE itouch>\n{_DOCUMENT}"}),
    "too-deep": Example({"scene.xml": '<itouch version="1.0">\n' + "<a>" * 70 + "</a>" * 70 + "</itouch>"},
                        note="70 elements, each inside the other"),
    "too-many-attributes": Example(
        {"scene.xml": '<itouch version="1.0"\n' + " ".join(f'a{n}=""' for n in range(200)) + "/>"},
        note="<itouch> with 200 attributes"),
    "too-many-elements": Example({"scene.xml": '<itouch version="1.0">\n' + "<world/>\n" * 100_001 + "</itouch>"},
                                 note="<world/>, 100 001 times"),
    "wrong-root": Example({"scene.xml": '<scene version="1.0"/>\n'}),
    "bad-version": Example({"scene.xml": '<itouch version="one"/>\n'}),
    "newer-version": Example({"scene.xml": '<itouch version="7.0"/>\n'}),
}  # fmt: skip

NAMES = {
    "unknown-element": scene("<wrld/>"),
    "unknown-attribute": scene(box(f'{SIZE} colour="red"')),
    "unknown-prefix": scene('<interaction>\n  <thermal:heat probe="finger"/>\n</interaction>'),
    "unknown-name": scene(box('size="20 20 20 mm" material="wod"')),
    "duplicate-name": scene(f'{WOOD}<world>\n  <box name="a" {SIZE}/>\n  <box name="a" {SIZE}/>\n</world>'),
    "missing-attribute": scene(box('material="wood"')),
    "missing-element": scene('<world>\n  <box name="block" size="20 20 20 mm" material="bare"/>\n</world>\n'
                             '<materials><material name="bare"/></materials>'),
    "duplicate-element": scene("<world/>\n<world/>"),
    "unexpected-text": scene(box(SIZE, "hello")),
    "base-cycle": scene('<materials><material name="a" base="a"/></materials>'),
    "mount-cycle": scene('<devices>\n  <device name="arm" plugin="usb-arm"><mount on="arm"/></device>\n</devices>'),
}  # fmt: skip

VALUES = {
    "bad-value": scene(box('size="20 20 20 kg" material="wood"')),
    "out-of-range": scene(box(f'{SIZE} temperature="22"')),
    "exclusive": scene(box(f'{SIZE} rpy="0 0 90 deg" quat="1 0 0 0"')),
    "requires": scene(f'{ARM}<fault device="arm" kind="bias" at="1 s" amount="5 mm"/>'),
    "one-of": scene(box(SIZE, "<motion/>")),
}  # fmt: skip

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
