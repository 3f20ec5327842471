"""Calibrations with bad input: hostile records, wrong samples, what has expired, files of another place."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.schema import ItouchError, SceneError
from itouch.session import calibration, load_scene
from itouch_tools.cli import main as cli
from itouch_tools.cli.calibrate import rigid

ARM = """<itouch version="1.0" xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <devices>
    <device name="arm" plugin="usb-arm"><mount pos="0 100 0 mm"/>
      <calibration method="none" stored-in="records/arm.json"/><usb-arm:hardware force-scale="2000"/></device>
    <device name="table" plugin="xyz-table"/>
  </devices>
</itouch>"""
GOOD = np.array([[1.0, 0.8], [2.0, 1.6], [3.0, 2.4]])


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(ARM)
    (tmp_path / "records").mkdir()
    return path


def fit(scene: Path, rows: Any, *words: str) -> int:
    file = scene.parent / "samples.csv"
    file.write_text("\n".join(" ".join(str(v) for v in row) for row in rows))
    return cli(["calibrate", str(scene), "--kind", "force-scale", "--samples", str(file), *words])


def scale(scene: Path) -> float:
    found = load_scene(scene).devices[0].parts[0].params.force_scale
    assert isinstance(found, float)
    return found


def test_records_are_kept_where_the_scene_says(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fit(scene, GOOD) == 0
    stored = scene.parent / "records/arm.json"
    assert stored.exists()
    assert not calibration.file_of(scene).exists()
    assert scale(scene) == pytest.approx(2500.0)
    capsys.readouterr()
    assert cli(["calibrate", str(scene)]) == 0
    assert "force_scale = 2500" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["arm.txt", "arm"])
def test_records_are_used_whatever_the_name_of_their_file(scene: Path, name: str) -> None:
    scene.write_text(ARM.replace("arm.json", name))
    assert fit(scene, GOOD) == 0 and (scene.parent / "records" / name).exists()
    assert scale(scene) == pytest.approx(2500.0)
    assert cli(["check", str(scene)]) == 0


@pytest.mark.parametrize("name", ["scene.XML", "scene.txt"])
def test_records_are_used_whatever_the_name_of_the_scene(scene: Path, name: str) -> None:
    scene = scene.rename(scene.parent / name)
    scene.write_text(ARM.replace('stored-in="records/arm.json"', ""))
    assert fit(scene, GOOD) == 0 and calibration.file_of(scene).exists()
    assert scale(scene) == pytest.approx(2500.0)


def test_a_second_calibration_begins_from_the_first(scene: Path) -> None:
    """What is measured with a record in force corrects that, not the scene's number."""
    assert fit(scene, GOOD) == 0
    assert fit(scene, [[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]) == 0
    assert scale(scene) == pytest.approx(2500.0)


def test_records_that_a_link_shares_stay_shared(scene: Path) -> None:
    shared = scene.parent / "laboratory.json"
    link = scene.parent / "records/arm.json"
    assert fit(scene, GOOD) == 0
    link.rename(shared)
    link.symlink_to(shared)
    assert fit(scene, [(a, 0.5 * b) for a, b in GOOD]) == 0
    assert link.is_symlink()
    (record,) = calibration.read_records(shared)
    assert record.values["force_scale"] == pytest.approx(scale(scene)) == pytest.approx(6250.0)


@pytest.mark.parametrize("linked", ["records/arm.json", "records"])
def test_records_behind_a_link_that_leads_nowhere_are_told(
    scene: Path, linked: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A share that was not mounted held no records: a run went by the scene's own numbers without a word."""
    share, link = scene.parent / "share", scene.parent / linked
    assert fit(scene, GOOD) == 0
    assert all("calibration records" not in notice for notice in itouch.build(scene).notices)
    link.rename(share)
    link.symlink_to(share)
    assert scale(scene) == pytest.approx(2500.0)
    gone = share.rename(scene.parent / "unmounted")
    assert scale(scene) == pytest.approx(2000.0)
    (told,) = [notice for notice in itouch.build(scene).report()["notices"] if "calibration records" in notice]
    assert f"'{link}' is a link to '{share}', which is not there" in told
    capsys.readouterr()
    for command in ("check", "calibrate"):
        assert cli([command, str(scene)]) == 0
        assert told in " ".join(capsys.readouterr().out.split()).replace("- ", "")
    gone.rename(share)
    assert all("calibration records" not in notice for notice in itouch.build(scene).notices)


def test_a_calibration_through_a_link_to_a_new_file_is_nothing_to_tell(scene: Path) -> None:
    (scene.parent / "records/arm.json").symlink_to(scene.parent / "laboratory.json")
    assert fit(scene, GOOD) == 0
    assert (scene.parent / "records/arm.json").is_symlink()
    assert scale(scene) == pytest.approx(2500.0)
    assert all("calibration records" not in notice for notice in itouch.build(scene).notices)


def test_a_calibration_makes_the_folder_that_the_scene_names(scene: Path) -> None:
    (scene.parent / "records").rmdir()
    assert fit(scene, GOOD) == 0
    assert scale(scene) == pytest.approx(2500.0)


@pytest.mark.parametrize(
    "change",
    [
        {"mount": [0, 0, 0]}, {"mount": [0, 0, 0, 0, 0, 0, 0]}, {"mount": [0, 0, float("inf"), 1, 0, 0, 0]},
        {"mount": [10**400, 0, 0, 1, 0, 0, 0]}, {"mount": [1e300, 0, 0, 1, 0, 0, 0]}, {"mount": [0, 0, 0, 1e-300, 0, 0, 0]},
        {"mount": [0, 0, 0, 1e200, 1e200, 0, 0]}, {"residual": 10**400},
        {"mount": "1234567"}, {"values": {"force_scale": "x"}}, {"values": [1]}, {"values": {"force_scale": True}},
        {"made": "yesterday"}, {"made": "2026-01-01T00:00:00"}, {"expires": None}, {"residual": "small"},
        {"residual": None}, {"residual": -0.1}, {"samples": -3}, {"samples": 2.5}, {"samples": [3]}, {"twin": "no"}, {"device": 5}, {"kind": None}, {"more": 1},
    ],
    ids=lambda change: str(change)[:60],
)  # fmt: skip
def test_a_record_that_was_changed_by_hand_is_told(scene: Path, change: dict[str, Any]) -> None:
    assert fit(scene, GOOD) == 0
    stored = scene.parent / "records/arm.json"
    (record,) = calibration.read_records(stored)
    stored.write_text(json.dumps({"format": calibration.FORMAT, "records": [asdict(record) | change]}))
    with pytest.raises(ItouchError, match="cannot be used"):
        load_scene(scene)
    for words in ([], ["--extend"]):
        assert cli(["calibrate", str(scene), *words]) == 2


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"device": "am"},
            "of a device 'am', which the scene does not have*did you mean 'arm'? If not, remove the record",
        ),
        ({"kind": "force-scal"}, "device 'arm' has no calibration 'force-scal' (arm.json)*did you mean 'force-scale'?"),
    ],
)
def test_a_record_of_a_device_or_kind_that_does_not_exist_is_told(
    scene: Path, change: dict[str, Any], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """By check and by a run: otherwise the scene would go on without what was measured, and nobody would notice."""
    assert fit(scene, GOOD) == 0
    stored = scene.parent / "records/arm.json"
    (record,) = calibration.read_records(stored)
    calibration.write_records(stored, [replace(record, **change)])
    capsys.readouterr()
    for words in (["check", str(scene)], ["run", str(scene), "--headless", "--for", "0.1s"]):
        assert cli(words) == 2
        told = capsys.readouterr().err
        assert all(part in told for part in said.split("*")), told
    assert cli(["calibrate", str(scene)]) == 0


def test_check_looks_at_the_records_as_a_run_does(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fit(scene, GOOD) == 0
    stored = scene.parent / "records/arm.json"
    (record,) = calibration.read_records(stored)
    past = (calibration.now() - datetime.timedelta(days=1)).isoformat()
    calibration.write_records(stored, [replace(record, expires=past)])
    capsys.readouterr()
    assert cli(["check", str(scene)]) == 2
    assert f"it expired on {past[:10]}" in capsys.readouterr().err


def test_a_record_from_the_future_is_refused_until_somebody_confirms_it(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Made by a clock that was wrong, it would hold for as long as that was ahead."""
    assert fit(scene, GOOD) == 0
    stored = scene.parent / "records/arm.json"
    (record,) = calibration.read_records(stored)
    ahead = [(calibration.now() + datetime.timedelta(days=days)).isoformat() for days in (900, 930)]
    calibration.write_records(stored, [replace(record, made=ahead[0], expires=ahead[1])])
    capsys.readouterr()
    assert cli(["check", str(scene)]) == 2
    assert f"it is dated {ahead[0][:10]}, in the future" in capsys.readouterr().err
    assert cli(["calibrate", str(scene)]) == 0
    assert "(IN THE FUTURE)" in capsys.readouterr().out
    assert cli(["calibrate", str(scene), "--device", "arm", "--extend"]) == 0
    assert cli(["check", str(scene)]) == 0
    (again,) = calibration.read_records(stored)
    lasts = datetime.datetime.fromisoformat(again.expires) - calibration.now()
    assert datetime.timedelta(days=29) < lasts <= datetime.timedelta(days=30)
    slightly = (calibration.now() + datetime.timedelta(hours=2)).isoformat()
    calibration.write_records(stored, [replace(record, made=slightly)])  # clocks differ
    assert cli(["check", str(scene)]) == 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[1]", 'it must be a JSON object, {"format": ..., "records": [...]}'),
        ('{"format": "FORMAT", "records": 5}', "it must be a JSON object"),
        ('{"format": "FORMAT", "records": [5]}', "record 1: it must be a JSON object"),
        ('{"format": "FORMAT", "records": [{"device": 1, "kid": 2}]}', "record 1: 'device' must be text; record 1: 'kind' is"),
        ('{"format": "FORMAT",\n "records": [}', "it is not JSON from PATH:2:14 on"),
        ('{"format": "mine", "records": []}', "its format is 'mine', this program reads 'FORMAT'"),
    ],
)  # fmt: skip
def test_a_file_of_records_that_cannot_be_read_is_told_in_plain_words(scene: Path, text: str, said: str) -> None:
    stored = scene.parent / "records/arm.json"
    stored.write_text(text.replace("FORMAT", calibration.FORMAT))
    with pytest.raises(ItouchError) as caught:
        load_scene(scene)
    assert said.replace("FORMAT", calibration.FORMAT).replace("PATH", str(stored)) in str(caught.value)
    assert not any(word in str(caught.value) for word in ("list indices", "argument", "CalibrationRecord"))


@pytest.mark.parametrize(
    ("change", "said", "place"),
    [
        (lambda text: text[:100], "it is not JSON", ":6:12"),
        (lambda text: text.replace('"samples": 3', f'"samples": {"9" * 5000}'), "'samples' must be a whole number", ":1:1"),
        (lambda text: text.replace('"twin": true', '"twin": true, "twin": false'), "an object in it has 'twin' twice", ":1:1"),
        (lambda text: text + " " * calibration.MOST, "it is larger than 8 MiB", ":1:1"),
        (lambda text: text.replace("[", f"[{', '.join(['{}'] * 99)}, ", 1), "'values' is missing; and 984 more\n", ":1:1"),
        (lambda text: text.replace('"arm"', '"\xe4rm"').encode("latin-1"), "it is not UTF-8 text", ":1:1"),
    ],
    ids=["cut", "digits", "twice", "huge", "many", "latin"],
)  # fmt: skip
def test_a_damaged_file_of_records_is_told_briefly_and_at_its_place(
    scene: Path, change: Callable[[str], str | bytes], said: str, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit(scene, GOOD) == 0
    stored = scene.parent / "records/arm.json"
    damaged = change(stored.read_text())
    stored.write_bytes(damaged if isinstance(damaged, bytes) else damaged.encode())
    for words in (["check"], ["calibrate"]):
        capsys.readouterr()
        assert cli([*words, str(scene)]) == 2
        told = capsys.readouterr().err
        assert said in told and f"--> {stored}{place}\n" in told and len(told) < 1500


def test_two_records_of_one_thing_are_told(scene: Path) -> None:
    assert fit(scene, GOOD) == 0
    stored = scene.parent / "records/arm.json"
    (record,) = calibration.read_records(stored)
    calibration.write_records(stored, [record, replace(record, twin=False)])
    assert scale(scene) == pytest.approx(2500.0)
    calibration.write_records(stored, [record, replace(record, values={"force_scale": 3000.0})])
    with pytest.raises(SceneError, match="record 2: it is of the same device and kind as record 1"):
        load_scene(scene)


@pytest.mark.parametrize("command", ["check", "calibrate"])
def test_a_file_of_records_that_the_system_refuses_to_open_is_told(
    scene: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A ring of links held no records, and a name that is too long, or a folder that is closed, ended in a traceback."""
    stored = scene.parent / "records/arm.json"
    stored.symlink_to(stored.name)
    assert cli([command, str(scene)]) == 2
    assert "symbolic links" in capsys.readouterr().err
    scene.write_text(ARM.replace("arm.json", f"{'a' * 300}.json"))
    assert cli([command, str(scene)]) == 2
    assert "too long" in capsys.readouterr().err


@pytest.mark.parametrize("value", [5.0, 1e9, -2000.0])
def test_a_value_out_of_its_range_refuses_the_scene(scene: Path, value: float) -> None:
    assert fit(scene, GOOD) == 0
    stored = scene.parent / "records/arm.json"
    (record,) = calibration.read_records(stored)
    calibration.write_records(stored, [replace(record, values={"force_scale": value})])
    with pytest.raises(SceneError, match="force-scale.*cannot be used"):
        load_scene(scene)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("grip", "its parameter 'grip' is not a single number"), ("usbip", "its parameter 'usbip' is not a single number"),
        ("grip.x", "the device has no parameter 'x'"), ("force", "the device has no parameter 'force'"),
    ],
)  # fmt: skip
def test_a_value_of_what_is_no_number_refuses_the_scene(scene: Path, name: str, said: str) -> None:
    assert fit(scene, GOOD) == 0
    stored = scene.parent / "records/arm.json"
    (record,) = calibration.read_records(stored)
    calibration.write_records(stored, [replace(record, values={name: 1.0})])
    with pytest.raises(SceneError, match=f"force-scale.*cannot be used: {said}"):
        load_scene(scene)


def test_what_has_expired_can_be_measured_anew(tmp_path: Path) -> None:
    text = (SCENES / "four_materials.xml").read_text()
    (tmp_path / "scene.xml").write_text(text)
    for name in ("materials.xml", "rigs/twin.xml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text((SCENES / name).read_text())
    scene = tmp_path / "scene.xml"
    past = (calibration.now() - datetime.timedelta(days=1)).isoformat()
    mount = (0.0, 0.0, -0.03, 1.0, 0.0, 0.0, 0.0)
    record = calibration.CalibrationRecord("table", "touch-off", True, past, past, {}, mount, 0.1, "mm", 3)
    calibration.write_records(calibration.file_of(scene), [record])
    with pytest.raises(SceneError, match="touch-off"):
        load_scene(scene)
    assert cli(["calibrate", str(scene), "--kind", "touch-off"]) == 0
    table = next(d for d in load_scene(scene).devices if d.name == "table")
    assert table.mount.pos[2] == pytest.approx(-0.011, abs=2e-4)


@pytest.mark.parametrize("days", ["nan", "inf", "-5", "0", "1e9"])
@pytest.mark.parametrize("extend", [False, True])
def test_days_out_of_range(scene: Path, days: str, extend: bool, capsys: pytest.CaptureFixture[str]) -> None:
    code = (
        cli(["calibrate", str(scene), "--extend", f"--days={days}"]) if extend else fit(scene, GOOD, f"--days={days}")
    )
    assert code == 2
    assert "out of range" in capsys.readouterr().err


@pytest.mark.parametrize(
    "rows",
    [
        [], [[1.0, 1.0]], [[1.0, 1.0]] * 5, [[1.0, -1.0], [2.0, -2.0], [3.0, -3.0]], [["nan", 1], [2, 2], [3, 3]],
        [[1, 1e-9], [2, 2e-9], [3, 3e-9]], [[1, 1e6], [2, 2e6], [3, 3e6]], [[1, 2, 3]] * 3, [["1,5", "x"]],
    ],
    ids=lambda change: str(change)[:60],
)  # fmt: skip
def test_samples_that_make_no_scale(scene: Path, rows: list[Any], capsys: pytest.CaptureFixture[str]) -> None:
    assert fit(scene, rows) == 2
    assert capsys.readouterr().err.startswith(("error", "calibration", "sample"))
    assert not (scene.parent / "records/arm.json").exists()


def test_pairs_that_fit_nothing_rigid_are_refused() -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.05, 0.05, (6, 3))
    with pytest.raises(ValueError, match="no axis reversed"):
        rigid(points, points * (1.0, 1.0, -1.0))
    with pytest.raises(ValueError, match="in metres"):
        rigid(points, points * 1000.0)
    line = np.outer(np.linspace(0.0, 0.1, 5), (1.0, 0.0, 0.0)) + rng.normal(0.0, 1e-4, (5, 3))
    with pytest.raises(ValueError, match="on a line"):
        rigid(line, line)
    pose, left = rigid(points, points + rng.normal(0.0, 1e-4, points.shape))
    assert left < 5e-4
    assert pose[3] == pytest.approx(1.0, abs=1e-3)
