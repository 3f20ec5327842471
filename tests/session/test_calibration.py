"""Calibrations on record: fitted from samples, dated, put into the scene, refused when they have expired."""

from __future__ import annotations

import datetime
import errno
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.loop import DeviceFaultError
from itouch.monitors import Trip
from itouch.plugin import poses
from itouch.schema import ItouchError, SceneError
from itouch.session import build, calibration, load_scene
from itouch_tools.cli import calibrate
from itouch_tools.cli import main as cli
from itouch_tools.cli.calibrate import rigid

ARM = """<itouch version="1.0" xmlns:usb-arm="urn:itouch:plugin:usb-arm" xmlns:thermal="urn:itouch:plugin:thermal">
  <materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices>
    <device name="arm" plugin="usb-arm"><mount pos="0 100 0 mm"/><usb-arm:hardware force-scale="2000"/></device>
    <device name="table" plugin="xyz-table"><mount pos="0 0 -50 mm" rpy="0 0 90 deg"/></device>
    <device name="plate" plugin="thermal"><thermal:hardware><thermal:labjack host="x">
      <thermal:flux-sensor sensitivity="1e-6"/></thermal:labjack></thermal:hardware></device>
  </devices>
  <interaction><probe name="finger" pose-from="arm" force-to="arm"/></interaction>
</itouch>"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(ARM)
    return path


def samples(tmp_path: Path, rows: np.ndarray, heading: str = "") -> str:
    file = tmp_path / "samples.csv"
    file.write_text(heading + "\n".join(",".join(f"{v:.9g}" for v in row) for row in rows) + "\n")
    return str(file)


def test_force_scale_from_a_scale(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = np.array([0.5, 1.0, 1.5, 2.0, 2.5])
    file = samples(tmp_path, np.stack([asked, 0.8 * asked + 0.05], axis=1), "asked,given\n")
    assert cli(["calibrate", str(scene), "--kind", "force-scale", "--samples", file]) == 0
    assert "force_scale = 2500" in capsys.readouterr().out
    (arm, _, _) = load_scene(scene).devices
    assert arm.parts[0].params.force_scale == pytest.approx(2500.0)
    assert load_scene(scene, records=False).devices[0].parts[0].params.force_scale == 2000.0
    assert load_scene(scene, twin="none").devices[0].parts[0].params.force_scale == 2000.0  # the record is the twin's
    (record,) = calibration.read_records(scene.with_suffix(".calibration.json"))
    assert (record.device, record.kind, record.twin, record.samples, record.unit) == (
        "arm",
        "force-scale",
        True,
        5,
        "N",
    )
    assert record.residual < 1e-9
    lasts = datetime.datetime.fromisoformat(record.expires) - datetime.datetime.fromisoformat(record.made)
    assert lasts == datetime.timedelta(days=180)


def test_a_disk_that_refuses_records_is_told_before_anything_is_measured(
    scene: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    class Typed:
        def readline(self) -> str:
            raise AssertionError("nobody must type what cannot be kept")

    monkeypatch.setattr("sys.stdin", Typed())
    monkeypatch.setattr("tempfile.TemporaryFile", full)
    assert cli(["calibrate", str(scene), "--kind", "force-scale", "--samples", "-"]) == 2
    assert "scene.calibration.json' cannot be written: No space left on device" in capsys.readouterr().err


def test_a_result_that_the_disk_refuses_is_told(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("itouch.session.calibration.write_whole", full)
    file = samples(tmp_path, np.array([[0.5, 0.4], [1.0, 0.8], [2.0, 1.6]]))
    assert cli(["calibrate", str(scene), "--kind", "force-scale", "--samples", file]) == 2
    said = capsys.readouterr()
    assert "force_scale = 2500" in said.out and "written to" not in said.out
    assert "cannot be written: No space left on device" in said.err


def test_extending_writes_nothing_where_no_record_has_expired(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = samples(tmp_path, np.array([[0.5, 0.4], [1.0, 0.8], [2.0, 1.6]]))
    assert cli(["calibrate", str(scene), "--kind", "force-scale", "--samples", file]) == 0
    monkeypatch.delattr("itouch.session.calibration.write_whole")
    assert cli(["calibrate", str(scene), "--extend"]) == 0
    assert "0 records extended" in capsys.readouterr().out


def test_an_expired_record_refuses_the_scene_until_it_is_extended(scene: Path, tmp_path: Path) -> None:
    file = samples(tmp_path, np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]))
    assert cli(["calibrate", str(scene), "--kind", "force-scale", "--samples", file, "--days", "30"]) == 0
    path = calibration.file_of(scene)
    (record,) = calibration.read_records(path)
    past = (calibration.now() - datetime.timedelta(days=1)).isoformat()
    made = (calibration.now() - datetime.timedelta(days=31)).isoformat()
    calibration.write_records(path, [replace(record, made=made, expires=past)])
    with pytest.raises(SceneError, match="calibration-stale.*\n|force-scale") as refusal:
        build(scene)
    assert "expired on" in str(refusal.value)
    assert "--extend" in str(refusal.value)
    assert cli(["run", str(scene), "--for", "0.01s", "--headless"]) == 2
    assert cli(["calibrate", str(scene), "--extend", "--device", "table"]) == 0
    assert calibration.read_records(path)[0].expires == past  # it is another's
    assert cli(["calibrate", str(scene), "--extend"]) == 0
    assert not calibration.read_records(path)[0].stale(calibration.now())
    build(scene).close()


def test_flux_gain_and_offset(scene: Path, tmp_path: Path) -> None:
    reference = np.array([0.0, 200.0, 500.0, 1000.0])
    file = samples(tmp_path, np.stack([reference, 1.1 * reference + 20.0], axis=1))
    assert cli(["calibrate", str(scene), "--kind", "flux-gain", "--samples", file]) == 0
    sensor = load_scene(scene).devices[2].parts[0].params.labjack.flux_sensor
    assert sensor.sensitivity == pytest.approx(1.1e-6)
    volts = (1.1 * 500.0 + 20.0) * 1e-6  # what the old sheet read as 570
    assert sensor.flux(volts, 296.15) == pytest.approx(500.0)


def test_mount_fit_finds_a_turned_and_shifted_arm(scene: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    truth = np.array([0.01, 0.02, 0.03, *poses.quaternion_from_rpy((0.3, -0.2, 1.1))])  # table from arm
    here = rng.uniform(-0.05, 0.05, (8, 3))
    there = np.array([poses.transform(truth, p) for p in here]) + rng.normal(0, 1e-4, (8, 3))
    file = samples(tmp_path, np.hstack([here, there]))
    assert (
        cli(["calibrate", str(scene), "--kind", "mount-fit", "--device", "arm", "--to", "table", "--samples", file])
        == 0
    )
    arm, table, _ = load_scene(scene).devices
    world_from_table = np.array(calibration.mount_pose(table.mount))
    expected = poses.compose(world_from_table, truth)
    got = np.array(calibration.mount_pose(arm.mount))
    assert got[:3] == pytest.approx(expected[:3], abs=3e-4)
    assert abs(got[3:] @ expected[3:]) == pytest.approx(1.0, abs=1e-5)
    (record,) = calibration.read_records(calibration.file_of(scene))
    assert 0.05 < record.residual < 0.3
    assert record.unit == "mm"


def test_rigid_fit_is_exact_and_refuses_lines() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        turn = rng.normal(size=4)
        pose = np.array([*rng.normal(size=3), *poses.normalized(tuple(turn))])
        points = rng.normal(size=(4, 3))
        found, rest = rigid(points, np.array([poses.transform(pose, p) for p in points]))
        assert rest < 1e-12
        assert found[:3] == pytest.approx(pose[:3], abs=1e-10)
        assert abs(found[3:] @ pose[3:]) == pytest.approx(1.0, abs=1e-12)
    line = np.outer(np.arange(4.0), (1.0, 2.0, 3.0))
    with pytest.raises(ValueError, match="on a line"):
        rigid(line, line)
    with pytest.raises(ValueError, match="three or more"):
        rigid(line[:2], line[:2])


def test_a_step_of_current_gives_the_module(scene: Path, tmp_path: Path) -> None:
    """The samples are those of a twin with another module, with the noise of its sensors."""
    from itouch_thermal.display.params import DisplayParams
    from itouch_thermal.drivers.fits import _simulate

    times = np.arange(0.0, 8.0, 0.05)
    currents = np.where(times < 0.5, 0.0, np.where(times < 4.0, 2.0, -1.5))
    module = {"seebeck": 0.055, "resistance": 1.6, "conductance": 0.65}
    shown = _simulate(DisplayParams(**module), times, currents, 296.15).reshape(2, -1)
    shown += np.random.default_rng(1).normal(0.0, [[0.01], [0.02]], shown.shape)
    file = samples(tmp_path, np.stack([times, currents, *shown], axis=1))
    assert cli(["calibrate", str(scene), "--kind", "tec-step", "--samples", file]) == 0
    params = load_scene(scene).devices[2].parts[0].params
    for name, value in module.items():
        assert getattr(params, name) == pytest.approx(value, rel=0.03), name
    (record,) = calibration.read_records(calibration.file_of(scene))
    assert record.residual < 0.03


def test_a_step_of_another_plate_is_doubted(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Twice the area, and a module of three times the resistance: told on the error stream, and nothing of its own step."""
    from itouch_thermal.display.params import DisplayParams
    from itouch_thermal.drivers.fits import _simulate

    times = np.arange(0.0, 8.0, 0.05)
    currents = np.where(times < 0.5, 0.0, np.where(times < 4.0, 2.0, -1.5))
    said = {}
    for name, other in (("own", {}), ("plate", {"area": 32e-4}), ("module", {"resistance": 5.6})):
        shown = _simulate(DisplayParams(**other), times, currents, 296.15).reshape(2, -1)
        shown += np.random.default_rng(1).normal(0.0, [[0.01], [0.02]], shown.shape)
        file = samples(tmp_path, np.stack([times, currents, *shown], axis=1))
        words = ["calibrate", str(scene), "--kind", "tec-step", "--samples", file]
        assert cli(words) == (0 if name == "own" else 2)
        said[name] = capsys.readouterr().err
        assert calibration.file_of(scene).exists() == (name == "own")
        if name != "own":  # nothing is kept of what is doubted, unless somebody says that it is right
            assert "is doubted, and nothing is kept" in said[name]
            assert cli([*words, "--doubted"]) == 0
            capsys.readouterr()
        calibration.file_of(scene).unlink()
    assert said["own"] == ""
    assert "another plate or sink, a finger on it" in said["plate"]
    assert said["module"].startswith("warning: resistance comes out 3 times what the scene says")


def test_touch_off_is_kept_and_used(tmp_path: Path) -> None:
    """The shipped rig's mount is 3 mm off: after a calibration on record a run without touch-off knows the height."""
    text = (SCENES / "four_materials.xml").read_text()
    (tmp_path / "scene.xml").write_text(text)
    for name in ("materials.xml", "rigs/twin.xml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text((SCENES / name).read_text())
    scene = tmp_path / "scene.xml"
    assert cli(["calibrate", str(scene), "--kind", "touch-off"]) == 0
    table = next(d for d in load_scene(scene).devices if d.name == "table")
    assert table.mount.pos[2] == pytest.approx(-0.011, abs=2e-4)  # written -8 mm, true -11
    assert load_scene(scene, records=False).devices[1].mount.pos[2] == -0.008
    # The twin stays where it truly is: it moved by the error at each record, so that no record ever was right of it.
    written = load_scene(scene, records=False).devices[1].mount
    true = np.subtract(written.pos, written.mount_error)
    for _ in range(2):
        table = next(d for d in load_scene(scene).devices if d.name == "table")
        assert np.subtract(table.mount.pos, table.mount.mount_error) == pytest.approx(true, abs=1e-12)
        assert table.mount.pos[2] == pytest.approx(true[2], abs=2e-4)
        assert cli(["calibrate", str(scene), "--kind", "touch-off"]) == 0


def test_a_device_that_fails_in_a_touch_off_is_a_fault_and_what_followed_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (SCENES / "four_materials.xml").read_text()
    fault = '<fault device="table" kind="disconnect" at="1 s"/></itouch>'
    for name in ("materials.xml", "rigs/twin.xml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text((SCENES / name).read_text())
    path = tmp_path / "scene.xml"
    path.write_text(text.replace("</itouch>", fault))
    assert cli(["calibrate", str(path), "--kind", "touch-off"]) == 1  # not 2: nothing is wrong with what was written
    said = capsys.readouterr().err
    assert "device 'table' " in said and "devices: " in said
    assert not path.with_suffix(".calibration.json").exists()


def test_what_a_touch_off_has_found_is_told_though_a_device_fails_when_the_session_closes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("four_materials.xml", "materials.xml", "rigs/twin.xml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text((SCENES / name).read_text())
    close = itouch.Session.close

    def lost(self: itouch.Session) -> None:
        close(self)
        raise DeviceFaultError("arm", 1, Trip.DEVICE_ERROR, "failed while the session ended")

    monkeypatch.setattr(itouch.Session, "close", lost)
    assert cli(["calibrate", str(tmp_path / "four_materials.xml"), "--kind", "touch-off"]) == 1
    said = capsys.readouterr()
    assert "failed while the session ended" in said.err
    found = re.search(r"mount at \S+ \S+ (\S+) mm", said.out)
    assert found is not None and float(found[1]) == pytest.approx(-11.0, abs=0.02)


def test_a_record_that_says_a_twin_is_where_it_can_not_be_is_refused(tmp_path: Path) -> None:
    error = '<mount pos="0 0 -50 mm" rpy="0 0 90 deg" mount-error="0 0 40 mm"/>'
    scene = tmp_path / "scene.xml"
    scene.write_text(ARM.replace('<mount pos="0 0 -50 mm" rpy="0 0 90 deg"/>', error))
    past = calibration.now()
    until = (past + datetime.timedelta(days=9)).isoformat()
    mount = (0.0, 0.0, -0.039, 1.0, 0.0, 0.0, 0.0)
    record = calibration.CalibrationRecord("table", "touch-off", True, past.isoformat(), until, {}, mount, 0.1, "mm", 3)
    calibration.write_records(calibration.file_of(scene), [record])
    with pytest.raises(SceneError, match="its mount is 51 mm from where the twin truly is .*at most 50 mm"):
        load_scene(scene)


def test_a_record_is_of_one_rigs_device_and_not_of_one_with_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The height of the scene's own table was put under every rig: the plate was 20 mm beside where it was taken to be."""
    felt = '<calibration method="touch-off"/>'
    devices = """<devices><device name="arm" plugin="usb-arm"><mount pos="0 100 0 mm"/></device>
      <device name="table" plugin="xyz-table"><mount pos="0 0 {} mm" mount-error="0 0 {} mm"/>{}</device></devices>"""
    text = ARM[: ARM.index("  <devices>")] + devices.format(-20, 3, felt) + ARM[ARM.index("  <interaction>") :]
    text = text.replace('force-to="arm"', 'force-to="arm" surface-to="table"').replace("0 0 10 mm", "0 0 0 mm")
    text = text.replace(
        "</interaction>",
        '<operator probe="finger"><motion><to pos="0 0 40 mm" in="1 ms" hold="9 s"/></motion></operator></interaction>',
    )
    scene, rig, lab = tmp_path / "scene.xml", tmp_path / "rig.xml", tmp_path / "lab"
    lab.mkdir()
    scene.write_text(text)
    rig.write_text(f'<itouch version="1.0">{devices.format(-40, 0, "")}</itouch>')
    assert cli(["calibrate", str(scene), "--kind", "touch-off"]) == 0

    def height(*other: Path) -> float:
        found: float = load_scene(scene, rig=other[0] if other else None).devices[1].mount.pos[2]
        return found

    assert height() == pytest.approx(-0.023, abs=2e-4)
    assert height(rig) == -0.04
    assert cli(["check", str(scene), "--rig", str(rig)]) == 0
    told = f"touch-off of 'table' in scene.calibration.json, which is of the scene's own devices; itouch-py calibrate {scene}"
    assert told in capsys.readouterr().out

    other = lab / "other.xml"  # a rig in a folder of its own: its records lie beside it, and hold under every scene
    other.write_text(f'<itouch version="1.0">{devices.format(-20, -2, felt)}</itouch>')
    assert cli(["calibrate", str(scene), "--rig", str(other), "--kind", "touch-off"]) == 0
    (record,) = calibration.read_records(lab / "other.calibration.json")
    assert record.mount[2] == pytest.approx(-0.018, abs=2e-4)
    assert height(other) == pytest.approx(-0.018, abs=2e-4)
    assert height() == pytest.approx(-0.023, abs=2e-4)
    past = (calibration.now() - datetime.timedelta(days=1)).isoformat()
    calibration.write_records(lab / "other.calibration.json", [replace(record, expires=past)])
    capsys.readouterr()
    assert cli(["check", str(scene), "--rig", str(other)]) == 2
    assert "itouch-py calibrate SCENE --rig RIG --device table --extend" in capsys.readouterr().err
    assert cli(["calibrate", str(scene), "--rig", str(other), "--extend"]) == 0
    assert "1 record extended" in capsys.readouterr().out
    assert cli(["check", str(scene), "--rig", str(other)]) == 0
    assert "not used with this rig" not in capsys.readouterr().out  # it has its own


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--kind", "colour"], "no device has a calibration 'colour'"),
        (["--kind", "mount-fit"], "several devices have a calibration 'mount-fit'"),
        (["--kind", "mount-fit", "--device", "arm"], "in whose frame"),
        (["--kind", "force-scale"], "as --samples: columns asked [N], given [N]"),
        (["--kind", "force-scale", "--samples", "/no/such"], "cannot be read"),
        (["--kind", "force-scale", "--samples", "BAD"], "sample 2 is '1 x'"),
        (["--kind", "force-scale", "--samples", "FEW"], "a line needs three samples"),
        (["--kind", "force-scale", "--samples", "GOOD", "--days", "-1"], "out of range"),
        (["--kind", "touch-off", "--device", "arm"], "no device has a calibration"),
        (["--kind", "mount-fit", "--device", "arm", "--to", "stool", "--samples", "PAIRS"], "in whose frame"),
        (["--kind", "mount-fit", "--device", "arm", "--to", "arm", "--samples", "PAIRS"], "in whose frame"),
    ],
)
def test_what_is_wrong_is_told(
    scene: Path, tmp_path: Path, words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {
        "BAD": "1 2\n1 x\n", "FEW": "1 1\n2 2\n", "GOOD": "1 1\n2 2\n3 3\n",
        "PAIRS": "0 0 0 1 0 0\n1 0 0 2 0 0\n0 1 0 1 1 0\n",
    }  # fmt: skip
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    words = [str(tmp_path / word) if word in files else word for word in words]
    assert cli(["calibrate", str(scene), *words]) == 2
    assert says in capsys.readouterr().err
    assert not calibration.file_of(scene).exists()


def test_a_broken_file_of_records_is_told(scene: Path) -> None:
    for content in (
        "{",
        "[]",
        json.dumps({"format": "x"}),
        json.dumps({"format": calibration.FORMAT, "records": [{}]}),
    ):
        calibration.file_of(scene).write_text(content)
        with pytest.raises(ItouchError, match="cannot be used"):
            load_scene(scene)


def test_what_a_device_lacks_a_part_for_is_not_offered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli(["calibrate", str(SCENES / "four_materials.xml")]) == 0
    out = capsys.readouterr().out
    assert "--kind flux-gain" not in out
    assert "peltier  no flux-gain: there is no <thermal:flux-sensor>" in out
    assert (
        cli(["calibrate", str(SCENES / "four_materials.xml"), "--kind", "flux-gain"]) == 2
    )  # and no samples asked for
    assert "there is no <thermal:flux-sensor>" in capsys.readouterr().err


def test_the_list_names_what_there_is(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert calibrate.main([str(scene)]) == 0
    out = capsys.readouterr().out
    for words in ("arm  --kind force-scale", "plate  --kind tec-step", "table  --kind touch-off", "no records"):
        assert words in out
