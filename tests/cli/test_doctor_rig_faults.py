"""What the doctor says of devices that go silent, drive by themselves, are lost, or do not let go."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest

import itouch
from itouch.loop import VirtualClock
from itouch.plugin import Channel, Device, DeviceError, Record, Role, current, measured_wrench, pose, pose_target
from itouch.plugin.discovery import Catalog, Found, find
from itouch.session import Session
from itouch_tools.cli import main
from itouch_tools.cli.doctor import rig_checks
from itouch_tools.cli.doctor.diagnosis import Diagnosis

SCENE = """<itouch version="1.0">
  <devices><device name="stage" plugin="stage" twin="no"/>
  <device name="second" plugin="second" twin="no" optional="yes"/></devices>
</itouch>
"""


@dataclass(frozen=True)
class Params:
    """Nothing."""


class Stage(Device):
    """A stage that stands in its travel, a force sensor that feels nothing, a drive that is off."""

    watchdog = 0.05

    Params: ClassVar[type] = Params
    reads = (pose(), measured_wrench(), Channel("drive", 1, "A", (-5.0,), (5.0,), role=Role.DELIVERED_DRIVE))
    commands = (
        pose_target(low=(-0.05, -0.05, 0.0), high=(0.05, 0.05, 0.05), speed=0.1),
        current("current", limit=5.0, harmless="a test drives nothing"),
    )

    def open(self) -> None:
        self.count = self.written = 0

    def close(self) -> None: ...

    def read(self, reading: Record) -> bool | None:
        self.count += 1
        reading["pose"] = (0.0, 0.0, 0.02 + 1e-6 * (self.count % 2), 1.0, 0.0, 0.0, 0.0)
        return True

    def write(self, command: Record) -> None:
        self.written += 1


class Entry:
    """What stands for an entry point."""

    def __init__(self, value: type) -> None:
        self.value, self._loaded = value.__name__, value

    def load(self) -> type:
        return self._loaded


def devices(stage: type[Device], second: type[Device] = Stage) -> Catalog:
    def finder(group: str) -> dict[str, Found]:
        found: dict[str, Any] = dict(find(group))
        if group == "itouch.devices":
            for name, cls in (("stage", stage), ("second", second)):
                found[name] = Found(name, "itouch-stage", "1.0", Entry(cls))  # type: ignore[arg-type]
        return found

    return Catalog(finder)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    return tmp_path / "scene.xml"


def examined(path: Path, catalog: Catalog, seconds: float = 0.02) -> tuple[dict[str, Diagnosis], Session]:
    session = itouch.build(path, catalog=catalog)
    session.clock = VirtualClock()
    return {one.name: one for one in rig_checks.examine_rig(session, seconds)}, session


def test_a_stage_without_faults_passes_every_check(path: Path) -> None:
    found, _ = examined(path, devices(Stage))
    names = ("W1", "T8", "K4", "K6", "T9")
    assert [found[f"{name} stage"].status for name in names] == ["pass"] * 5
    assert found["K6 stage"].found.startswith("it stands at 0.0 0.0 20.0 mm")


def test_a_silent_device_passes_no_check(path: Path) -> None:
    class Silent(Stage):
        def read(self, reading: Record) -> bool | None:
            super().read(reading)
            return self.count == 1  # it answers when it is opened, and never again

    found, _ = examined(path, devices(Silent))
    assert found["W1 stage"].status == "fail"
    assert "nothing came in 0.02 s" in found["W1 stage"].found
    told = {name: found[f"{name} stage"].status for name in ("T8", "K4", "K6", "T9")}
    assert set(told.values()) == {"not possible"}, told
    assert found["W1 second"].status == "pass"


def test_a_drive_that_swings_round_zero_is_seen(path: Path) -> None:
    class Swinging(Stage):
        def read(self, reading: Record) -> bool | None:
            super().read(reading)
            reading["drive"] = 1.0 if self.count % 2 else -1.0
            return True

    found, _ = examined(path, devices(Swinging))
    assert found["T9 stage"].status == "fail"
    assert "reads 1 at most" in found["T9 stage"].found


def test_a_stage_that_goes_down_is_where_it_is_now(path: Path) -> None:
    class Sinking(Stage):
        def read(self, reading: Record) -> bool | None:
            super().read(reading)
            reading["pose"][2] = max(-0.004, 0.02 - 2e-3 * self.count)  # below its travel at the end only
            return True

    found, _ = examined(path, devices(Sinking))
    assert found["K6 stage"].status == "fail"
    assert "0.0 0.0 -4.0 mm, out of its travel" in found["K6 stage"].found


def test_an_optional_device_that_is_lost_is_a_fault(path: Path) -> None:
    class Lost(Stage):
        def read(self, reading: Record) -> bool | None:
            super().read(reading)
            if self.count > 10:
                raise DeviceError("the cable is out")
            return True

    found, _ = examined(path, devices(Stage, Lost))
    assert found["T8 second"].status == "fail" and "the cable is out" in found["T8 second"].found
    assert found["T8 stage"].status == "pass"


def test_an_optional_device_may_be_lost_while_all_are_stopped(path: Path) -> None:
    class Lost(Stage):
        def write(self, command: Record) -> None:
            super().write(command)
            if self.written > 25:  # 20 ticks are watched
                raise DeviceError("the cable is out")

    found, session = examined(path, devices(Stage, Lost))
    assert [entry["device"] for entry in session.statistics.faults] == ["stage", "second"]
    assert "stage: " in found["W2"].found and "second: " in found["W2"].found


def test_a_device_that_does_not_let_go_fails_and_the_verdict_is_printed(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Unwilling(Stage):
        def close(self) -> None:
            raise RuntimeError("it does not let go")

    session = itouch.build(path, catalog=devices(Unwilling))
    monkeypatch.setattr("itouch.servo.prepare.prepare", lambda *_, **__: session)
    assert main(["doctor", "--rig", str(path), "--for", "0.02s"]) == 1
    lines = capsys.readouterr().out.splitlines()
    (told,) = [line for line in lines if "does not let go" in line]
    assert told.startswith("fail") and "device 'stage' could not be released" in told
    assert "lines fail" in lines[-1]


def test_a_scene_alone_is_told_which_options_take_it(capsys: pytest.CaptureFixture[str]) -> None:
    for words, told in (
        (["rig.xml"], ("--rig rig.xml to look at the devices", "--rates rig.xml to see which rate")),
        (["--json", "rig.xml"], ("no option takes 'rig.xml'",)),
        (["--sorted", "rig.xml"], ("unrecognized arguments: --sorted",)),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["doctor", *words])
        assert ended.value.code == 2
        err = capsys.readouterr().err
        assert all(part in err for part in told), err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--rig", "scene.xml", "--for", "0s"), "--for must be more than 0 s"),
        (("--for", "2s"), "--for goes with --rig"),
        (("--twin", "all"), "--twin goes with --rig"),
        (("--rig", "scene.xml", "--busy", "2"), "--busy goes with --rates"),
    ],
)
def test_options_that_say_nothing_are_refused(
    words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["doctor", *words])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_what_was_noted_of_an_error_is_told_with_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(words: list[str]) -> int:
        error = DeviceError("the cable is out")
        error.add_note("then: device 'stage' could not be released")
        raise error

    monkeypatch.setattr("itouch_tools.cli._dispatch", fail)
    assert main(["doctor"]) == 2
    assert capsys.readouterr().err == "the cable is out\nthen: device 'stage' could not be released\n"
