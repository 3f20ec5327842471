"""A trip that is latched, and a dose that is used up, survive every way back to a device that acts."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any, ClassVar

import pytest
from test_hardware import SCENE as STICK
from test_hardware import Params, catalog, stick

import itouch
from itouch.plugin import Device, DeviceError, Record, Role, current, deadman, temperature
from itouch.safety import Trip

SCENE = """<itouch version="1.0">
  <devices><device name="pad" plugin="stick" twin="no"/></devices>
</itouch>
"""


def pad(*, moves: bool = False) -> Any:
    """Return the class of a pad that heats, with what it reads and was sent at hand."""

    class Pad(Device):
        """A pad of which a test says how warm it is."""

        reads = (
            temperature("plate_temperature", role=Role.SKIN_CONTACT_TEMPERATURE),
            deadman(),
        )
        commands = (current(limit=4.0),)
        moves_on_open: ClassVar[bool] = moves
        second_opener: ClassVar[bool] = True
        shown: ClassVar[float] = 303.15
        sent: ClassVar[list[float]] = []

        def open(self) -> None:
            """Begin."""
            self.count = 0

        def close(self) -> None:
            """End."""

        def read(self, reading: Record) -> bool | None:
            self.count += 1
            reading["deadman"] = 1.0
            reading["plate_temperature"] = type(self).shown + 1e-6 * (self.count % 7)
            return True

        def write(self, command: Record) -> None:
            self.sent.append(float(command["current"][0]))

    Pad.Params = Params
    return Pad


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    return tmp_path / "scene.xml"


def tripped(scene: Path, cls: Any, why: str) -> itouch.Session:
    """Return a session that has been stopped by its pad's temperature, or by its dose."""
    session = itouch.build(scene, catalog=catalog(cls))
    if why == "dose":
        session.state["pad.heat.dose"] = 119.9
        cls.shown = 314.6
    session.enable()
    session.state["pad.command.current"] = -3.0
    if why != "dose":
        cls.shown = 333.15
    with pytest.raises(itouch.DeviceFaultError):
        session.run(10.0)
    return session


def stored(session: itouch.Session, form: str, folder: Path) -> Path:
    path = folder / ("s.xml" if form == "xml" else "s.itouch")
    if form == "xml":
        path.write_text(session.to_xml(), encoding="utf-8")
    else:
        session.save(path)
    session.close()
    return path


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("form", ["itouch", "xml"])
@pytest.mark.parametrize("why", ["dose", "plate-temperature"])
def test_what_was_stopped_is_stopped_after_a_restore(scene: Path, why: str, form: str, moves: bool) -> None:
    cls = pad(moves=moves)
    path = stored(tripped(scene, cls, why), form, scene.parent)
    session = itouch.restore(path, catalog=catalog(cls))
    cls.shown = 303.15  # all is cool again
    cls.sent.clear()
    session.state["pad.command.current"] = -3.0
    with pytest.raises(DeviceError, match=f"'pad' was stopped by {why} at tick .*\n.*re-arm"):
        session.enable()
    with pytest.raises(itouch.EngineError, match="enable"):
        session.tick()
    if why == "dose":
        for act in (session.rearm, lambda: session.reconnect("pad")):
            with pytest.raises(DeviceError, match="whole thermal dose"):
                act()
        assert not any(cls.sent)
    else:
        session.rearm()
        assert session.status("pad").name == "ENABLED"
        session.tick()
    session.close()


def test_a_plate_that_is_still_hot_is_not_re_armed_after_a_restore(scene: Path) -> None:
    cls = pad()
    session = itouch.restore(stored(tripped(scene, cls, "plate-temperature"), "itouch", scene.parent),
                             catalog=catalog(cls))  # fmt: skip
    cls.sent.clear()
    for act in (session.enable, session.rearm, session.rearm, session.enable):
        session.reconnect("pad")
        with pytest.raises(DeviceError):
            act()
    assert not any(cls.sent)


def test_closing_and_enabling_anew_does_not_release_a_trip(scene: Path) -> None:
    cls = pad()
    session = tripped(scene, cls, "plate-temperature")
    session.close()
    cls.shown = 303.15
    with pytest.raises(DeviceError, match="re-arm"):
        session.enable()
    session.rearm()
    session.tick()
    session.close()


def test_reconnecting_releases_no_trip_but_that_of_a_lost_device(scene: Path) -> None:
    cls = pad()
    session = tripped(scene, cls, "plate-temperature")
    cls.shown = 303.15
    session.reconnect("pad")
    assert session.status("pad").name == "FAULT"
    session.rearm()
    session.tick()
    session.close()


@pytest.mark.parametrize("form", ["itouch", "xml"])
def test_how_often_a_device_was_re_armed_counts_after_a_restore(scene: Path, form: str) -> None:
    session = itouch.build(scene, catalog=catalog(pad()))
    session.enable()
    for _ in range(5):
        session.run(0.01)
        session.runners[0].gate.fault(Trip.FLUX, session.ticks)
        session.rearm()
    session.run(0.01)
    session.runners[0].gate.fault(Trip.FLUX, session.ticks)
    restored = itouch.restore(stored(session, form, scene.parent), catalog=catalog(pad()))
    for act in (restored.rearm, lambda: restored.reconnect("pad"), restored.rearm):
        with contextlib.suppress(DeviceError):
            act()
    with pytest.raises(DeviceError, match="was re-armed 5 times within a minute"):
        restored.rearm()
    with pytest.raises(DeviceError, match="was stopped by flux"):
        restored.enable()
    assert restored.status("pad").name != "ENABLED"
    restored.close()


def test_an_arm_of_a_restored_session_is_where_it_reads_when_it_is_re_armed(tmp_path: Path) -> None:
    """Before its first tick nothing knew where its base is, and its way from the origin was called a speed (K2)."""
    path = tmp_path / "scene.xml"
    mounted = STICK.replace('twin="no"/>', 'twin="no"><mount pos="0 0 30 mm"/></device>')
    path.write_text(mounted, encoding="utf-8")
    cls = stick(fails_at=100)
    with itouch.build(path, catalog=catalog(cls)) as session:
        session.enable()
        with pytest.raises(itouch.DeviceFaultError):
            session.run(1.0)
        session.save(tmp_path / "s.itouch")
    with itouch.restore(tmp_path / "s.itouch", catalog=catalog(stick())) as again:
        again.rearm()
        assert again.state["finger.hip"].ravel()[2] == pytest.approx(0.06, abs=1e-3)
        again.run(0.05)
        assert again.status("stick").name == "ENABLED"
