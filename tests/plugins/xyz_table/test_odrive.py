"""The table on ODrive servos: python-can, unmodified, on its own virtual bus and through a serial adaptor."""

from __future__ import annotations

import contextlib
import io
import math
import threading
import time
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import can
import channel_records
import pytest
from delayed_line import delayed
from hypothesis import given
from hypothesis import strategies as st

from itouch.plugin import DeviceError, Record, Terminal, Trace
from itouch_xyz_table import XyzTable, XyzTableParams, canframes
from itouch_xyz_table.emulator import TableEmulator
from itouch_xyz_table.odrive import Odrives
from itouch_xyz_table.servos import ServoError, ServoFault
from itouch_xyz_table.virtual import FASTEST, FEED, GOAL, GOAL_SPEED, MOST
from itouch_xyz_table.virtual_odrive import VirtualCan, VirtualOdrive

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

LEADS, SIGNS, TRAVEL = (0.01, 0.02, 0.005), (1.0, -1.0, 1.0), (0.012, 0.01, 0.008)
#: A machine that is busy elsewhere is no servo that is silent.
PATIENT = 20.0
#: So long [s] the bench's time waits for the next frame of a host that may be held up; then it is taken for silent.
HELD_UP = 0.9


class Bench:
    """Three virtual servos served in a thread, in a time that stands still when the machine does."""

    def __init__(self, bus: str) -> None:
        self.terminal = Terminal() if bus == "slcan" else None
        self.name = f"slcan:{self.terminal.path}" if self.terminal is not None else f"virtual:{id(self)}"
        self.bus: Any = can.Bus(interface="virtual", channel=str(id(self))) if self.terminal is None else None
        self.servos = {
            number: VirtualOdrive(
                number, low=0.0, high=travel / lead, place=0.7 * travel / lead, zero=3.0 * sign, timeout=0.4
            )
            for number, (lead, sign, travel) in enumerate(zip(LEADS, SIGNS, TRAVEL, strict=True), 1)
        }
        self.can = VirtualCan(self.servos)
        self.now, self.frames = 0.0, list[tuple[int, bytes]]()
        self.noise: Callable[[bytes], bytes] = lambda data: data
        self._heard = 0.0, 0.0
        self._tables: list[XyzTable] = []
        self._stop = False
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        last = time.monotonic()
        while not self._stop:
            now = time.monotonic()
            lapse, last = min(now - last, 5e-3), now
            if self.now - self._heard[1] > 20e-3 and now - self._heard[0] < HELD_UP:
                lapse = 0.0
            self.now += lapse
            for servo in self.servos.values():
                servo.watch(self.now)
                servo.advance(lapse)
            if self.terminal is not None:
                data = self.terminal.receive()
                self._heard = (now, self.now) if data else self._heard
                self.terminal.send(self.noise(self.can.take(data, lambda: self.now)))
                time.sleep(2e-4)
            else:
                self._frames()

    def _frames(self) -> None:
        message = self.bus.recv(2e-4)
        answers = self.can.unasked(self.now)
        if message is not None:
            self._heard = time.monotonic(), self.now
            data = bytes(message.data)
            self.frames.append((message.arbitration_id, data))
            answers += self.can.frame(message.arbitration_id, data, self.now, remote=message.is_remote_frame)
        for number, data in answers:
            self.bus.send(can.Message(arbitration_id=number, data=data, is_extended_id=False))

    def close(self) -> None:
        for device in self._tables:  # what a failing test has left open
            with contextlib.suppress(DeviceError):
                device.close()
        self._stop = True
        self._thread.join()
        for part in (self.terminal, self.bus):
            if part is not None:
                part.close() if isinstance(part, Terminal) else part.shutdown()

    def table(self, *, homing: str = "absolute", **more: Any) -> XyzTable:
        for servo in self.servos.values():
            if homing == "absolute" and abs(servo.zero) == 3.0:  # as one that knows where it is
                servo.zero = -servo.place
        device = XyzTable(
            XyzTableParams(bus=self.name, lead=LEADS, direction=SIGNS, travel=TRAVEL, homing=homing, **more)
        )
        device.timeout_factor = PATIENT
        self._tables.append(device)
        return device

    def truth(self) -> list[float]:
        """Where the axes say that they are [m]."""
        leads = (lead * sign for lead, sign in zip(LEADS, SIGNS, strict=True))
        return [(servo.place + servo.zero) * lead for servo, lead in zip(self.servos.values(), leads, strict=True)]


@pytest.fixture(params=["virtual", "slcan"])
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    made = Bench(request.param)
    yield made
    made.close()


@pytest.fixture
def quiet() -> Iterator[Bench]:
    made = Bench("virtual")
    yield made
    made.close()


def records() -> tuple[Record, Record]:
    return channel_records.records(XyzTable, XyzTableParams(travel=TRAVEL))


def test_it_goes_where_it_is_told_and_feels_force(bench: Bench) -> None:
    device = bench.table(weight=1.5)
    reading, command = records()
    device.open()
    device.read(reading)
    before = bench.truth()
    assert reading["pose"][:3] == pytest.approx(before, abs=1e-5)
    goal = [place + 5e-4 for place in before]
    command["pose_target"] = (*goal, 1.0, 0.0, 0.0, 0.0)
    for _ in range(400):
        device.write(command)
        device.read(reading)
        if reading["pose"][:3] == pytest.approx(goal, abs=2e-5):
            break
    assert bench.truth() == pytest.approx(goal, abs=5e-5)
    servo = bench.servos[3]
    assert servo.registers[FASTEST] == pytest.approx(0.3 / 0.005, rel=1e-6)
    assert servo.registers[MOST] == pytest.approx(0.05, rel=1e-5)
    assert servo.registers[FEED] == pytest.approx(1.5 * 0.005 / (math.tau * 0.9), abs=6e-4)  # thousandths of a N m
    servo.load = (1.5 + 4.0) * 0.005 / (math.tau * 0.9)
    for _ in range(3):
        time.sleep(5e-3)
        device.write(command)
        device.read(reading)
    assert reading["wrench"][2] == pytest.approx(-4.0, abs=0.05)
    device.close()
    assert all(servo.mode == 0 for servo in bench.servos.values())


def test_homing_finds_the_low_ends(quiet: Bench) -> None:
    device = quiet.table(homing="stops")
    device.open()
    reading, _ = records()
    device.read(reading)
    ends = [servo.low if sign > 0 else servo.high for servo, sign in zip(quiet.servos.values(), SIGNS, strict=True)]
    assert [servo.place for servo in quiet.servos.values()] == pytest.approx(ends, abs=1e-2)
    assert reading["pose"][:3] == pytest.approx((-TRAVEL[0] / 2, -TRAVEL[1] / 2, 0.0), abs=1e-4)
    device.close()


def test_a_watchdog_that_is_off_refuses_the_table(quiet: Bench) -> None:
    quiet.servos[2].timeout = math.inf
    with pytest.raises(ServoError, match=r"servo y \(id 2\) goes on without being commanded.*enable_watchdog"):
        quiet.table().open()
    assert all(servo.mode == 0 for servo in quiet.servos.values())


@pytest.mark.parametrize(
    ("tripped", "refused", "words"),
    [
        (0x8000, 0, r"servo z \(id 3\) let go in silence, but not by its own watchdog: velocity limit \(0x8000\)"),
        (0, 0x40, r"servo z \(id 3\) cannot be driven.*no input, or the motor failed \(0x40\)"),
    ],
)
def test_only_a_watchdog_that_has_ended_is_a_proof(quiet: Bench, tripped: int, refused: int, words: str) -> None:
    """A z axis that its weight drives back stops in silence, too; one that is never driven has nothing to let go of."""
    quiet.servos[3].ended, quiet.servos[3].refuses = tripped, refused
    with pytest.raises(ServoError, match=words):
        quiet.table().open()
    assert all(servo.mode == 0 for servo in quiet.servos.values())


def test_a_host_that_is_held_up_while_the_watchdogs_are_tried_out_hears_that_they_have_ended(
    quiet: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It said that the first servo had none: what that had told meanwhile was not heard."""
    device, listen, held = quiet.table(), Odrives._listen, list[float]()
    device.timeout_factor = 5.0

    def held_up(servos: Odrives, wait: float) -> None:
        if wait == 0.05 and not held:
            held.append(wait)
            end = quiet.now + 0.6  # longer than the servos' watchdogs
            while quiet.now < end:
                time.sleep(0.01)
            time.sleep(0.8)  # and longer than the host waits for them
        else:
            listen(servos, wait)

    monkeypatch.setattr(Odrives, "_listen", held_up)
    device.open()
    assert held
    device.close()


def test_a_host_that_is_silent_loses_the_servos_and_is_told(quiet: Bench) -> None:
    device = quiet.table()
    reading, _ = records()
    device.open()
    device.read(reading)
    begin = quiet.now
    while quiet.now - begin < 0.5:  # longer than its watchdog
        time.sleep(0.01)
    assert all(servo.mode == 1 for servo in quiet.servos.values())
    with pytest.raises(ServoFault, match="servo x stopped: its watchdog ended"):
        for _ in range(100):
            device.read(reading)
            time.sleep(5e-3)
    device.close()


@pytest.mark.parametrize(("code", "words"), [(0x1000, "current limit"), (0x40000000, "calibration")])
def test_a_servo_that_stops_is_named(quiet: Bench, code: int, words: str) -> None:
    device = quiet.table()
    reading, _ = records()
    device.open()
    quiet.servos[2].trip(code)
    with pytest.raises(ServoFault, match=f"servo y stopped: .*{words}.*error 0x{code:x}"):
        for _ in range(200):
            device.read(reading)
            time.sleep(2e-3)
    device.close()


def test_a_servo_that_started_anew_is_told(quiet: Bench) -> None:
    device = quiet.table()
    reading, command = records()
    device.open()
    command["pose_target"] = (*quiet.truth(), 1.0, 0.0, 0.0, 0.0)
    device.write(command)
    device.read(reading)
    quiet.servos[1].restart()
    with pytest.raises(ServoError, match="servo x does not follow its commands: it is in mode 'stopped'"):
        for _ in range(300):
            device.read(reading)
            time.sleep(1e-3)
    assert quiet.servos[1].mode == 0
    device.close()


def test_one_lost_frame_in_ten_ends_nothing(bench: Bench) -> None:
    random = Random(7)
    device = bench.table()
    device.open()
    reading, _ = records()
    if bench.terminal is None:
        bench.can.lose = lambda: random.random() < 0.1
        bench.can.miss = lambda number: random.random() < 0.1
    else:
        bench.can.miss = lambda number: random.random() < 0.1

        def spoil(data: bytes) -> bytes:
            lines = data.split(b"\r")
            return b"\r".join(
                b"t0?" + line[3:] if random.random() < 0.1 and line[:1] == b"t" else line for line in lines
            )

        bench.noise = spoil
    for _ in range(25):
        device.read(reading)
        assert reading["pose"][:3] == pytest.approx(bench.truth(), abs=1e-4)
    bench.can.lose, bench.noise = (lambda: False), (lambda data: data)
    bench.can.miss = lambda number: False
    device.close()


def test_limits_and_modes_that_got_lost_are_told_again(quiet: Bench) -> None:
    """No servo acknowledges them: each servo's first limits, modes and orders to start are lost after the opening."""
    device = quiet.table()
    lost: set[int] = set()

    def first(number: int) -> bool:
        kinds = (canframes.SET_LIMITS, canframes.SET_MODE, canframes.SET_STATE)
        gone = number & 31 in kinds and number not in lost
        lost.add(number)
        return gone

    quiet.can.miss = first
    device.open()
    lost.clear()
    for servo in quiet.servos.values():
        servo.registers[FASTEST], servo._by_velocity = 1e-3, True  # what it would be without the frame that is lost
    reading, command = records()
    goal = [place + 5e-4 for place in quiet.truth()]
    command["pose_target"] = (*goal, 1.0, 0.0, 0.0, 0.0)
    for _ in range(400):
        device.write(command)
        device.read(reading)
        if reading["pose"][:3] == pytest.approx(goal, abs=2e-5):
            break
    assert [servo.registers[FASTEST] for servo in quiet.servos.values()] == pytest.approx(
        [0.3 / lead for lead in LEADS], rel=1e-6
    )
    assert quiet.truth() == pytest.approx(goal, abs=5e-5)
    device.close()


@pytest.mark.parametrize("late", [10e-3, 30e-3])
def test_late_answers_are_lived_through(late: float) -> None:
    made = Bench("slcan")
    made.noise = delayed(late)
    try:
        device = made.table()
        device.open()
        reading, _ = records()
        for _ in range(5):
            device.read(reading)
            assert reading["pose"][:3] == pytest.approx(made.truth(), abs=1e-4)
        device.close()
    finally:
        made.close()


def test_what_is_missing_is_told_with_what_to_do(quiet: Bench) -> None:
    quiet.servos[3].answers = False
    device = quiet.table()
    device.timeout_factor = 0.5
    with pytest.raises(ServoError, match=r"servo z \(id 3\) sends no heartbeat: check its cable"):
        device.open()
    with pytest.raises(DeviceError, match="cannot be opened"):
        XyzTable(XyzTableParams(bus="slcan:/dev/no-such-port")).open()
    assert "there is nothing at '/dev/no-such" in XyzTable.unavailable_reason(
        XyzTableParams(bus="slcan:/dev/no-such-port")
    )
    assert (
        XyzTable.unavailable_reason(XyzTableParams(bus="slcan:/dev/ptmx@115200")) == ""
    )  # the speed is not part of the place
    assert "no network interface 'nocan7'" in XyzTable.unavailable_reason(XyzTableParams(bus="socketcan:nocan7"))
    assert XyzTable.unavailable_reason(XyzTableParams(bus="socketcan:lo")) == ""
    assert XyzTable.unavailable_reason(XyzTableParams(bus="socketcan:")) == ""  # ODrive servos have no CAN-FD adaptor
    for wrong in ({"bus": "can0"}, {"bus": "socketcan:can0", "port": "/dev/ttyACM0"}):
        with pytest.raises(ValueError, match="bus"):
            XyzTableParams(**wrong)  # type: ignore[arg-type]
    with pytest.raises(DeviceError, match="slcan:PATH"):
        TableEmulator(XyzTableParams(bus="socketcan:can0")).open()


def test_the_trace_is_readable_text_of_frames(quiet: Bench) -> None:
    stream = io.StringIO()
    device = quiet.table()
    device.trace = Trace(stream, "table")
    device.open()
    device.close()
    assert 'table > "029 ?"' in stream.getvalue()
    assert 'table < "021 ' in stream.getvalue()


def test_frames_equal_ones_by_hand() -> None:
    """From the protocol's tables: node 3, position 1.5 rev with -0.25 rev/s and 0.01 N m fed forward."""
    assert canframes.number(3, canframes.SET_POSITION) == 0x6C
    packed = canframes.pack(canframes.SET_POSITION, 1.5, canframes.milli(-0.25), canframes.milli(0.01))
    assert packed == bytes.fromhex("0000c03f") + (-250).to_bytes(2, "little", signed=True) + b"\x0a\x00"
    servo = VirtualOdrive(3)
    servo.hear(canframes.SET_POSITION, packed, 0.0, remote=False)
    assert {at: servo.registers[at] for at in (GOAL, GOAL_SPEED, FEED)} == {GOAL: 1.5, GOAL_SPEED: -0.25, FEED: 0.01}
    assert canframes.heartbeat(bytes.fromhex("0000000108000000")) == (0x1000000, 8)
    assert canframes.error_name(0) == "unknown"


@given(st.binary(max_size=60), st.integers(0, 2047), st.binary(max_size=8))
def test_any_line_and_any_frame_are_survived(line: bytes, number: int, data: bytes) -> None:
    bus = VirtualCan({1: VirtualOdrive(1)})
    bus.take(b"O\r" + line + b"\r", lambda: 0.0)
    for remote in (False, True):
        bus.frame(number, data, 0.0, remote=remote)
