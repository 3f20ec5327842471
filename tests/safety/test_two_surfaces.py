"""Two fingers, each over a surface of its own, without a display: each is let go of, whatever the other surface does."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import campaign
import numpy as np
import pytest

import itouch
from itouch.loop import DeviceFaultError
from itouch.session import Session

SCENE = """<itouch version="1.0" xmlns:xyz-table="urn:itouch:plugin:xyz-table">
  <materials><material name="m"><contact stiffness="800 N/m" damping="2 N*s/m"/></material></materials>
  <world>{world}</world>
  <devices>{devices}</devices>
  <interaction>{probes}</interaction><safety force="3 N"/>{faults}</itouch>"""
WORLD = '<box name="block-{side}" pos="{x} 0 10 mm" size="60 60 20 mm" material="m"/>'
DEVICES = """
  <device name="arm-{side}" plugin="usb-arm"><mount pos="{x} 250 0 mm" rpy="0 0 180 deg"/></device>
  <device name="table-{side}" plugin="xyz-table"><mount pos="{x} 0 -8 mm"/><limits speed="0.25 m/s"/>
    <xyz-table:hardware travel="200 140 60 mm"/></device>"""
PROBES = """
  <probe name="{side}" radius="8 mm" pose-from="arm-{side}" force-to="arm-{side}" surface-to="table-{side}"/>
  <operator probe="{side}"><motion>
    <to pos="{x} 0 44 mm" in="0.5 s" hold="0.5 s"/><to pos="{x} 0 24 mm" in="0.7 s" hold="60 s"/></motion></operator>"""
FAULTS = """<fault device="arm-{side}" kind="freeze" at="9000 s"/>
  <fault device="table-{side}" kind="freeze" at="9000 s"/><fault device="table-{side}" kind="freeze" at="9001 s"/>"""
SIDES = ("left", "right")
KINDS = ((), ("reversed-sign",), ("spike", "reversed-sign"), ("bias", "reversed-sign"), ("freeze", "reversed-sign"),
         ("drop", "reversed-sign"), ("freeze",))  # fmt: skip


@pytest.fixture(scope="module")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    """Return the scene, and the State in which both fingers rest on their surfaces."""
    path = tmp_path_factory.mktemp("two") / "two.xml"
    parts = {
        name: "".join(text.format(side=side, x=x) for side, x in zip(SIDES, (-300, 300), strict=True))
        for name, text in (("world", WORLD), ("devices", DEVICES), ("probes", PROBES), ("faults", FAULTS))
    }
    path.write_text(SCENE.format(**parts), encoding="utf-8")
    with itouch.build(path) as session:
        session.enable()
        session.run(2.6)
        assert min(_felt(session)) > 0.8
        return path, session.state.tobytes()


def _felt(session: Session) -> list[float]:
    return [session.state[f"{side}.plate_force"].item() for side in SIDES]


def stopped(
    pressed: tuple[Path, bytes], faults: dict[str, tuple[str, ...]], late: dict[str, float], after: float = 0.5
) -> tuple[str, float, float]:
    """Run into faults ``late`` [s] after the first; return what stopped it, and the greatest press, then and at the end [N]."""
    path, state = pressed
    most, cause = 0.0, ""

    def look(_: int) -> None:
        nonlocal most
        most = max(most, *_felt(session))

    with itouch.build(path) as session:
        session.adopt(state)
        session.taps.append(look)
        for device, kinds in faults.items():
            for slot, kind in enumerate(kinds):
                session.inject(device, kind, at=session.seconds + 0.02 + late.get(device, 0.0), slot=slot)
        try:
            session.run(1.0)
        except DeviceFaultError as fault:
            cause = str(fault)
        session.run(after)
        return cause, most, max(_felt(session))


@pytest.mark.parametrize(("left", "right"), campaign.some(
    list(product(KINDS, KINDS)), lambda pair: pair in (((), KINDS[2]), (KINDS[1], KINDS[3]), (KINDS[3], KINDS[2])),
))  # fmt: skip
def test_two_surfaces_let_go_of_both_fingers(
    pressed: tuple[Path, bytes], left: tuple[str, ...], right: tuple[str, ...]
) -> None:
    """The stop once ended while one that lies was held nearer, and nothing with a drive of its own kept it going."""
    rng = np.random.default_rng(len(left) * 10 + len(right))
    for late in ({}, {"table-left": rng.uniform(0.0, 0.05)}, {"table-right": rng.uniform(0.0, 0.05)}):
        cause, most, end = stopped(pressed, {"table-left": left, "table-right": right}, late)
        assert most < 5.0
        assert not cause or end < 0.5


@pytest.mark.parametrize("late", campaign.some([0.02, 0.0, 0.005, 0.01, 0.05, 0.1, 0.2], 1))
def test_a_drive_that_fails_on_the_way_back_is_still_minded(pressed: tuple[Path, bytes], late: float) -> None:
    """A stop was over when the surface had gone back by 3 mm; one that turned round after that came up to its end."""
    cause, most, end = stopped(pressed, {"arm-left": ("nan",), "table-left": ("reversed-sign",)}, {"table-left": late})
    assert "arm-left" in cause
    assert most < 5.0
    assert end < 0.1


def test_a_slow_surface_is_minded_as_long_as_it_goes(pressed: tuple[Path, bytes], tmp_path: Path) -> None:
    """At 20 mm/s it takes more than a second to go back: a drive that turns round then would not have been noticed."""
    path = tmp_path / "slow.xml"
    path.write_text(pressed[0].read_text(encoding="utf-8").replace("0.25 m/s", "20 mm/s"), encoding="utf-8")
    with itouch.build(path) as session:
        session.enable()
        session.run(6.0)
        assert min(_felt(session)) > 0.8
        slow = path, session.state.tobytes()
    cause, most, end = stopped(slow, {"arm-left": ("nan",), "table-left": ("reversed-sign",)}, {"table-left": 0.7}, 4.0)
    assert "arm-left" in cause
    assert most < 2.0
    assert end < 0.1
