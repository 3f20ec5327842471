"""Two surfaces, two displays on one finger, in sessions: force, contact time and dose are the finger's, not a device's."""

from __future__ import annotations

import numpy as np
import pytest

import itouch
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.session import Session, build
from itouch_evidence.renamed import RenamedCatalog

SCENE = """<itouch version="1.0" xmlns:xyz-table="urn:itouch:plugin:xyz-table">
  <materials><material name="steel"><contact stiffness="2 N/mm" damping="2 N*s/m" static-friction="0.4"/></material></materials>
  <world temperature="23 degC"><box name="block" size="60 60 18 mm" pos="0 0 9 mm" material="steel"/></world>
  <devices><device name="arm" plugin="usb-arm"><mount pos="0 250 0 mm" rpy="0 0 180 deg"/></device>{devices}</devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="t1"/>{probes}
    <operator probe="finger" skin-temperature="33 degC"><motion>
      <to pos="0 0 40 mm" in="0.1 s"/><to pos="0 0 22 mm" in="0.3 s" hold="9 s"/></motion></operator>
  </interaction>
  <safety {safety}/>
</itouch>"""
TABLE = """<device name="t{0}" plugin="xyz-table"><mount pos="0 0 -8 mm"/>
  <xyz-table:hardware travel="200 140 60 mm" force-noise="0 N"/></device>"""
DISPLAY = '<device name="p{1}" plugin="thermal"><mount on="t{0}" pos="{2} 0 4 mm"/></device>'
#: A second probe at the same finger, with a surface of its own.
SECOND = '<probe name="other" radius="8 mm" pose-from="arm" surface-to="t2"/>'


def session(devices: str, probes: str = "", safety: str = "", catalog: Catalog | None = None) -> Session:
    catalog = catalog or Catalog()
    text = SCENE.format(devices=devices, probes=probes, safety=safety)
    return build(loads(text.encode(), catalog), catalog=catalog)


def two_surfaces(safety: str, catalog: Catalog | None = None) -> Session:
    devices = "".join(TABLE.format(n) + DISPLAY.format(n, n, 0) for n in (1, 2))
    return session(devices, SECOND, safety, catalog)


def clocks(run: Session) -> list[float]:
    return [round(float(run.state[f"t{n}.surface.contact_time"]), 3) for n in (1, 2)]


@pytest.fixture(scope="module")
def pressed():
    """A finger on two surfaces that withdraw after a second, and all that was sent meanwhile."""
    found = []
    for catalog in (None, RenamedCatalog(seed=4)):
        run, sent, forces = two_surfaces('contact-time="1 s" force="0.8 N"', catalog), [], []
        views = [run.state[f"{d.name}.sent.{c.name}"] for d in run.model.devices.values() for c in d.commands]
        pads = [run.state[f"{name}.plate_force"] for name in ("finger", "other")]
        total, arm = run.state["finger.total_force"], views[0]

        def note(tick: int, sent=sent, views=views, forces=forces, pads=pads, total=total, arm=arm) -> None:
            sent.append([x for view in views for x in view.reshape(-1).tolist()])
            forces.append([*(pad.item() for pad in pads), arm[2].item(), total.item()])

        run.taps.append(note)
        run.run(0.5 if catalog else 1.0)
        before = clocks(run)
        run.run(0.0 if catalog else 0.7)
        found.append((run, before, sent, forces))
    return found


def test_the_clock_of_contact_is_the_fingers(pressed):
    run, before, _, _ = pressed[0]
    assert before[0] == before[1] == pytest.approx(0.6, abs=0.15)
    assert [int(run.state[f"t{n}.surface.withdrawn"]) for n in (1, 2)] == [1, 1]
    assert clocks(run)[0] == clocks(run)[1]


def test_both_are_felt_and_press_together_no_harder_than_one_finger_may_be_pressed(pressed):
    forces = pressed[0][3]
    for one, other, arm, total in forces[700:1000]:  # both press at once; one finger feels the sum, and the arm
        assert min(one, other) > 0.3
        assert total == pytest.approx(one + other + arm, abs=5e-3)
        assert total <= 0.8 + 1e-3


def test_other_names_change_no_command(pressed):
    ours, others = pressed[0][2], pressed[1][2]
    assert len(others) == 500
    assert ours[:500] == others


@pytest.mark.parametrize(("what", "words"), [("dose", "a thermal dose of 2.03 CEM43"), ("cold_time", "for 122.0 s")])
def test_two_displays_on_one_surface_share_what_a_finger_may_have(what, words):
    run = session(TABLE.format(1) + DISPLAY.format(1, 1, 0) + DISPLAY.format(1, 2, 30))
    run.run(0.02)
    run.state[f"p1.heat.{what}"], run.state[f"p2.heat.{what}"] = 80.0, 39.0
    run.run(0.02)
    run.state[f"p2.heat.{what}"] = 42.0
    with pytest.raises(itouch.DeviceFaultError, match=words):
        run.run(0.02)


def test_a_display_on_what_only_tracks_the_finger_shares_with_one_that_nothing_carries():
    worn = '<device name="p{0}" plugin="thermal">{1}</device>'
    text = SCENE.replace(' force-to="arm" surface-to="t1"', "").format(
        devices=worn.format(1, '<mount on="arm" pos="0 0 4 mm"/>') + worn.format(2, ""), probes="", safety=""
    )  # fmt: skip
    run = build(loads(text.encode(), Catalog()))
    run.run(0.02)
    run.state["p1.heat.dose"], run.state["p2.heat.dose"] = 80.0, 42.0
    with pytest.raises(itouch.DeviceFaultError, match="with others on the same finger"):
        run.run(0.02)


def test_a_worn_display_counts_on_the_clock_of_the_surface_of_its_finger():
    worn = '<device name="worn" plugin="thermal"/>'
    run = session(TABLE.format(1) + DISPLAY.format(1, 1, 0) + worn, safety='contact-time="0.2 s"')
    run.run(0.01)
    run.state["worn.command.current"] = 1.0
    run.run(0.15)
    assert float(run.state["t1.surface.contact_time"]) == pytest.approx(0.15, abs=0.03)
    assert run.state["worn.sent.current"].item() == 1.0
    run.run(0.1)
    assert int(run.state["t1.surface.withdrawn"]) == 1
    assert run.state["worn.sent.current"].item() == 0.0


def test_two_arms_on_one_finger_are_both_felt_and_give_no_more_than_one_may():
    arm = '<device name="arm2" plugin="usb-arm"><mount pos="100 250 0 mm" rpy="0 0 180 deg"/></device>'
    probe = '<probe name="other" radius="8 mm" pose-from="arm" force-to="arm2"/>'
    text = SCENE.replace(' surface-to="t1"', "").format(devices=arm, probes=probe, safety='force="0.8 N"')
    run, sums = build(loads(text.encode(), Catalog())), []
    arms, total = [run.state[f"{name}.sent.wrench"] for name in ("arm", "arm2")], run.state["finger.total_force"]
    run.taps.append(lambda tick: sums.append((*(float(np.linalg.norm(arm[:3])) for arm in arms), total.item())))
    run.run(0.8)
    assert max(one + other for one, other, _ in sums) == pytest.approx(0.8)
    assert min(sums[-1][:2]) > 0.2
    assert sums[-1][2] == pytest.approx(sum(sums[-1][:2]), abs=1e-3)


def test_a_session_that_is_restored_while_both_press_goes_on_to_the_same_bytes(tmp_path):
    straight = two_surfaces('force="0.8 N"')
    straight.run(0.9)
    assert (straight.state["finger.plate_force"].item(), straight.state["other.plate_force"].item()) > (0.0, 0.0)
    straight.save(tmp_path / "s.itouch")
    straight.run(0.2)
    again = itouch.restore(tmp_path / "s.itouch")
    again.run(0.2)
    assert again.state.tobytes() == straight.state.tobytes()
