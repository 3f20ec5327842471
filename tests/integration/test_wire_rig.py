"""A scene on every device's real protocol, host and virtual rig in step: contacts as with twins."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from free_ports import free_port
from punctuality import skip_unless_punctual
from requirements import not_here
from shipped import SCENES

from itouch.plugin import ItouchError, read_trace
from itouch.plugin.discovery import Catalog
from itouch.safety import Trip
from itouch.scene import loads, write
from itouch.session import build, load_scene
from itouch_tools.cli.lockstep import Lockstep
from itouch_tools.cli.served_twins import placed
from itouch_tools.cli.virtual_rig import main as virtual_rig


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """The wire scene at addresses of its own, with a touch of aluminium as soon as touch-off is done."""
    text = (SCENES / "four_materials_wire.xml").read_text()
    begin, end = text.index("<motion>"), text.index("</motion>")
    motion = '<to pos="-33 0 40 mm" in="0.5 s" hold="6 s"/><to pos="-33 0 16 mm" in="0.5 s" hold="0.7 s"/>'
    (tmp_path / "scene.xml").write_text(text[:begin] + "<motion>" + motion + text[end:])
    (tmp_path / "materials.xml").write_text((SCENES / "materials.xml").read_text())
    rig = (SCENES / "rigs/wire.xml").read_text()
    rig = rig.replace("127.0.0.1:3240", f"127.0.0.1:{free_port()}").replace(
        "127.0.0.1:5502", f"127.0.0.1:{free_port()}"
    )
    rig = rig.replace("/tmp/itouch-table", f"{tmp_path}/table").replace("/tmp/itouch-tec", f"{tmp_path}/tec")
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs/wire.xml").write_text(rig)
    return tmp_path / "scene.xml"


def test_contacts_on_the_wires_are_those_on_twins(scene: Path, tmp_path: Path) -> None:
    twins = build(load_scene(scene, twin="all"))
    twins.run()
    expected = twins.report()
    with (tmp_path / "wire.trace").open("w") as stream:
        wires = Lockstep(str(scene), trace=stream)
        found = wires.run()
    assert found["faults"] == []
    assert not found["twins"]
    (contact,), (other,) = found["contacts"], expected["contacts"]
    assert contact["object"] == other["object"] == "aluminium"
    assert contact["plate"]
    assert abs(contact["plate_gap_mm"]) < 0.2  # touch-off through servo torques found the 3 mm
    # What the arm is asked for and the table's servos feel is what the simulated finger truly felt, but for friction.
    assert contact["peak_force_N"] == pytest.approx(other["peak_force_N"], rel=0.5, abs=0.3)
    assert contact["peak_force_N"] > 0.3
    assert contact["mean_flux_W_m2"] == pytest.approx(other["mean_flux_W_m2"], rel=0.5)
    # The flux is the controller's own estimate, the twin behind the emulators knows how good it is.
    assert contact["flux_source"] == "estimate"
    assert contact["flux_deviation_W_m2"] < 50.0
    assert contact["true_error_rms"] < 0.03
    assert contact["estimate_error_rms"] < 0.03
    assert (
        contact["sensor_error_rms"] > contact["estimate_error_rms"]
    )  # noise and lag of the sensor are not the finger's
    assert float(abs(wires.host.state["flux-control.theta"][:8]).max()) > 1e-3  # readings have come in
    # The fast approach is most of this short run: over the whole four-material scene both are at 0.07 mm.
    assert found["table"]["tracking_mm"]["p99"] < expected["table"]["tracking_mm"]["p99"] + 1.5
    entries = read_trace((tmp_path / "wire.trace").read_text().splitlines())
    assert {entry.device for entry in entries} == {"arm", "table", "peltier"}
    assert entries[-1].device in ("arm", "table", "peltier")
    assert not (tmp_path / "table").exists()


def test_a_loop_that_is_late_in_a_touch_goes_on_with_the_finger_as_it_is(scene: Path) -> None:
    """The loop sleeps for 0.2 s soon after the finger has come: display and finger go on by themselves."""
    wires = Lockstep(str(scene), only=("peltier",))
    state, asleep = wires.host.state, []

    def sleep(tick: int) -> None:
        if state["flux-control.touching"].item() and tick == state["flux-control.begun"].item() + 30 and not asleep:
            asleep.append(tick)
            for _ in range(200):
                wires.rig.step()
            wires.host.leave_out(0.2, running=True)

    wires.host.taps.append(sleep)
    (contact,) = wires.run()["contacts"]
    assert asleep
    assert contact["true_error_rms"] < 0.03
    assert contact["estimate_error_rms"] < 0.03


HURRIED = """<itouch version="1.0" xmlns:xyz-table="urn:itouch:plugin:xyz-table" xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <materials><material name="wood"><contact stiffness="1.2 N/mm" static-friction="0.4"/></material></materials>
  <world><box name="block" size="80 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices>
    <device name="arm" plugin="usb-arm" twin="no">
      <mount pos="0 125 34 mm" rpy="90 0 0 deg"/><limits force="3 N"/>
      <usb-arm:hardware serial="any" usbip="127.0.0.1:3240" deadman="centre"/>
    </device>
    <device name="table" plugin="xyz-table" twin="no">
      <mount pos="0 0 -8 mm" mount-error="2 -1.5 3 mm"/><limits speed="0.25 m/s"/>
      <calibration method="touch-off"/>
      <xyz-table:hardware travel="120 80 60 mm" lead="20 20 10 mm" homing="absolute"/>
    </device>
  </devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
    <operator probe="finger"><motion>
      <to pos="-13 0 40 mm" in="0.1 s" hold="{hold}"/><to pos="-13 0 16 mm" in="0.7 s" hold="1 s"/>
    </motion></operator>
  </interaction>
</itouch>"""


def test_an_operator_who_does_not_wait_for_touch_off_is_noted_and_named_by_the_trip(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text(HURRIED.format(hold="1.2 s"))
    both = Lockstep(str(scene), only=["table"])
    assert (
        "'finger' rests for 1.3 s, then moves, and does not wait for the touch-off of 'table'"
        in capsys.readouterr().err
    )
    both.run()
    assert both.host.fault is not None
    assert both.host.fault.trip is Trip.SURFACE_SPEED
    assert "touch-off was not done, and until then the finger must rest" in both.host.fault.cause


def test_an_operator_who_rests_for_long_enough_is_not_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text(HURRIED.format(hold="7 s"))
    both = Lockstep(str(scene), only=["table"])
    both.host.close()
    both.world.close()
    assert "touch-off" not in capsys.readouterr().err


def test_two_rigs_in_step_run_at_once() -> None:
    """Their scene names fixed ports; each rig has its own."""
    scene = str(SCENES / "four_materials_wire.xml")
    rigs = [Lockstep(scene) for _ in range(2)]
    with rigs[0].serving(), rigs[1].serving():
        for both in rigs:
            both.host.enable()
            both.host.run(0.02)
            assert int(both.host.state["tick"]) == 20
            assert both.host.fault is None
            both.host.close()
            both.world.close()


def test_a_taken_address_and_wrong_options_are_told(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        virtual_rig([str(scene), "--report", "x.json"])
    assert "go with --run" in capsys.readouterr().err
    for words, said in ((["--pace", "real"], "--pace goes with --run"),
                        (["--run", "--pace", "real", "--only", "arm"], "go with --pace step")):  # fmt: skip
        with pytest.raises(SystemExit):
            virtual_rig([str(scene), *words])
        assert said in capsys.readouterr().err


def test_only_some_devices_are_on_their_wires(scene: Path, tmp_path: Path) -> None:
    """The rest goes straight from the session to the twins: nothing but their protocols is left out."""
    with (tmp_path / "wire.trace").open("w") as stream:
        both = Lockstep(str(scene), trace=stream, only=["peltier"])
        heights: list[float] = []
        both.host.taps.append(lambda _: heights.append(float(both.world.state["table.pose"][2])))
        report = both.run(1.5)
    assert report["faults"] == []
    assert not report["twins"]
    entries = read_trace((tmp_path / "wire.trace").read_text().splitlines())
    assert {entry.device for entry in entries} == {"peltier"}
    assert both.rig.driven  # the table obeys
    height = float(both.world.state["table.pose"][2])
    assert height == pytest.approx(float(both.host.state["table.pose"][2]), abs=1e-3)
    assert max(heights) > 0.005
    with pytest.raises(ItouchError, match="no device 'stage': the scene has arm, table, peltier"):
        Lockstep(str(scene), only=["stage"])


def gaps_of(scene: Path, seconds: float, **how: Any) -> list[int]:
    """Return the ticks from exchange to exchange of the display, which is not on a wire; the first is from State's zero."""
    both = Lockstep(str(scene), only=["arm"], **how)
    taken: list[int] = []
    both.host.taps.append(lambda _: taken.append(int(both.host.state["peltier.measured"][0])))
    both.run(seconds)
    return [int(gap) for gap in np.diff(sorted(set(taken)))]


def test_a_display_without_its_wire_is_exchanged_with_as_often_as_on_it(scene: Path) -> None:
    """Its controller counts on that: a display that obeys in every tick is another one than it knows."""
    gaps = gaps_of(scene, 1.0)[1:]
    assert len(gaps) > 20
    assert min(gaps) >= 20
    assert max(gaps) <= 32  # it waits so long for a command that differs


def test_exchanges_begin_later_or_as_a_bad_line_makes_them(scene: Path) -> None:
    steady, late = gaps_of(scene, 0.35), gaps_of(scene, 0.35, phase=7e-3)
    assert min(len(steady), len(late)) >= 10
    assert late[0] == steady[0] + 7
    assert late[1:10] == steady[1:10]
    shaken, again, other = (gaps_of(scene, 0.7, unsteady=True, seed=seed)[1:] for seed in (1, 1, 2))
    assert shaken == again != other
    assert min(shaken) >= 10
    assert max(shaken) <= 50  # one that is lost is made again 20 ms later
    assert len(set(shaken)) > 8


def test_in_real_time_devices_are_where_nobody_elses_are(tmp_path: Path) -> None:
    """In the scene itself, so that session, guardian and simulated devices all know it."""
    catalog, scene = Catalog(), load_scene(SCENES / "four_materials_wire.xml", twin="none")
    texts = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        text = write(placed(scene, catalog, str(tmp_path / name)))
        for fixed in ("127.0.0.1:3240", "127.0.0.1:5502", "/tmp/itouch-"):
            assert fixed not in text
        again = loads(text.encode(), catalog)
        assert [device.twin for device in again.devices] == [False] * 3
        texts.append(text)
    assert texts[0] != texts[1]
    kept = write(scene).replace("127.0.0.1:3240", "").replace("127.0.0.1:5502", "")
    assert len(kept.splitlines()) == len(texts[0].splitlines())


def in_real_time(scene: Path, folder: Path, *words: str) -> tuple[int, dict[str, Any]]:
    """Run in real time, in a process of its own that takes its priority along; return exit code and report."""
    report = folder / "report.json"
    command = [sys.executable, "-m", "itouch_tools.cli", "virtual-rig", str(scene), "--run", "--pace", "real"]
    done = subprocess.run([*command, "--report", str(report), *words], capture_output=True, text=True)
    assert report.is_file(), done.stderr
    return done.returncode, json.loads(report.read_text())


def test_a_session_in_real_time_is_told_what_the_twins_know(scene: Path, tmp_path: Path) -> None:
    """Whatever this machine's load makes of the run: session and rig begin, and their lateness is told."""
    code, found = in_real_time(scene, tmp_path, "--for", "1.5s")
    assert code == (1 if found["faults"] else 0)
    assert found["twins"] == []
    assert found["pace"] == "real"
    wires = found["wires"]
    assert 0 <= wires["truth_old"] < wires["ticks"] <= found["servo"]["ticks"]
    assert set(wires["surfaces"]) == {"table"}
    assert wires["machine"]["lateness_us"]["max"] >= wires["machine"]["lateness_us"]["p50"]
    assert wires["rig"]["lateness_us"]["p50"] is not None  # the devices were driven


@pytest.mark.long
def test_a_touch_in_real_time_is_judged_by_the_truth(scene: Path, tmp_path: Path) -> None:
    skip_unless_punctual(0.002)
    _, found = in_real_time(scene, tmp_path)
    if not found["wires"]["machine"]["held"]:
        not_here("this machine's wake-ups did not hold during the run")
    assert found["faults"] == []
    (contact,) = found["contacts"]
    assert contact["true_error_rms"] < 0.04
    assert contact["estimate_error_rms"] < 0.04
