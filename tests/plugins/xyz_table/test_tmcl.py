"""The table on steppers of a TMCL module: frames by hand, a module with habits, the heartbeat, and whole rigs."""

from __future__ import annotations

import contextlib
import io
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import channel_records
import pytest
from delayed_line import delayed
from hypothesis import given
from hypothesis import strategies as st

from itouch.plugin import DeviceError, Record, Role, Terminal, Trace
from itouch_tools.cli import main as cli
from itouch_tools.cli.lockstep import Lockstep
from itouch_xyz_table import XyzTable, XyzTableParams
from itouch_xyz_table import tmclframes as tm
from itouch_xyz_table.servos import ServoError
from itouch_xyz_table.tmcl import PATIENCE
from itouch_xyz_table.virtual_tmcl import VirtualStepper, VirtualTmcl

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

LEADS, SIGNS, TRAVEL = (0.01, 0.02, 0.005), (1.0, -1.0, 1.0), (0.012, 0.01, 0.008)
LOWS = (-TRAVEL[0] / 2, -TRAVEL[1] / 2, 0.0)
#: A machine that is busy elsewhere is no module that is silent.
PATIENT = 20.0


class Bench:
    """A virtual module served in a thread, in a time that stands still when the machine does.

    A host that is held up for longer than the heartbeat finds its motors stopped, and they go on with its next request.
    """

    def __init__(self) -> None:
        self.terminal = Terminal()
        self.motors = {number: VirtualStepper(number) for number in (0, 1, 2)}
        self.module = VirtualTmcl(self.motors, address=3)
        for axis, motor in self.motors.items():
            motor.place = (LOWS[axis] + 0.4 * TRAVEL[axis]) / (LEADS[axis] * SIGNS[axis])
            motor.watch(0.0)
        self.now = 0.0
        self.hold: Callable[[bytes], bytes] = lambda data: data
        self._tables: list[XyzTable] = []
        self._stop = False
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        last = time.monotonic()
        while not self._stop:
            now = time.monotonic()
            self.now += min(now - last, 5e-3)
            last, data = now, self.terminal.receive()
            for axis, motor in self.motors.items():
                motor.place = motor.goal()
                motor.ended = motor.place * LEADS[axis] * SIGNS[axis] <= LOWS[axis]
            self.terminal.send(self.hold(self.module.take(data, lambda: self.now)))
            time.sleep(2e-4)

    def unplug(self) -> None:
        if not self._stop:
            self._stop = True
            self._thread.join()
            self.terminal.close()

    def close(self) -> None:
        for device in self._tables:
            with contextlib.suppress(DeviceError):
                device.close()
        self.unplug()

    def table(self, *, homing: str = "absolute", patience: float = PATIENT, **more: Any) -> XyzTable:
        given_ = {"tmcl": self.terminal.path, "address": 3, "lead": LEADS, "direction": SIGNS, "travel": TRAVEL}
        device = XyzTable(XyzTableParams(homing=homing, **given_ | more))
        device.timeout_factor = patience
        device.clock = lambda: self.now  # a bench that is held up has not been silent for so long
        self._tables.append(device)
        return device

    def truth(self) -> list[float]:
        """Where the axes are [m]."""
        return [motor.goal() * LEADS[axis] * SIGNS[axis] for axis, motor in self.motors.items()]


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def records() -> tuple[Record, Record]:
    return channel_records.records(XyzTable, XyzTableParams(travel=TRAVEL, tmcl="/dev/null"))


def arrive(bench: Bench, device: XyzTable, goal: list[float]) -> Record:
    """Command a place until the axes are there."""
    reading, command = records()
    command["pose_target"] = (*goal, 1.0, 0.0, 0.0, 0.0)
    for _ in range(400):
        device.write(command)
        device.read(reading)
        if reading["pose"][:3] == pytest.approx(goal, abs=2e-6):
            break
    return reading


def test_frames_equal_ones_by_hand() -> None:
    """MVP ABS, motor 2, 1000 microsteps of module 1, as the manuals print it; and its answer to host 2."""
    frame = tm.request(tm.Request(1, tm.MOVE, tm.ABSOLUTE, 2, 1000))
    assert frame == bytes.fromhex("01 04 00 02 00 00 03 e8 f2")
    assert tm.heard(frame) == (1, 4, 0, 2, 1000)
    said = tm.answer(tm.Answer(1, tm.OK, tm.MOVE, -1))
    assert said == bytes.fromhex("02 01 64 04 ff ff ff ff 67")
    assert tm.told(said) == (1, 100, 4, -1, 2)
    assert tm.told(said[:-1]) is None
    for at in range(tm.SIZE):  # any single byte that is damaged is seen
        assert tm.told(said[:at] + bytes((said[at] ^ 0x10,)) + said[at + 1 :]) is None
    with pytest.raises(ValueError, match="32 bits"):
        tm.request(tm.Request(1, tm.MOVE, 0, 0, 1 << 31))


def test_it_goes_where_it_is_told_and_claims_no_force(bench: Bench) -> None:
    device = bench.table()
    device.open()
    before = bench.truth()
    goal = [place + 5e-4 for place in before]
    reading = arrive(bench, device, goal)
    assert bench.truth() == pytest.approx(goal, abs=2e-6)
    assert list(reading.keys()) == ["pose"]
    reads, _ = XyzTable.channels(device.params)
    assert not [channel for channel in reads if channel.role is Role.CONTACT_FORCE]
    motor = bench.motors[1]
    assert motor.set[tm.MAX_SPEED] == round(0.3 / 0.02 * 51200)
    assert motor.set[tm.MAX_ACCELERATION] == round(20.0 / 0.02 * 51200)
    device.close()
    assert all(motor.mode == 0 for motor in bench.motors.values())


def test_the_modules_own_ramp_keeps_speed_and_acceleration() -> None:
    motor, places = VirtualStepper(0), list[float]()
    motor.watch(0.0)
    motor.put(tm.MAX_SPEED, 100_000)
    motor.put(tm.MAX_ACCELERATION, 1_000_000)
    motor.move(20_000)
    for tick in range(1, 501):
        motor.watch(1e-3 * tick)
        places.append(motor.counter)
    rates = [1e3 * (b - a) for a, b in zip(places, places[1:], strict=False)]
    assert max(rates) == pytest.approx(100_000, rel=1e-6)
    assert max(abs(b - a) for a, b in zip(rates, rates[1:], strict=False)) <= 1.01e3
    assert max(places) < 20_100
    assert motor.counter == pytest.approx(20_000, abs=1.0)


def test_homing_by_the_modules_own_search_finds_the_low_ends(bench: Bench) -> None:
    device = bench.table(homing="stops")
    reading, _ = records()
    device.open()
    device.read(reading)
    # x has turned after that, to try the heartbeat out, and is back.
    assert reading["pose"][:3] == pytest.approx(LOWS, abs=1e-4)
    assert bench.truth() == pytest.approx(list(reading["pose"][:3]), abs=2e-4)
    device.close()


def test_an_axis_that_finds_no_switch_is_named(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("itouch_xyz_table.tmcl.GRACE", -0.3)
    with pytest.raises(ServoError, match="axis z found no end switch"):
        bench.table(homing="stops").open()
    assert all(motor.mode == 0 for motor in bench.motors.values())


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"heartbeat": False}, "heartbeat cannot be set: .*an unknown parameter; .*heartbeat=.no. lets it run"),
        ({"deaf": True}, r"motor x keeps turning without a request .* nothing would if this program died"),
    ],
)
def test_a_module_without_a_heartbeat_is_refused(bench: Bench, changed: dict[str, bool], words: str) -> None:
    for name, value in changed.items():
        setattr(bench.module, name, value)
    with pytest.raises(ServoError, match=words):
        bench.table().open()
    assert all(motor.mode == 0 for motor in bench.motors.values())


def test_the_heartbeat_stops_a_table_whose_host_is_silent(bench: Bench) -> None:
    device = bench.table()
    device.open()
    assert bench.module.tripped  # it was tried out
    bench.module.tripped = False
    reading, command = records()
    command["pose_target"] = (*[low + 0.9 * length for low, length in zip(LOWS, TRAVEL, strict=True)], 1.0, 0, 0, 0)
    device.write(command)
    device.read(reading)
    limit = time.monotonic() + 300.0
    while not bench.module.tripped and time.monotonic() < limit:
        time.sleep(0.01)
    assert all(motor.mode == 0 for motor in bench.motors.values())


@pytest.mark.parametrize("moved", [True, False])
def test_a_module_that_started_anew_is_told(bench: Bench, moved: bool) -> None:
    device = bench.table()
    reading, _ = records()
    device.open()
    device.read(reading)
    arrive(bench, device, [place + 1e-4 for place in bench.truth()])
    counts = [motor.get(tm.ACTUAL) for motor in bench.motors.values()]
    bench.module.restart()
    for motor, count in zip(bench.motors.values(), counts, strict=True):
        motor.put(tm.ACTUAL, 0 if moved or count is None else count)  # it may count as before, by chance
    with pytest.raises(ServoError, match="the module has restarted"):
        arrive(bench, device, list(reading["pose"][:3]))
        arrive(bench, device, list(reading["pose"][:3]))
    device.close()


def test_no_motor_is_told_to_move_by_a_module_that_started_anew(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    device, told = bench.table(), list[float]()
    device.open()
    goal = [place + 1e-4 for place in bench.truth()]
    arrive(bench, device, goal)
    counts = [motor.get(tm.ACTUAL) or 0 for motor in bench.motors.values()]
    bench.module.restart()
    for motor, count in zip(bench.motors.values(), counts, strict=True):
        motor.put(tm.ACTUAL, count)  # it counts as before, by chance
    monkeypatch.setattr(VirtualStepper, "move", lambda motor, place: told.append(place))
    reading, command = records()
    command["pose_target"] = (*[place + 1e-4 for place in goal], 1.0, 0.0, 0.0, 0.0)
    device.write(command)
    with pytest.raises(ServoError, match="the module has restarted"):
        device.read(reading)
    assert told == []


def test_a_motor_that_does_not_take_its_stop_keeps_no_other_from_it(bench: Bench) -> None:
    device = bench.table()
    device.open()
    arrive(bench, device, [place + 1e-4 for place in bench.truth()])
    lost = bench.module.motors.pop(0)
    with pytest.raises(ServoError, match="motor x refuses command 3"):
        device.close()
    assert lost.mode != 0
    assert all(motor.mode == 0 for motor in bench.module.motors.values())


@pytest.mark.parametrize("kind", ["damaged", "cut", "lost", "long"])
def test_one_bad_frame_in_ten_ends_nothing(bench: Bench, kind: str) -> None:
    random = Random(11)

    def spoil(data: bytes) -> bytes:
        if random.random() > 0.1:
            return data
        at = random.randrange(len(data))
        return {
            "damaged": data[:at] + bytes((data[at] ^ 0x41,)) + data[at + 1 :], "cut": data[:at], "lost": b"",
            "long": data[:at] + b"\x55" + data[at:],
        }[kind]  # fmt: skip

    device = bench.table(patience=PATIENT if kind == "damaged" else 2.0)
    device.open()
    bench.module.spoil = spoil
    goal = [place + 2e-4 for place in bench.truth()]
    reading = arrive(bench, device, goal)
    for _ in range(20):
        reading = arrive(bench, device, goal)
    assert reading["pose"][:3] == pytest.approx(goal, abs=2e-6)
    assert device._servos.repeated > 3  # type: ignore[union-attr]
    bench.module.spoil = lambda data: data
    device.close()


def test_a_request_that_is_damaged_is_made_again(bench: Bench) -> None:
    device = bench.table()
    device.open()
    spoilt, heard = [3], bench.terminal.receive

    def receive() -> bytes:
        data = heard()
        if data and spoilt[0]:
            spoilt[0] -= 1
            data = bytes((data[0] ^ 8,)) + data[1:]
        return data

    bench.terminal.receive = receive  # type: ignore[method-assign]
    reading, _ = records()
    device.read(reading)
    assert reading["pose"][:3] == pytest.approx(bench.truth(), abs=1e-5)
    assert spoilt == [0]
    device.close()


@pytest.mark.parametrize("spoilt", [0.0, 0.1])
def test_an_adaptor_that_echoes_is_lived_through(bench: Bench, spoilt: float) -> None:
    """On a line of two wires whoever sends hears himself first; one answer in ten is damaged besides."""
    random, heard = Random(3), bench.terminal.receive

    def receive() -> bytes:
        data = heard()
        bench.terminal.send(data)
        return data

    bench.terminal.receive = receive  # type: ignore[method-assign]
    device = bench.table()
    device.open()
    bench.module.spoil = lambda data: data[:3] + b"\x41" + data[4:] if random.random() < spoilt else data
    reading = arrive(bench, device, [place + 1e-4 for place in bench.truth()])
    assert reading["pose"][:3] == pytest.approx(bench.truth(), abs=1e-5)
    bench.module.spoil = lambda data: data
    device.close()


@pytest.mark.parametrize("others", [1, 3])
def test_answers_of_another_module_on_the_bus_are_passed_over(bench: Bench, others: int) -> None:
    """On RS485 a second host may ask its own modules: before each answer of ours come some of theirs."""
    chance = Random(others)

    def crowd(data: bytes) -> bytes:
        theirs = b"".join(
            tm.answer(tm.Answer(7, chance.choice((tm.OK, 3, 4)), tm.GET_AXIS, chance.randrange(1 << 20)))
            for _ in range(others)
        )
        return theirs + data if data else b""

    bench.hold = crowd
    device = bench.table()
    device.open()
    goal = [place + 5e-4 for place in bench.truth()]
    assert arrive(bench, device, goal)["pose"][:3] == pytest.approx(goal, abs=2e-6)
    assert bench.truth() == pytest.approx(goal, abs=2e-6)
    device.close()


def test_a_port_that_vanishes_while_the_table_is_led_is_named(bench: Bench) -> None:
    device = bench.table()
    device.open()
    reading, _ = records()
    device.read(reading)
    bench.unplug()
    with pytest.raises(ServoError, match=f"the module's port {bench.terminal.path} failed: .*; check its plug"):
        for _ in range(100):
            device.read(reading)


@pytest.mark.parametrize("late", [10e-3, 30e-3])
def test_late_answers_are_lived_through(bench: Bench, late: float) -> None:
    bench.hold = delayed(late)
    device = bench.table()
    device.open()
    reading = arrive(bench, device, [place + 1e-4 for place in bench.truth()])
    assert reading["pose"][:3] == pytest.approx(bench.truth(), abs=1e-5)
    device.close()


@pytest.mark.parametrize("count", [1, 3])
def test_an_answer_that_comes_too_late_is_no_answer_to_the_next_request(bench: Bench, count: int) -> None:
    """Each axis reads its own place: an answer says neither which parameter nor which motor it is of."""
    patience, waiting, late = 4.0, list[tuple[float, bytes]](), [0]

    def hold(data: bytes) -> bytes:
        now = time.monotonic()
        if data:
            longer = 1.1 * patience * PATIENCE if late[0] > 0 else 0.0
            late[0] -= 1
            waiting.append((max([now + longer, *(when for when, _ in waiting[-1:])]), data))
        out = b""
        while waiting and waiting[0][0] <= now:
            out += waiting.pop(0)[1]
        return out

    bench.hold = hold
    device = bench.table(patience=patience)
    device.open()
    reading, _ = records()
    late[0] = count
    for _ in range(4):
        device.read(reading)
        assert reading["pose"][:3] == pytest.approx(bench.truth(), abs=1e-5)
    device.close()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"microsteps": (51200.0, 51200.0, 1e6)}, r"motor z refuses command 5, type 4.*reduce speed"),
        ({"acceleration": 200.0, "microsteps": (51200.0, 51200.0, 1e5)}, r"motor z: 4000000000 .* no module"),
        ({"motors": (0.0, 1.0, 5.0)}, "motor z refuses command"),
        ({"address": 4}, r"\(module 4\) does not answer: check its cable, supply and address"),
    ],
)
def test_what_a_module_cannot_do_is_told(bench: Bench, more: dict[str, Any], words: str) -> None:
    with pytest.raises(ServoError, match=words):
        bench.table(patience=1.0, **more).open()


def test_what_is_missing_is_told_with_what_to_do() -> None:
    with pytest.raises(DeviceError, match="cannot be opened"):
        XyzTable(XyzTableParams(tmcl="/dev/no-such-port")).open()
    assert "there is nothing at '/dev/no-such" in XyzTable.unavailable_reason(XyzTableParams(tmcl="/dev/no-such-port"))
    for wrong in ({"tmcl": "/dev/null", "port": "/dev/null"}, {"tmcl": "/dev/null", "motors": (0.0, 0.0, 1.0)}):
        with pytest.raises(ValueError, match="write one of them|three different"):
            XyzTableParams(**wrong)  # type: ignore[arg-type]
    assert XyzTable.exchange_time_for(XyzTableParams(tmcl="/dev/null")) == pytest.approx(0.021)
    assert XyzTable.exchange_time_for(XyzTableParams()) == 0.0


def test_a_port_that_is_none_or_not_ours_is_told_before_anybody_holds_a_switch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = Terminal()
    (tmp_path / "notes.txt").touch()
    assert XyzTable.unavailable_reason(XyzTableParams(tmcl=str(tmp_path / "notes.txt"))).endswith(
        "notes.txt' is not a serial port"
    )
    assert XyzTable.unavailable_reason(XyzTableParams(port="/dev/null")) == "'/dev/null' is not a serial port"
    ours = XyzTableParams(tmcl=terminal.path)
    assert XyzTable.unavailable_reason(ours) == ""
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # who runs the tests may be root
    assert "you may not open" in XyzTable.unavailable_reason(ours)
    terminal.close()


def test_the_trace_is_readable_text_of_frames(bench: Bench) -> None:
    stream = io.StringIO()
    device = bench.table()
    device.trace = Trace(stream, "table")
    device.open()
    device.close()
    assert 'table > "030300000000000006"' in stream.getvalue()
    assert 'table < "0203640300000000' in stream.getvalue()


@given(st.binary(max_size=60))
def test_the_virtual_module_survives_any_bytes(data: bytes) -> None:
    module = VirtualTmcl({0: VirtualStepper(0)})
    module.take(data, lambda: 0.0)
    module.take(b"", lambda: 1.0)


def test_check_says_that_the_force_is_unknown_and_refuses_touch_off(
    rig: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli(["check", str(rig)]) == 0
    told = capsys.readouterr()
    assert "no-plate-force" in told.out + told.err
    assert "device 'table' carries a surface and measures no force" in told.out + told.err
    path = rig.parent / "rigs" / "wire.xml"
    mount = '<mount pos="0 0 -8 mm" mount-error="2 -1.5 3 mm"/>'
    path.write_text(path.read_text().replace(mount, mount + '<calibration method="touch-off"/>'))
    assert cli(["check", str(rig)]) == 2
    told = capsys.readouterr()
    assert "measures no force, so it cannot feel the plate by touch-off" in told.out + told.err


def test_a_module_without_a_heartbeat_runs_when_the_scene_says_so(bench: Bench) -> None:
    bench.module.heartbeat = False
    device = bench.table(heartbeat=False)
    device.open()
    assert not bench.module.tripped
    goal = [place + 5e-4 for place in bench.truth()]
    arrive(bench, device, goal)
    assert bench.truth() == pytest.approx(goal, abs=2e-6)
    bench.module.restart()
    with pytest.raises(ServoError, match="the module has restarted"):
        arrive(bench, device, goal)
    assert (XyzTable.watchdog_for(device.params), XyzTable.second_opener_for(device.params)) == (None, True)
    for params in (XyzTableParams(), XyzTableParams(tmcl="/dev/null")):
        assert (XyzTable.watchdog_for(params), XyzTable.second_opener_for(params)) == (0.1, False)


def test_a_second_opener_stops_a_module_without_a_heartbeat_where_it_is(bench: Bench) -> None:
    """The first one hangs in the middle of a way; the guardian's neither homes nor leads the axes anywhere."""
    bench.module.heartbeat = False
    more = {"heartbeat": False, "speed": 0.01}
    first, guardian = bench.table(**more), bench.table(homing="stops", **more)  # type: ignore[arg-type]
    first.open()
    reading, command = records()
    before = bench.truth()
    far = [low + 0.9 * length for low, length in zip(LOWS, TRAVEL, strict=True)]
    command["pose_target"] = (*far, 1.0, 0.0, 0.0, 0.0)
    first.write(command)
    first.read(reading)
    guardian.make_safe(command)
    assert all(motor.mode == 0 for motor in bench.motors.values())
    stood = bench.truth()
    assert all(low - 1e-9 <= at < high for low, at, high in zip(before, stood, far, strict=True))


@pytest.mark.parametrize("beats", [True, False])
def test_check_and_safety_report_say_what_nothing_in_itself_stops(
    beats: bool, rig: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = rig.parent / "rigs" / "wire.xml"
    path.write_text(path.read_text().replace('tmcl="', f'heartbeat="{"yes" if beats else "no"}" tmcl="'))
    assert cli(["check", str(rig)]) == 0
    told = capsys.readouterr().out
    said = (
        "device 'table' has no watchdog of its own that its driver knows of: it runs only with the guardian process and"
    )
    assert (said in told) is not beats
    assert cli(["safety-report", str(rig), "--no-run"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if "table" in line]
    alone = [row for row in rows if "W2" in row and "it runs with guardian and hold-to-run only" in row]
    assert len(alone) == (not beats)
    # Steppers measure no force, with a heartbeat or without.
    assert [row for row in rows if "K4" in row and "unknown: the device measures none" in row]


@pytest.fixture
def rig(scenes: Path) -> Path:
    """The wire scene with its table on steppers."""
    path = scenes / "rigs" / "wire.xml"
    text = path.read_text()
    text = text.replace('port="/tmp/itouch-table"', 'tmcl="/tmp/itouch-steppers"')
    path.write_text(text.replace('<calibration method="touch-off"/>', ""))
    return scenes / "four_materials_wire.xml"


def test_two_rigs_of_steppers_run_in_step_and_every_bit_is_the_same(rig: Path) -> None:
    places: list[list[bytes]] = []
    for _ in range(2):
        both, seen = Lockstep(str(rig), only=["table"]), list[bytes]()
        both.host.taps.append(lambda tick, both=both, seen=seen: seen.append(both.host.state["table.pose"].tobytes()))
        report = both.run(0.4)
        assert report["faults"] == []
        places.append(seen)
    assert places[0] == places[1]
    assert len(set(places[0])) > 5


def test_two_rigs_of_steppers_are_served_at_once(rig: Path) -> None:
    rigs = [Lockstep(str(rig), only=["table"]) for _ in range(2)]
    with rigs[0].serving(), rigs[1].serving():
        for both in rigs:
            both.host.enable()
            both.host.run(0.05)
        for both in rigs:
            assert both.host.fault is None
            both.host.close()
            both.world.close()
