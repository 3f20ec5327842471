"""What attacks on the supervisor found, each through the entrance that a device, a plugin or a file has."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from test_irregular_timing import K0, Pad
from test_third_party_device_supervision import Nothing, Plate, catalog, plate, scene

import itouch
from itouch.loop import WallClock
from itouch.monitors import Ordinary
from itouch.monitors import default_limits as default
from itouch.monitors.default_limits import DeviceLimits
from itouch.plugin import (
    HOLD,
    Channel,
    Device,
    Field,
    Monitor,
    Record,
    Role,
    Twin,
    TwinInputs,
    plate_temperature,
    pose,
    pose_target,
    temperature_target,
    wrench,
)
from itouch.safety import DeviceFaultError, Finger, Trip
from itouch.schema import SceneError
from itouch.session import SessionError
from itouch.world.safe_values import with_safe_values

# --- old news -------------------------------------------------------------------------------------------------------


class Cached(Pad):
    """A driver that goes on handing over what it measured half a second after it was opened, and says so."""

    begun: ClassVar[float] = 0.0
    honest: ClassVar[tuple[str, ...]] = ()

    def read(self, reading: Record) -> bool | None:
        now = time.monotonic()
        fresh = now - self.begin < 0.3
        self.last = now if fresh else self.last
        reading["t"], reading["j"], reading["b"] = K0 + 30.0 + 1e-3 * (now % 1.0), 0.0, 0.0
        if not fresh:
            self.timestamps.measured(*self.honest, ago=now - self.last)
        time.sleep(0.005)
        return True


@pytest.mark.punctual  # each word holds for 80 ms
@pytest.mark.parametrize("honest", [(), ("t",)], ids=["all", "the plate"])
def test_an_old_reading_that_comes_again_does_not_count_as_new(tmp_path: Path, honest: tuple[str, ...]) -> None:
    """W1 counts a reading's age from when it was measured, however often it comes."""
    cls = type("Threaded", (Cached,), {"honest": honest})
    with itouch.build(
        scene(tmp_path, "pad", twin="no"), catalog=catalog({"stranger": cls}), clock=WallClock()
    ) as session:
        session.hold()
        session.enable()
        with pytest.raises(DeviceFaultError, match="silent") as caught:
            session.run(5.0, each=session.hold)
        assert caught.value.trip is Trip.SILENT
        assert session.seconds < 0.3 + 0.5 + 0.7


@pytest.mark.punctual
def test_the_ages_on_the_way_and_since_are_one(tmp_path: Path) -> None:
    """Each reading is 0.3 s old when it comes, and the next one comes 0.3 s later: 0.6 s are more than 0.5 s."""

    class Both(Pad):
        last = -1.0

        def read(self, reading: Record) -> bool | None:
            now = time.monotonic()
            time.sleep(0.005)
            if now - self.begin > 0.3 and now - self.last < 0.3:
                return False
            self.last = now
            reading["t"], reading["j"], reading["b"] = K0 + 30.0 + 1e-3 * (now % 1.0), 0.0, 0.0
            self.timestamps.measured(ago=0.3 if now - self.begin > 0.3 else 0.0)
            return True

    with itouch.build(
        scene(tmp_path, "pad", twin="no"), catalog=catalog({"stranger": Both}), clock=WallClock()
    ) as session:
        session.hold()
        session.enable()
        with pytest.raises(DeviceFaultError, match="silent") as caught:
            session.run(5.0, each=session.hold)
        assert caught.value.trip is Trip.SILENT


# --- what is safe ---------------------------------------------------------------------------------------------------


class Overheats(Plate):
    """Its sensor says 80 degC after a while."""

    command = "x"

    def read(self, state: Record, reading: Record) -> bool | None:
        state["ticks"] += 1
        reading["plate_temperature"] = state["true"].item() if state["ticks"] < 1000 else 353.0
        return True


def heating(command: Channel, *more: Channel) -> Any:
    class Stranger(Device):
        """A heater of a stranger."""

        Params = Nothing
        Twin = Overheats
        reads: ClassVar[tuple[Channel, ...]] = (plate_temperature(),)
        commands: ClassVar[tuple[Channel, ...]] = (command, *more)

        def open(self) -> None: ...
        def close(self) -> None: ...
        def read(self, reading: Record) -> bool | None: ...

    return Stranger


def drive(**more: Any) -> Channel:
    return Channel("x", 1, "A", (-3.0,), (3.0,), role=Role.DRIVE, doc="current of the heater", **more)


@pytest.mark.parametrize("more", [{}, {"safe": HOLD}], ids=["nothing said", "held"])
def test_a_drive_is_off_after_a_trip_whatever_its_plugin_left_open(tmp_path: Path, more: dict[str, Any]) -> None:
    session = itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": heating(drive(**more))}))
    session.taps.append(lambda tick: session.state["pad.command.x"].fill(-1.0))
    with pytest.raises(DeviceFaultError):
        session.run(3.0)
    assert session.state["pad.sent.x"].tolist() == [0.0] or session.state["pad.sent.x"].item() == 0.0


def test_a_drive_whose_safe_value_acts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="calls 2 A safe, but that acts"):
        itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": heating(drive(safe=(2.0,)))}))


def test_a_target_that_is_held_goes_to_the_middle_of_the_limits(tmp_path: Path) -> None:
    cls = heating(temperature_target("x"))
    session = itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": cls}))
    session.taps.append(lambda tick: session.state["pad.command.x"].fill(K0 + 38.0))
    with pytest.raises(DeviceFaultError):
        session.run(3.0)
    low, high = session.model.devices["pad"].limits.temperature or (0.0, 0.0)
    assert session.state["pad.sent.x"].item() == pytest.approx(0.5 * (low + high))


@pytest.mark.parametrize("safe", [None, HOLD], ids=["nothing said", "held"])
def test_a_switch_is_off_whatever_its_plugin_left_open(tmp_path: Path, safe: Any) -> None:
    switch = Channel("on", 1, "1", (0.0,), (1.0,), safe=safe, role=Role.OUTPUT_SWITCH, doc="output")
    session = itouch.build(
        scene(tmp_path, "pad"), catalog=catalog({"stranger": heating(temperature_target("x"), switch)})
    )

    def heat(tick: int) -> None:
        session.state["pad.command.x"], session.state["pad.command.on"] = K0 + 38.0, 1.0

    session.taps.append(heat)
    with pytest.raises(DeviceFaultError):
        session.run(3.0)
    assert session.state["pad.sent.on"].item() == 0.0


def test_a_switch_that_is_safe_when_it_is_on_is_refused(tmp_path: Path) -> None:
    switch = Channel("on", 1, "1", (0.0,), (1.0,), safe=(1.0,), role=Role.OUTPUT_SWITCH, doc="output")
    with pytest.raises(SceneError, match="command 'on' calls 1 safe, but that acts"):
        itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": heating(temperature_target("x"), switch)}))


@pytest.mark.parametrize(("low", "high", "safe", "found"), [
    (250.0, 400.0, HOLD, 300.65), (288.15, 295.15, HOLD, 291.65), (314.0, 330.0, HOLD, 314.0),
    (250.0, 400.0, (353.15,), 313.15), (250.0, 400.0, (260.0,), 288.15), (0.0, 400.0, (0.0,), 0.0),
    (250.0, 400.0, (300.0,), 300.0), (288.15, 295.15, (400.0,), 295.15),
])  # fmt: skip
def test_a_safe_temperature_is_within_limits_and_range(low: float, high: float, safe: Any, found: float) -> None:
    """Limits of 15 to 40 degC; below 200 K a target is off."""
    channel = Channel("x", 1, "K", (low,), (high,), safe=safe, role=Role.TEMPERATURE_TARGET, doc="target")
    (resolved,) = with_safe_values([channel], DeviceLimits(temperature=(288.15, 313.15)))
    assert resolved.safe == (pytest.approx(found),)


def test_a_safe_temperature_without_a_range_is_the_middle_of_the_default_limits() -> None:
    channel = Channel("x", 2, "K", role=Role.TEMPERATURE_TARGET, doc="two targets")
    (resolved,) = with_safe_values([channel], DeviceLimits())
    low, high = default.PLATE_TEMPERATURE
    assert resolved.safe == pytest.approx((0.5 * (low + high),) * 2)


def test_a_target_with_a_switch_stays_where_it_is_and_is_switched_off(tmp_path: Path) -> None:
    switch = Channel("on", 1, "1", (0.0,), (1.0,), safe=(0.0,), role=Role.OUTPUT_SWITCH, doc="output")
    session = itouch.build(
        scene(tmp_path, "pad"), catalog=catalog({"stranger": heating(temperature_target("x"), switch)})
    )
    assert session.model.devices["pad"].commands[0].safe is HOLD


@pytest.mark.punctual
def test_a_thread_that_is_left_alone_sends_what_is_safe_though_the_plugin_left_it_open(tmp_path: Path) -> None:
    written: list[float] = []

    class Behind(Pad):
        commands = (Channel("i", 1, "A", (-4.0,), (4.0,), safe=HOLD, role=Role.DRIVE, doc="current"),)

        def read(self, reading: Record) -> bool | None:
            reading["t"], reading["j"], reading["b"] = K0 + 30.0 + 1e-3 * (time.monotonic() % 1.0), 0.0, 1.0
            time.sleep(0.005)
            return True

        def write(self, command: Record) -> None:
            written.append(command["i"].item())

    session = itouch.build(scene(tmp_path, "pad", twin="no"), catalog=catalog({"stranger": Behind}), clock=WallClock())
    with session:
        session.enable()
        session.run(0.6, each=lambda: session.state["pad.command.i"].fill(-1.0))
        assert written[-1] < -0.5
        end = time.monotonic() + 300.0
        while written[-1] != 0.0 and time.monotonic() < end:  # the loop hangs
            time.sleep(0.01)
        assert written[-1] == 0.0


# --- what may hurt, by whatever unit --------------------------------------------------------------------------------


def silent(unit: str, role: Role = Role.SIGNAL, harmless: str = "") -> Any:
    class Stranger(Device):
        """A device of a stranger that reads nothing."""

        Params = Nothing
        watchdog: ClassVar[float | None] = 0.1
        reads: ClassVar[tuple[Channel, ...]] = ()
        commands: ClassVar[tuple[Channel, ...]] = (
            Channel("x", 1, unit, (0.0,), (3.0,), safe=(0.0,), role=role, doc="what it does", harmless=harmless),
        )

        def open(self) -> None: ...
        def close(self) -> None: ...
        def read(self, reading: Record) -> bool | None: ...

    return Stranger


@pytest.mark.parametrize(
    "unit",
    ["A", "mA", "V", "mV", "W", "kW", "K", "degC", "N", "mN", "N*m", "Pa", "kPa", "W/m^2", "A/m^2", "A*s", "V/m"],
)
def test_a_command_that_can_hurt_must_say_what_it_is_for(tmp_path: Path, unit: str) -> None:
    with pytest.raises(SceneError, match="does not say what it is for"):
        itouch.build(scene(tmp_path, "pad", twin="no"), catalog=catalog({"stranger": silent(unit)}))


@pytest.mark.parametrize("unit", ["1", "m", "m/s", "Hz", "rad", "s"])
def test_a_command_that_can_not_need_not(tmp_path: Path, unit: str) -> None:
    itouch.build(scene(tmp_path, "pad", twin="no"), catalog=catalog({"stranger": silent(unit)})).close()


def test_a_blank_text_is_refused_as_the_reason_for_harmless(tmp_path: Path) -> None:
    cls = silent("A", Role.DRIVE, harmless="  ")
    with pytest.raises(SceneError, match="is unmonitored"):
        itouch.build(scene(tmp_path, "pad", twin="no"), catalog=catalog({"stranger": cls}))


def test_no_temperature_is_harmless_whatever_its_role_is_called(tmp_path: Path) -> None:
    cls = silent("K", Role.DRIVE, harmless="because it is only a number")
    with pytest.raises(SceneError, match="called harmless, which no temperature target can be"):
        itouch.build(scene(tmp_path, "pad", twin="no"), catalog=catalog({"stranger": cls}))


# --- slower than its watchdog ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("twin", ["yes", "no"])
def test_a_device_that_is_read_more_seldom_than_its_reading_may_be_old_is_refused(tmp_path: Path, twin: str) -> None:
    cls = plate("t", "i")
    cls.period = 5.0
    with pytest.raises(SceneError, match=r"exchanges every 5 s, but a reading may be 0\.5 s old at most \(W1\)"):
        itouch.build(scene(tmp_path, "pad", twin=twin), catalog=catalog({"stranger": cls}))


@pytest.mark.parametrize("twin", ["yes", "no"])
def test_one_whose_exchange_takes_longer_is_refused(tmp_path: Path, twin: str) -> None:
    cls = plate("t", "i")
    cls.blocking, cls.delay = True, 0.6
    with pytest.raises(SceneError, match=r"takes for an exchange 0\.6 s, but a reading may be 0\.5 s old"):
        itouch.build(scene(tmp_path, "pad", twin=twin), catalog=catalog({"stranger": cls}))


# --- plugins that end the program -----------------------------------------------------------------------------------


class Leaves(Plate):
    channel, command = "t", "i"
    where: ClassVar[str] = ""

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        if self.where == "step" and state["ticks"] > 300:
            raise SystemExit(3)
        super().step(state, command, touch, period)

    def read(self, state: Record, reading: Record) -> bool | None:
        if self.where == "read" and state["ticks"] > 300:
            raise SystemExit(3)
        return super().read(state, reading)


class Watches(Monitor):
    """A monitor that ends the program."""

    name = "leaver"
    where: ClassVar[str] = ""

    @classmethod
    def of(cls, device: Any) -> Any:
        return (cls(device),)

    def check(self, state: Record, reading: Record, sent: Record, moment: Any) -> float:
        if self.where == "monitor" and moment.now > 0.3:
            raise SystemExit(3)
        return 1.0


def _leave(*asked: Any) -> str:
    raise SystemExit(3)


@pytest.mark.parametrize(("where", "trip"), [
    ("step", Trip.DEVICE_ERROR), ("read", Trip.DEVICE_ERROR), ("monitor", Trip.MONITOR_ERROR),
    ("sentence", Trip.MONITOR),
])  # fmt: skip
def test_a_plugin_that_ends_the_program_stops_its_device(tmp_path: Path, where: str, trip: Trip) -> None:
    cls = plate("t", "i")
    cls.Twin = type("Inner", (Leaves,), {"where": where})
    watches = type("Watches", (Watches,), {"where": where})
    if where == "sentence":
        watches.check = lambda self, state, reading, sent, moment: 1.0 if moment.now < 0.3 else -1.0
        watches.sentence = _leave
        watches.trips = {1: "leaves"}
    session = itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": cls}, {"leaver": watches}))
    with pytest.raises(DeviceFaultError, match="SystemExit") as caught:
        session.run(1.0)
    assert (caught.value.device, caught.value.trip) == ("pad", trip)
    assert session.runners[0].sent["i"].item() == 0.0


@pytest.mark.punctual
@pytest.mark.parametrize(("where", "blocking"), [
    ("open", False), ("read", False), ("write", False), ("close", False), ("open", True), ("read", True), ("write", True)
])  # fmt: skip
def test_a_driver_that_ends_the_program_is_told_of(tmp_path: Path, where: str, blocking: bool) -> None:
    class Driver(Pad):
        says = staticmethod(lambda t: (30.0 + 1e-3 * (t % 1.0), 0.0))

        def open(self) -> None:
            super().open()
            if where == "open":
                raise SystemExit(4)

        def read(self, reading: Record) -> bool | None:
            if where == "read" and time.monotonic() - self.begin > 0.2:
                raise SystemExit(4)
            time.sleep(0.001 * blocking)
            return super().read(reading)

        def write(self, command: Record) -> None:
            if where == "write" and command["i"].item():
                raise SystemExit(4)

        def close(self) -> None:
            if where == "close":
                raise SystemExit(4)

    Driver.blocking = blocking
    path = scene(tmp_path, "pad", twin="no")

    def used() -> None:
        with itouch.build(path, catalog=catalog({"stranger": Driver}), clock=WallClock()) as session:
            session.enable()
            session.run(0.8, each=lambda: session.state["pad.command.i"].fill(-1.0))

    with pytest.raises(itouch.ItouchError, match=r"SystemExit"):
        used()


# --- monitors of plugins --------------------------------------------------------------------------------------------


class Forges(Watches):
    """A monitor that writes whatever it is shown."""

    def check(self, state: Record, reading: Record, sent: Record, moment: Any) -> float:
        for record in (reading, sent):
            record.numbers[:] = 296.0
        moment.touched, moment.seconds, moment.now = False, 0.0, 1e9
        return 1.0


def test_what_a_plugins_monitor_writes_changes_nothing(tmp_path: Path) -> None:
    def run(monitors: dict[str, Any], name: str) -> bytes:
        folder = tmp_path / name
        folder.mkdir()
        cat = catalog({"stranger": plate("t", "i")}, {"leaver": Watches} | monitors)
        session = itouch.build(scene(folder, "pad"), catalog=cat)
        session.taps.append(lambda tick: session.state["pad.command.i"].fill(-1.0))
        session.run(1.0)
        return session.state.tobytes()

    assert run({}, "honest") == run({"leaver": Forges}, "forged")


def test_a_monitor_made_from_one_of_the_frameworks_is_a_plugins(tmp_path: Path) -> None:
    class Own(Ordinary):
        name = "mine"

        def check(self, state: Record, reading: Record, sent: Record, moment: Any) -> float:
            reading.numbers[:] = 0.0
            return 1.0

    session = itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": plate("t", "i")}, {"mine": Own}))
    session.run(0.1)
    (panel,) = [runner.gate.device_monitors for runner in session.runners]
    assert panel.seen["t"].item() > 290.0
    assert [post.own for post in panel.installed if post.monitor.name == "mine"] == [False]


def test_a_moment_that_is_no_field_is_told_when_the_scene_is_built(tmp_path: Path) -> None:
    class Forgets(Watches):
        time_fields: ClassVar[tuple[str, ...]] = ("when",)

    with pytest.raises(SceneError, match="has no field 'when', which it names in `time_fields`"):
        itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": plate("t", "i")}, {"leaver": Forgets}))


@pytest.mark.parametrize("said", ["0.5", b"0.5", None, [0.5, 0.5], math.nan])
def test_a_monitor_that_returns_no_number_is_an_error(tmp_path: Path, said: object) -> None:
    class Says(Watches):
        def check(self, state: Record, reading: Record, sent: Record, moment: Any) -> float:
            return said  # type: ignore[return-value]

    session = itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": plate("t", "i")}, {"leaver": Says}))
    with pytest.raises(itouch.ItouchError, match="monitor 'leaver' (returned|failed)"):
        session.run(0.1)


# --- edited sessions ------------------------------------------------------------------------------------------------

EDITS: list[tuple[str, Callable[[Any], None]]] = [
    (field, lambda values, to=to: values.__setitem__(Ellipsis, to))
    for field, to in (
        ("pad.heat.checked", 10**9), ("pad.heat.since", 1e9), ("pad.heat.touched_at", 1e9),
        ("pad.heat.frozen_at", 1e9), ("pad.heat.frozen_for", -1e9), ("pad.heat.odd_for", -1e9),
        ("pad.readings.checked", 10**9), ("pad.watchdog.checked", -(10**9)), ("pad.heard", 10**9),
        ("pad.measured", 10**9), ("pad.rearmed", 10**9),
    )
] + [("pad.heat.history", lambda values: values[:, 0].fill(1e9)), ("pad.heat.parts", lambda v: v[:, 0].fill(1e9))]  # fmt: skip


@pytest.mark.parametrize(("field", "edit"), EDITS, ids=[field for field, _ in EDITS])
def test_a_stored_session_that_lies_in_the_future_is_refused(
    tmp_path: Path, field: str, edit: Callable[[Any], None]
) -> None:
    cat = catalog({"stranger": plate("t", "i")})
    session = itouch.build(scene(tmp_path, "pad"), catalog=cat)
    session.run(0.2)
    session.save(tmp_path / "honest.itouch")
    edit(session.state[field])
    session.save(tmp_path / "edited.itouch")
    itouch.restore(tmp_path / "honest.itouch", catalog=cat).close()
    with pytest.raises(SessionError, match=field.replace(".", r"\.")):
        itouch.restore(tmp_path / "edited.itouch", catalog=cat)


# --- what presses by a fluid ----------------------------------------------------------------------------------------


class Bag(Twin):
    """A bladder of 1 cm2 at the finger."""

    def fields(self) -> tuple[Field, ...]:
        return (Field("p", unit="Pa", doc="pressure"),)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        state["p"] = command["p"].item()

    def read(self, state: Record, reading: Record) -> bool | None:
        reading["f"] = 0.0
        reading["f"][2] = state["p"].item() * 1e-4
        return True


class Cuff(Device):
    """A pneumatic cuff."""

    Params, Twin = Nothing, Bag
    reads = (Channel("f", 6, "N", (-50.0,) * 6, (50.0,) * 6, role=Role.CONTACT_FORCE, doc="how it presses"),)
    commands = (Channel("p", 1, "Pa", (0.0,), (5e4,), safe=(0.0,), role=Role.PRESSURE, doc="pressure in the cuff"),)

    def open(self) -> None: ...
    def close(self) -> None: ...
    def read(self, reading: Record) -> bool | None: ...


class Pusher(Device):
    """An arm that pushes as it is told."""

    Params = Nothing
    reads = (pose(),)
    commands = (wrench(force=5.0),)

    def open(self) -> None: ...
    def close(self) -> None: ...
    def read(self, reading: Record) -> bool | None: ...


WORN = """<itouch version="1.0">
  <materials><material name="m"><contact stiffness="800 N/m"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 -12 mm" material="m"/></world><devices>
  <device name="arm" plugin="pusher"/>{0}</devices>
  <interaction><probe name="tip" radius="8 mm" pose-from="arm" force-to="arm"/></interaction>
  <safety force="1 N"/></itouch>"""


def test_what_presses_by_a_fluid_leaves_the_arm_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    path.write_text(WORN.format('<device name="cuff" plugin="cuff"><mount on="arm"/></device>'), encoding="utf-8")
    session = itouch.build(path, catalog=catalog({"pusher": Pusher, "cuff": Cuff}))
    most = [0.0, 0.0]

    def push(tick: int) -> None:
        pressed, pushed = session.state["cuff.f"][2].item(), session.state["arm.sent.wrench"][2].item()
        if tick > 500:
            most[:] = max(most[0], pressed + pushed), max(most[1], pushed)
        session.state["cuff.command.p"] = 6e3  # 0.6 N, in a contact of 5 N

    session.taps.append(push)
    session.run(1.0)
    assert most == [pytest.approx(1.0, abs=0.01), pytest.approx(0.4, abs=0.01)]


class Inflated(Device):
    """A surface that a stage brings, and that is blown up."""

    Params = Nothing
    reads = (pose(), Channel("f", 6, "N", (-50.0,) * 6, (50.0,) * 6, role=Role.CONTACT_FORCE, doc="how it presses"))
    commands = (
        pose_target(low=(-0.05,) * 3, high=(0.05,) * 3, speed=0.2),
        Channel("p", 1, "Pa", (0.0,), (5e4,), safe=(0.0,), role=Role.PRESSURE, doc="pressure"),
    )

    def open(self) -> None: ...
    def close(self) -> None: ...
    def read(self, reading: Record) -> bool | None: ...


def test_a_surface_that_is_blown_up_counts_once(tmp_path: Path) -> None:
    session = itouch.build(scene(tmp_path, "pad"), catalog=catalog({"stranger": Inflated}))
    (runner,) = session.runners
    finger = Finger("tip", [runner.gate])
    runner.gate.device_monitors.seen["f"][2] = -3.0
    assert finger.pressed() == 3.0
    assert finger.pressed(but=runner.gate) == 0.0
    finger.check(5)


def test_several_that_press_by_a_fluid_trip_together(tmp_path: Path) -> None:
    """Each alone is below its limit."""
    cuffs = "".join(f'<device name="cuff{n}" plugin="cuff"><mount on="arm"/></device>' for n in range(4))
    path = tmp_path / "s.xml"
    path.write_text(WORN.format(cuffs), encoding="utf-8")
    session = itouch.build(path, catalog=catalog({"pusher": Pusher, "cuff": Cuff}))

    def press(tick: int) -> None:
        for n in range(4):
            session.state[f"cuff{n}.command.p"] = 1.9e4

    session.taps.append(press)
    with pytest.raises(DeviceFaultError, match="presses with others on the finger of 'tip'") as caught:
        session.run(1.0)
    assert caught.value.trip is Trip.FINGER_FORCE
    assert np.all([session.state[f"cuff{n}.sent.p"].item() == 0.0 for n in range(4)])
