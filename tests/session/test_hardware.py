"""Hardware in sessions: it starts open and is enabled by an explicit act; its recordings replay without it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest

import itouch
from itouch.plugin import Device, DeviceError, Record, deadman, pose, wrench
from itouch.plugin.discovery import Catalog, Found, find
from itouch.safety import Trip

SCENE = """<itouch version="1.0">
  <materials><material name="wood"><contact stiffness="0.5 N/mm"/></material></materials>
  <world><box name="block" size="4 4 2 cm" pos="0 0 1 cm" material="wood"/></world>
  <devices><device name="stick" plugin="stick" twin="no"/></devices>
  <interaction><probe name="finger" radius="5 mm" pose-from="stick" force-to="stick"/></interaction>
</itouch>
"""


@dataclass(frozen=True)
class Params:
    """Nothing."""


def stick(*, moves: bool = False, missing: bool = False, fails_at: int = -1) -> type[Device]:
    class Stick(Device):
        """A stick that dips onto the block again and again, by its own time."""

        reads = (pose(), deadman())
        commands = (wrench(force=3.0),)
        second_opener: ClassVar[bool] = True
        moves_on_open: ClassVar[bool] = moves
        opened: ClassVar[list[str]] = []

        def open(self) -> None:
            if missing:
                raise DeviceError("no stick is plugged in")
            self.opened.append("open")
            self.count = 0

        def close(self) -> None:
            self.opened.append("close")

        def read(self, reading: Record) -> bool | None:
            self.count += 1
            if self.count == fails_at:
                raise DeviceError("the cable is out")
            if self.count % 7 == 3:
                return False  # nothing new
            reading["deadman"] = 1.0
            height = 0.03 - 0.008 * math.sin(self.count * 0.01) ** 2
            reading["pose"] = (0.001 * math.sin(self.count * 0.003), 0.0, height, 1.0, 0.0, 0.0, 0.0)
            return True

    Stick.Params = Params
    return Stick


class Entry:
    """What stands for an entry point."""

    def __init__(self, value: type) -> None:
        self.value, self._loaded = value.__name__, value

    def load(self) -> type:
        return self._loaded


def catalog(cls: type[Device]) -> Catalog:
    def finder(group: str) -> dict[str, Found]:
        found: dict[str, Any] = dict(find(group))
        if group == "itouch.devices":
            found["stick"] = Found("stick", "itouch-stick", "1.0", Entry(cls))  # type: ignore[arg-type]
        return found

    return Catalog(finder)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    return tmp_path / "scene.xml"


def saved(scene: Path) -> Path:
    session = itouch.build(scene, catalog=catalog(stick()))
    session.enable()
    for _ in range(200):
        session.tick()
    session.save(scene.parent / "s.itouch")
    session.close()
    return scene.parent / "s.itouch"


def test_restored_hardware_is_open_and_waits(scene: Path) -> None:
    cls = stick()
    session = itouch.restore(saved(scene), catalog=catalog(cls))
    assert session.status("stick").name == "OPEN"
    assert cls.opened == ["open"]
    with pytest.raises(itouch.EngineError, match="enable"):
        session.tick()
    assert (
        session.state["stick.sent.wrench"].tolist()
        == itouch.restore(saved(scene), catalog=catalog(stick())).state["stick.sent.wrench"].tolist()
    )
    session.enable()
    session.tick()
    assert session.status("stick").name == "ENABLED"
    assert cls.opened == ["open"]
    session.close()
    assert cls.opened == ["open", "close"]


def unwilling(scene: Path, error: Exception) -> tuple[itouch.Session, type[Device]]:
    """Return a session of two devices that raise when they are released."""
    cls = stick()

    def close(self: Any) -> None:
        self.opened.append("close")
        raise error

    cls.close = close  # type: ignore[method-assign]
    text = scene.read_text(encoding="utf-8")
    text = text.replace("<devices>", '<devices><device name="other" plugin="stick" twin="no"/>')
    scene.write_text(text.replace("<interaction>", '<interaction><probe name="thumb" pose-from="other"/>'))
    session = itouch.build(scene, catalog=catalog(cls))
    session.enable()
    session.tick()
    return session, cls


@pytest.mark.parametrize("error", [RuntimeError("it does not let go"), DeviceError("it does not let go")])
def test_a_device_that_raises_when_it_is_released_keeps_no_other_open(scene: Path, error: Exception) -> None:
    session, cls = unwilling(scene, error)
    with pytest.raises(DeviceError, match="device 'other' could not be released: .*does not let go") as caught:
        session.close()
    assert caught.value.__cause__ is error
    assert "device 'stick' could not be released" in caught.value.__notes__[0]
    assert cls.opened == ["open", "open", "close", "close"]
    assert {session.status(name).name for name in ("stick", "other")} == {"CLOSED"}


def test_what_is_kept_is_ended_though_a_device_raises_at_its_release(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "kept"))
    text = scene.read_text(encoding="utf-8")
    scene.write_text(text.replace("<materials>", '<safety participant="P07"/><materials>', 1), encoding="utf-8")
    session, _ = unwilling(scene, RuntimeError("it does not let go"))
    session.record(tmp_path / "r.mcap")
    session.run(0.01)
    with pytest.raises(DeviceError, match="could not be released"):
        session.close()
    assert session.recorder is None
    assert not session.taps  # neither the recording nor the participant listens any more
    assert len(itouch.read(tmp_path / "r.mcap").ticks) >= 10  # whole, with what the safe sequence took


def test_a_release_that_fails_does_not_hide_the_error_under_way(scene: Path) -> None:
    session, cls = unwilling(scene, RuntimeError("it does not let go"))
    with pytest.raises(ZeroDivisionError) as caught, session:
        raise ZeroDivisionError("of somebody's own code")
    assert any("device 'other' could not be released" in note for note in caught.value.__notes__)
    assert cls.opened == ["open", "open", "close", "close"]


def test_hardware_without_a_watchdog_is_not_enabled_where_no_guardian_can_be(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was, with a notice; the guardian of this process does not know the stick."""
    monkeypatch.setattr(itouch.Session, "GUARDIAN", "itouch.servo.own_guardian:watch")
    session = itouch.build(scene, catalog=catalog(stick()))
    with pytest.raises(DeviceError, match="device 'stick' keeps its last command if this program dies, and a guardian"):
        session.enable()
    session.guarded = True  # as in a servo process
    session.enable()
    session.close()
    guarding = type("Guarding", (stick(),), {"watchdog": 0.05})
    with itouch.build(scene, catalog=catalog(guarding)) as session:
        session.enable()
        session.tick()


def test_what_moves_when_opened_or_is_missing_stays_closed_and_that_is_said(scene: Path) -> None:
    path = saved(scene)
    moving = stick(moves=True)
    session = itouch.restore(path, catalog=catalog(moving))
    assert session.status("stick").name == "CLOSED"
    assert moving.opened == []
    assert "device 'stick' stays closed until it is enabled: opening it moves it" in session.notices
    absent = itouch.restore(path, catalog=catalog(stick(missing=True)))
    assert "device 'stick' stays closed: no stick is plugged in" in absent.notices
    assert int(absent.state["tick"]) == 200


@pytest.mark.parametrize("fails_at", [-1, 700])
def test_a_recording_of_hardware_replays_without_it(scene: Path, fails_at: int) -> None:
    session = itouch.build(scene, catalog=catalog(stick(fails_at=fails_at)))
    session.record(scene.parent / "r.mcap")
    session.enable()
    try:
        for _ in range(1500):
            session.tick()
    except itouch.DeviceFaultError:
        assert fails_at > 0
    session.close()
    recording = itouch.read(scene.parent / "r.mcap")
    assert abs(recording["stick.sent.wrench"]).max() > 0.1
    cls = stick()
    outcome = itouch.replay(recording, catalog=catalog(cls))
    assert (outcome.mismatches, outcome.first, outcome.skipped) == (0, None, 0)
    assert outcome.ticks == len(recording.ticks)
    assert cls.opened == []


class MuteError(DeviceError):
    """Fails when it is asked what it says."""

    def __str__(self) -> str:
        raise SystemExit(3)

    __repr__ = __str__


class MuteOtherError(RuntimeError):
    """The same of any other error."""

    __str__ = __repr__ = MuteError.__str__


@pytest.mark.parametrize("kind", [MuteError, MuteOtherError])
@pytest.mark.parametrize("where", ["open", "read", "write", "close"])
def test_an_error_that_fails_to_say_why_is_an_error_like_any_other(
    scene: Path, kind: type[Exception], where: str
) -> None:
    cls, sent = stick(), list[float]()
    calls = 0

    def fails(self: Any, *words: Any) -> Any:
        nonlocal calls
        calls += 1
        if where in ("open", "close") or calls == 20:
            raise kind
        return before(self, *words)

    def keep(self: Any, command: Record) -> None:
        sent.append(float(abs(command["wrench"]).max()))

    cls.write = keep  # type: ignore[method-assign]
    before = getattr(cls, where)
    setattr(cls, where, fails)
    session = itouch.build(scene, catalog=catalog(cls))
    if where in ("open", "close"):
        with pytest.raises(DeviceError, match="device 'stick'.*it fails to say why"):
            session.enable()
            session.close()
        return
    session.enable()
    with pytest.raises(itouch.DeviceFaultError, match="it fails to say why"):
        session.run(1.0)
    assert session.status("stick").name == "FAULT"
    assert sent[-1] == 0.0
    assert session.report()["faults"][-1]["trip"] == "device-error"
    session.close()


def test_a_device_whose_quaternion_shrinks_is_stopped_and_pushes_with_nothing(scene: Path) -> None:
    """The place of whatever is mounted on it would shrink as well."""

    class Shrinks(stick()):  # type: ignore[misc]
        sent: ClassVar[list[float]] = []

        def read(self, reading: Record) -> bool | None:
            new: bool | None = super().read(reading)
            if new and self.count > 100:
                reading["pose"][3] = 0.5
            return new

        def write(self, command: Record) -> None:
            self.sent.append(float(abs(command["wrench"]).max()))

    session = itouch.build(scene, catalog=catalog(Shrinks))
    session.enable()
    with pytest.raises(
        itouch.DeviceFaultError, match="a quaternion of length 0.5 .pose., which is not a rotation"
    ) as caught:
        session.run(1.0)
    assert caught.value.trip is Trip.SENSOR_RANGE
    assert max(Shrinks.sent) > 0.1, "it pushed before"
    assert Shrinks.sent[-1] == 0.0
    assert session.state["stick.pose"][3] == 1.0, "what is not believed is worked with by nobody"
    session.close()


def test_a_recording_replays_of_two_devices_that_fail_at_once(scene: Path) -> None:
    """As when their hub is unplugged: that the second one failed, too, stood in no fault, and it was replayed as well."""
    text = scene.read_text(encoding="utf-8")
    text = text.replace("<devices>", '<devices><device name="other" plugin="stick" twin="no"/>')
    scene.write_text(text.replace("<interaction>", '<interaction><probe name="thumb" pose-from="other"/>'))
    cls = stick(fails_at=300)
    session = itouch.build(scene, catalog=catalog(cls))
    session.record(scene.parent / "r.mcap")
    session.enable()
    with pytest.raises(itouch.DeviceFaultError):
        session.run(1.0)
    (fault,) = session.report()["faults"]
    assert len(fault["also"]) == 1
    session.close()
    outcome = itouch.replay(scene.parent / "r.mcap", catalog=catalog(stick()))
    assert outcome.mismatches == 0, outcome
    assert outcome.ticks >= 290
