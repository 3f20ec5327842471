"""Re-arming goes by where hardware is then: no tick has read it while all was stopped, and it may be silent by then."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, ClassVar

import pytest
from test_hardware import Entry, Params

import itouch
from itouch.plugin import (
    ROTATIONS,
    Device,
    DeviceError,
    Record,
    Role,
    current,
    pose,
    pose_target,
    temperature,
    wrench,
)
from itouch.plugin.discovery import Catalog, Found, find
from itouch.safety import Trip

pytestmark = pytest.mark.punctual  # devices in real time, some in threads of their own

SCENE = """<itouch version="1.0">
  <materials><material name="wood"><contact stiffness="0.3 N/mm"/></material></materials>
  <world><box name="block" size="4 4 2 cm" pos="0 0 1 cm" material="wood"/></world>
  <devices>
    <device name="stick" plugin="stick" twin="no"/><device name="table" plugin="table" twin="no"/>
    <device name="pad" plugin="pad" twin="no"{optional}/>
  </devices>
  <interaction><probe name="finger" radius="5 mm" pose-from="stick" surface-to="table"/></interaction>
</itouch>
"""


class Part(Device):
    """A device of the rig; a test says what it does."""

    Params = Params
    second_opener: ClassVar[bool] = True
    silent: ClassVar[bool] = False
    broken: ClassVar[bool] = False
    gone: ClassVar[bool] = False
    shown: ClassVar[float] = 0.0
    sent: ClassVar[list[float]] = []

    def open(self) -> None:
        """Begin."""
        if type(self).gone:
            raise DeviceError("there is nothing at its port")
        self.count = 0

    def close(self) -> None:
        """End."""

    def read(self, reading: Record) -> bool | None:
        cls = type(self)
        if cls.broken:
            raise DeviceError("its cable is out")
        if cls.silent:
            return False
        self.count += 1
        now = cls.shown + 1e-6 * (self.count % 7)
        if "pose" in reading:
            reading["pose"] = (0.0, 0.0, now, 1.0, 0.0, 0.0, 0.0)
        if "plate_temperature" in reading:
            reading["plate_temperature"] = now
        return True


def rig(folder: Path, *, blocking: bool | str = False, optional: bool = False) -> tuple[itouch.Session, Any, Any, Any]:
    """Return an enabled session in real time that has run a little; and the classes of its devices.

    ``blocking``: whether each of them, or the one of this name, has a thread of its own.
    """

    class Stick(Part):
        """Where the finger is: high over the table."""

        reads = (pose(),)
        commands = (wrench(force=3.0),)
        shown: ClassVar[float] = 0.1

    class Table(Part):
        """Goes at once where it is sent."""

        reads = (pose(locked=ROTATIONS),)
        commands = (pose_target(low=(-0.1, -0.1, 0.0), high=(0.1, 0.1, 0.05), speed=0.3),)
        shown: ClassVar[float] = 0.02
        sent: ClassVar[list[float]] = []

        def write(self, command: Record) -> None:
            type(self).shown = float(command["pose_target"][2])
            self.sent.append(type(self).shown)

    class Pad(Part):
        """A plate that heats."""

        reads = (temperature("plate_temperature", role=Role.SKIN_CONTACT_TEMPERATURE),)
        commands = (current(limit=4.0),)
        shown: ClassVar[float] = 303.15

    kinds: tuple[type[Part], ...] = (Stick, Table, Pad)
    for cls in kinds:
        cls.blocking = blocking in (True, cls.__name__)
        cls.period = 0.002 if cls.blocking else 0.0

    def finder(group: str) -> dict[str, Found]:
        found: dict[str, Any] = dict(find(group))
        if group == "itouch.devices":
            for cls in kinds:
                name = cls.__name__.lower()
                found[name] = Found(name, "itouch-rig", "1.0", Entry(cls))  # type: ignore[arg-type]
        return found

    (folder / "scene.xml").write_text(SCENE.format(optional=' optional="yes"' if optional else ""), encoding="utf-8")
    session = itouch.build(folder / "scene.xml", catalog=Catalog(finder), clock=itouch.WallClock())
    session.hold()
    session.enable()
    goes_on(session, 0.1)
    return session, Stick, Table, Pad


def goes_on(session: itouch.Session, seconds: float) -> None:
    """Run while somebody holds the switch."""
    session.hold()
    session.run(seconds, each=session.hold)


def rearm(session: itouch.Session) -> None:
    """Re-arm while somebody holds the switch."""
    session.hold()
    session.rearm()


def stopped(session: itouch.Session, cls: Any) -> None:
    """Stop the session because a device is silent, which then answers again."""
    cls.silent = True
    with pytest.raises(itouch.DeviceFaultError, match="was silent"):
        goes_on(session, 2.0)
    cls.silent = False


@pytest.mark.parametrize("blocking", [False, True])
def test_a_table_that_was_moved_in_a_stop_begins_where_it_stands(tmp_path: Path, blocking: bool) -> None:
    """It was sent at once to where it had stood when all was stopped, at its own greatest speed."""
    session, stick, table, _ = rig(tmp_path, blocking=blocking)
    with session:
        stopped(session, stick)
        time.sleep(0.15)  # what a thread sends by itself when nobody renews a command
        table.shown = 0.035
        time.sleep(0.05)
        del table.sent[:]
        rearm(session)
        assert session.state["table.sent.pose_target"][2] == pytest.approx(0.035, abs=1e-4)
        goes_on(session, 0.02)
        assert all(height == pytest.approx(0.035, abs=2e-3) for height in table.sent), table.sent[:3]


@pytest.mark.parametrize("blocking", [False, True])
@pytest.mark.parametrize("which", ["stick", "pad"])
def test_what_does_not_answer_is_not_re_armed(tmp_path: Path, blocking: bool, which: str) -> None:
    """It was enabled by its reading from before, until W1 stopped it again; whether it had caused the stop or not."""
    session, stick, _, pad = rig(tmp_path, blocking=blocking)
    with session:
        stopped(session, stick)
        dead = {"stick": stick, "pad": pad}[which]
        dead.silent = True
        time.sleep(0.6)
        with pytest.raises(
            DeviceError, match=rf"^device '{which}' can't be re-armed: it was silent for [01][.][0-9]{{3}} s"
        ):
            rearm(session)
        assert [one.latch.status.name for one in session.runners] == ["FAULT", "OPEN", "OPEN"]
        dead.silent = False
        rearm(session)
        goes_on(session, 0.05)
        assert {one.latch.status.name for one in session.runners} == {"ENABLED"}


def test_re_arming_that_is_refused_releases_no_trip(tmp_path: Path) -> None:
    """The devices before the one that refused were released, and the next time nobody looked at them again."""
    session, stick, _, pad = rig(tmp_path)
    with session:
        stopped(session, stick)
        pad.broken = True
        with pytest.raises(DeviceError, match="device 'pad' can't be re-armed: it failed: its cable is out"):
            rearm(session)
        assert session.runners[0].latch.trip is Trip.SILENT
        assert session.state["stick.rearmed"][0] == -1  # it does not count as re-armed
        pad.broken = False
        rearm(session)
        goes_on(session, 0.05)


def test_an_optional_device_that_is_lost_keeps_no_other_from_being_re_armed(tmp_path: Path) -> None:
    """The session had gone on without it, but after the next stop nothing could be re-armed."""
    session, stick, _, pad = rig(tmp_path, optional=True)
    with session:
        pad.broken = True
        goes_on(session, 0.05)
        assert session.status("pad").name == "FAULT"
        stopped(session, stick)
        rearm(session)
        goes_on(session, 0.05)
        assert [one.latch.status.name for one in session.runners] == ["ENABLED", "ENABLED", "FAULT"]
        assert session.runners[2].latch.trip is Trip.DEVICE_ERROR


@pytest.mark.parametrize("how", ["gone", "broken"])
def test_without_a_device_that_could_not_be_reconnected_nothing_is_re_armed(tmp_path: Path, how: str) -> None:
    """The trip of a lost connection is released by reconnecting: the others were enabled without the device."""
    session, _, _, pad = rig(tmp_path)
    with session:
        pad.broken = True
        with pytest.raises(itouch.DeviceFaultError, match="its cable is out"):
            goes_on(session, 2.0)
        pad.gone = how == "gone"
        with pytest.raises(DeviceError, match="its cable is out|nothing at its port"):
            session.reconnect("pad")
        with pytest.raises(DeviceError, match="^device 'pad' could not be reconnected: reconnect it first$"):
            rearm(session)
        assert "ENABLED" not in {one.latch.status.name for one in session.runners}
        pad.gone = pad.broken = False
        session.reconnect("pad")
        rearm(session)
        goes_on(session, 0.05)
        assert {one.latch.status.name for one in session.runners} == {"ENABLED"}


def test_nobody_waits_for_a_silent_device_while_others_act(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop would stand still with forces on."""
    session, stick, _, pad = rig(tmp_path, optional=True)
    with session:
        pad.broken = True
        goes_on(session, 0.05)
        pad.broken = False
        session.reconnect("pad")
        assert session.status("stick").name == "ENABLED"
        pad.silent = True
        session.runners[2].gate.acquisition._came -= 10.0  # as if nothing had come from it for long
        waited: list[float] = []
        monkeypatch.setattr("itouch.safety.acquisition.time.sleep", waited.append)
        with pytest.raises(DeviceError, match="device 'pad' can't be re-armed: it was silent"):
            rearm(session)
        assert waited == []
        assert session.status("stick").name == "ENABLED"
        pad.silent = False
