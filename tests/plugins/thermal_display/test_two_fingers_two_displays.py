"""Two fingers, each with an arm, a table and a display of its own: each touch is what it is without the other finger."""

from pathlib import Path
from typing import Any

import pytest

import itouch

BLOCKS = {"left": ("-0.15", "aluminium", "28 degC", "0.016"), "right": ("0.15", "foam", "34 degC", "0.0194")}
HEAD = """<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal" xmlns:xyz-table="urn:itouch:plugin:xyz-table">
  <materials>
    <material name="aluminium"><contact stiffness="2 N/mm" damping="2 N*s/m"/>
      <thermal:material conductivity="200" specific-heat="900" density="2750"/></material>
    <material name="foam"><contact stiffness="0.6 N/mm" damping="3 N*s/m"/>
      <thermal:material conductivity="0.027" specific-heat="1210" density="55"/></material>
  </materials>
  <world temperature="20 degC">"""
BOX = '<box name="{f}-block" pos="{x} 0 0.006" size="0.06 0.06 0.012" material="{material}"/>'
RIG = """
  <device name="{f}-arm" plugin="usb-arm"><mount pos="{x} 0.25 0" rpy="0 0 180 deg"/></device>
  <device name="{f}-table" plugin="xyz-table"><mount pos="{x} 0 -0.008"/><calibration method="none"/>
    <xyz-table:hardware travel="0.2 0.14 0.06" force-noise="0"/></device>
  <device name="{f}-display" plugin="thermal"><mount on="{f}-table" pos="0 0 0.004"/>
    <thermal:hardware flux-noise="0" plate-noise="0" sink-noise="0" skin-noise="0"><thermal:pressure-resistance/>
    </thermal:hardware></device>"""
TOUCH = """
  <probe name="{f}" pose-from="{f}-arm" force-to="{f}-arm" surface-to="{f}-table"/>
  <operator probe="{f}" skin-temperature="{skin}"><motion><to pos="{x} 0 0.04" in="0.5 s" hold="0.6 s"/>
    <to pos="{x} 0 {low}" in="0.3 s" hold="1.2 s"/><to pos="{x} 0 0.04" in="0.3 s"/></motion></operator>
  <thermal:heat name="{f}-heat" probe="{f}"><thermal:pressure-resistance/></thermal:heat>
  <thermal:flux-control name="{f}-flux" display="{f}-display" desired-from="{f}-heat"{more}/>"""


def touches(folder: Path, *fingers: str, more: str = "") -> dict[str, dict[str, Any]]:
    """Return the contact of each finger; ``more``: attributes of each flux control, `{f}` is the finger's name."""
    parts = []
    for form in (BOX, RIG, TOUCH):
        for finger in fingers:
            x, material, skin, low = BLOCKS[finger]
            known = more.format(f=finger)
            parts.append(form.format(f=finger, x=x, material=material, skin=skin, low=low, more=known))
    count = len(fingers)
    boxes, rigs, rest = ("".join(parts[n * count : (n + 1) * count]) for n in range(3))
    path = folder / f"{'-'.join(fingers)}.xml"
    path.write_text(
        f"{HEAD}{boxes}</world><devices>{rigs}</devices><interaction>{rest}</interaction></itouch>", encoding="utf-8"
    )
    engine = itouch.build(itouch.load(path))
    engine.run(3.5)
    report = engine.report()
    assert not report["faults"]
    return {contact["probe"]: contact for contact in report["contacts"]}


@pytest.mark.parametrize("order", [("left", "right"), ("right", "left")])
def test_a_finger_touches_as_it_does_alone(tmp_path: Path, order: tuple[str, str]) -> None:
    both = touches(tmp_path, *order)
    for finger in order:
        alone = touches(tmp_path, finger)[finger]
        assert alone["skin_begin_degC"] == pytest.approx(float(BLOCKS[finger][2].split()[0]), abs=0.1)
        assert alone["plate_s"] > 1.0
        for key in ("skin_begin_degC", "mean_flux_W_m2", "peak_flux_W_m2", "skin_drop_K", "flux_error_rms"):
            assert both[finger][key] == alone[key], (finger, key)


def test_the_force_is_that_under_this_finger_unless_the_scene_names_another(tmp_path: Path) -> None:
    assert touches(tmp_path, "left", "right") == touches(tmp_path, "left", "right", more=' force-from="{f}-table"')
    own, other = (touches(tmp_path, "left", "right", more=more) for more in ("", ' force-from="right-table"'))
    assert other["left"]["flux_error_rms"] > 2.0 * own["left"]["flux_error_rms"]
