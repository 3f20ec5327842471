"""The table's driver with the unmodified moteus client, against virtual servos on a pseudo-terminal."""

from __future__ import annotations

import contextlib
import io
import math
import struct
import threading
import time
from collections.abc import Iterator
from random import Random

import channel_records
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch.plugin import DeviceError, Record, Terminal, Trace
from itouch_xyz_table import XyzTable, XyzTableParams
from itouch_xyz_table.faults import fault_name
from itouch_xyz_table.multiplex import Read, Write, decode, reply
from itouch_xyz_table.servos import ServoError, ServoFault, Servos, ServoTimeout
from itouch_xyz_table.virtual import FEED, GOAL, GOAL_SPEED, MOST, WATCHDOG, VirtualBus, VirtualServo, checksum

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

PARAMS = {"lead": (0.01, 0.02, 0.005), "direction": (1.0, -1.0, 1.0), "travel": (0.012, 0.01, 0.008)}


class Bench:
    """Three virtual servos served in a thread."""

    def __init__(self) -> None:
        self.terminal = Terminal()
        self.bus = VirtualBus({})
        for number, (lead, sign, travel) in enumerate(zip(*PARAMS.values(), strict=True), 1):
            turns = travel / lead
            self.bus.servos[number] = VirtualServo(number, low=0.0, high=turns, place=turns * 0.7, zero=3.0 * sign)
        self.now = 0.0
        #: Whether the host may be silent: else the bench's time waits for its next frame, however busy the machine is.
        self.silence = False
        self._stop = False
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        last, heard = time.monotonic(), self.now
        while not self._stop:
            now = time.monotonic()
            lapse = min(now - last, 5e-3)
            if self.now - heard > 20e-3 and not self.silence:
                lapse = 0.0
            self.now += lapse
            for servo in self.bus.servos.values():
                servo.watch(self.now)
                servo.advance(lapse)
            last = now
            data = self.terminal.receive()
            if data:
                heard = self.now
                self.terminal.send(self.bus.take(data, lambda: self.now))
            else:
                time.sleep(2e-4)

    def homed(self) -> None:
        """Let servos that were never told a place count from where they are."""
        for servo in self.bus.servos.values():
            if abs(servo.zero) == 3.0:
                servo.zero = -servo.place

    def close(self) -> None:
        if self._stop:  # unplugged before
            return
        self._stop = True
        self._thread.join()
        self.terminal.close()


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def table(bench: Bench, *, patience: float = 12.0, **changed: object) -> XyzTable:
    """A table that waits longer for answers than a real one would: the machine may be busy."""
    if changed.get("homing") == "absolute":
        bench.homed()
    device = XyzTable(XyzTableParams(port=bench.terminal.path, **(PARAMS | changed)))  # type: ignore[arg-type]
    device.timeout_factor = patience
    return device


def records() -> tuple[Record, Record]:
    return channel_records.records(XyzTable, XyzTableParams())


def go(device: XyzTable, place: tuple[float, float, float], seconds: float, *, arrive: bool = True) -> Record:
    reading, command = records()
    command["pose_target"] = (*place, 1.0, 0.0, 0.0, 0.0)
    end = time.monotonic() + seconds
    while True:  # at least so long, and until it is there, however busy the machine is
        device.write(command)
        device.read(reading)
        there = max(abs(a - b) for a, b in zip(reading["pose"].tolist(), place, strict=False)) < 5e-6
        now = time.monotonic()
        if now > end and (there or not arrive or now > end + 15.0):
            return reading


def test_it_homes_goes_where_it_is_sent_and_stops(bench: Bench) -> None:
    device = table(bench, weight=2.0)
    device.open()
    reading = go(device, (0.004, -0.003, 0.005), 0.5)
    assert reading["pose"][:3] == pytest.approx((0.004, -0.003, 0.005), abs=1e-5)
    x, y, z = (bench.bus.servos[n] for n in (1, 2, 3))
    # The ends of the travel are where homing found them, whatever the servos said before: low is 0 turns of x and z,
    # and the last turn of y, whose servo turns the other way.
    assert x.place == pytest.approx((0.004 + 0.006) / 0.01, abs=1e-2)
    assert y.place == pytest.approx(0.01 / 0.02 - (-0.003 + 0.005) / 0.02, abs=1e-2)
    assert z.place == pytest.approx(0.005 / 0.005, abs=1e-2)
    assert z.registers[FEED] == pytest.approx(2.0 * 0.005 / (math.tau * 0.9), rel=1e-6)
    assert all(s.registers[WATCHDOG] == pytest.approx(0.1) for s in (x, y, z))
    assert all(s.registers[MOST] == pytest.approx(0.05) for s in (x, y, z))
    device.close()
    assert {s.mode for s in (x, y, z)} == {0}


def test_the_watchdog_is_armed_before_anything_moves(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[bytes] = []
    take = VirtualBus._line

    def noted(self: VirtualBus, line: bytes, now: float) -> bytes:
        lines.append(line)
        return take(self, line, now)

    monkeypatch.setattr(VirtualBus, "_line", noted)
    device = table(bench)
    device.open()
    go(device, (0.0, 0.0, 0.004), 0.05, arrive=False)
    device.close()
    moves = [decode(bytes.fromhex(line.split()[3].decode())) for line in lines]
    position = [parts for parts in moves if Write(0, 0, 10) in parts]
    assert len(position) > 20
    assert all(any(isinstance(p, Write) and p.register == WATCHDOG for p in parts) for parts in position)


def test_silence_latches_a_timeout_that_opening_ends(bench: Bench) -> None:
    device = table(bench)
    device.open()
    go(device, (0.0, 0.0, 0.004), 0.1, arrive=False)
    bench.silence, end = True, bench.now + 0.2
    while bench.now < end:
        time.sleep(0.02)
    bench.silence = False
    with pytest.raises(ServoTimeout, match="servo x was without command"):
        go(device, (0.0, 0.0, 0.004), 0.1, arrive=False)
    with pytest.raises(ServoTimeout):  # it does not go on by itself
        go(device, (0.0, 0.0, 0.004), 0.1, arrive=False)
    device.close()
    device.open()
    assert go(device, (0.0, 0.0, 0.004), 0.3)["pose"][2] == pytest.approx(0.004, abs=1e-5)
    device.close()


@pytest.mark.parametrize(
    ("code", "words"), [(33, "motor driver fault"), (40, "under voltage"), (38, "over temperature")]
)
def test_a_fault_is_named_with_its_axis(bench: Bench, code: int, words: str) -> None:
    device = table(bench, homing="absolute")
    device.open()
    go(device, (0.0, 0.0, 0.004), 0.05, arrive=False)
    bench.bus.servos[2].trip(code)
    with pytest.raises(ServoFault, match=f"servo y stopped: {words} .code {code}."):
        go(device, (0.0, 0.0, 0.004), 0.1, arrive=False)
    device.close()


def test_a_port_that_vanishes_while_the_table_is_led_is_named(bench: Bench) -> None:
    device = table(bench, homing="absolute")
    device.open()
    reading, _ = records()
    device.read(reading)
    bench.close()
    with pytest.raises(ServoError, match=f"the servos' bus {bench.terminal.path} failed: .*; check its plug"):
        for _ in range(100):
            device.read(reading)
    device.close()


def test_a_missing_servo_is_named(bench: Bench) -> None:
    bench.bus.servos[3].answers = False
    with pytest.raises(ServoError, match="servo z .id 3. does not answer"):
        table(bench, patience=1.0).open()


def test_lost_and_garbled_answers_end_in_a_named_error_or_in_the_truth(bench: Bench) -> None:
    device = table(bench, homing="absolute", patience=1.0)
    device.open()
    reading, _ = records()
    for fault in ("mute", "garble"):
        setattr(bench.bus, fault, 1)
        begin = time.monotonic()
        with contextlib.suppress(ServoError):
            device.read(reading)
        assert time.monotonic() - begin < 60.0  # it ends
        device.read(reading)
    device.close()


def test_one_damaged_line_in_ten_ends_no_session(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    write, random = bench.terminal.send, Random(5)

    def send(data: bytes) -> None:
        lines = data.splitlines(keepends=True)
        for at, line in enumerate(lines):
            if random.random() < 0.1 and len(line) > 8:
                place = random.randrange(len(line) - 1)
                lines[at] = line[:place] + bytes((line[place] ^ 1 + random.randrange(15),)) + line[place + 1 :]
        write(b"".join(lines))

    device = table(bench, homing="absolute", patience=2.0)
    device.open()
    reading, _ = records()
    monkeypatch.setattr(bench.terminal, "send", send)
    truth = [(s.place + s.zero) * lead for s, lead in zip(bench.bus.servos.values(), (0.01, -0.02, 0.005), strict=True)]
    for _ in range(40):
        device.read(reading)
        assert reading["pose"][:3] == pytest.approx(truth, abs=2e-4)
    monkeypatch.setattr(bench.terminal, "send", write)
    device.close()


def test_the_force_is_what_the_motors_push_against(bench: Bench) -> None:
    device = table(bench, homing="absolute", weight=1.5, max_torque=(0.05, 0.05, 0.05))
    bench.bus.servos[3].zero = 0.0
    device.open()
    bench.bus.servos[3].load = (1.5 + 4.0) * 0.005 / (math.tau * 0.9)
    reading = go(device, (0.0, 0.0, 0.004), 0.1, arrive=False)
    assert reading["wrench"][2] == pytest.approx(-4.0, abs=0.05)
    device.close()


def test_an_axis_without_an_end_is_told(bench: Bench) -> None:
    for servo in bench.bus.servos.values():
        servo.low, servo.high = -math.inf, math.inf
    begin = time.monotonic()
    with pytest.raises(ServoError, match="axis z found no end"):
        table(bench).open()
    assert time.monotonic() - begin < 60.0  # it ends


def test_a_rotation_and_a_closed_table_are_refused(bench: Bench) -> None:
    device = table(bench)
    reading, command = records()
    command["pose_target"] = (0, 0, 0, 0.7, 0.7, 0, 0)
    with pytest.raises(ValueError, match="locked"):
        device.write(command)
    with pytest.raises(DeviceError, match="not open"):
        device.read(reading)
    with pytest.raises(DeviceError, match="cannot be opened"):
        XyzTable(XyzTableParams(port="/dev/no-such-port")).open()


@pytest.mark.parametrize("wrong", [{"direction": (1, 0.5, 1)}, {"ids": (1, 1, 2)}, {"ids": (1, 2.5, 3)}])
def test_bad_parameters_are_named(wrong: dict[str, tuple[float, float, float]]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        XyzTableParams(**wrong)  # type: ignore[arg-type]


def test_a_trace_of_the_bus_is_text(bench: Bench) -> None:
    stream = io.StringIO()
    device = table(bench, homing="absolute")
    device.trace = Trace(stream, "table")
    device.open()
    go(device, (0.0, 0.0, 0.005), 0.02, arrive=False)
    device.close()
    assert 'table > "can send 8001 ' in stream.getvalue()
    assert 'table < "rcv 0100 ' in stream.getvalue()


def test_a_full_cycle_is_fast_enough_for_a_servo_loop(bench: Bench) -> None:
    servos = Servos(bench.terminal.path, (1, 2, 3), watchdog=0.1, patience=12.0)
    durations = []
    for _ in range(100):
        begin = time.monotonic()
        servos.query()
        durations.append(time.monotonic() - begin)
    servos.close()
    assert min(durations) < 0.02


# --- the servo's side of the protocol ---------------------------------------------------------------------------------


def test_a_frame_equals_the_protocols_example() -> None:
    """From the protocol's own example: mode 10; position 0.5 rev as float; query mode to torque as int8s."""
    frame = bytes((0x01, 0x00, 0x0A, 0x0D, 0x20)) + struct.pack("<f", 0.5) + bytes((0x10, 0x04, 0x00, 0x50))
    assert decode(frame) == [Write(0, 0, 10), Write(0x20, 3, 0.5), Read(0, 0, 4)]
    assert reply(Read(0, 0, 4), [10, 50, -3, math.nan]) == bytes((0x20, 0x04, 0x00, 10, 50, 0xFD, 0x80))
    assert reply(Read(1, 3, 1), [0.25]) == bytes((0x2D, 0x01)) + struct.pack("<f", 0.25)


@given(st.binary(max_size=64))
def test_any_bytes_are_a_frame_or_an_error(data: bytes) -> None:
    with contextlib.suppress(ValueError, struct.error):
        decode(data)


def test_what_the_client_sends_is_what_was_meant() -> None:
    import moteus

    servo = VirtualServo(5)
    made = moteus.Controller(id=5).make_position(
        position=1.25, velocity=-0.5, feedforward_torque=0.02, maximum_torque=0.4, watchdog_timeout=0.1, query=True
    )
    servo.take(made.data, 1.0)
    assert servo.mode == 10
    assert {r: servo.registers[r] for r in (GOAL, GOAL_SPEED, FEED, MOST, WATCHDOG)} == pytest.approx(
        {GOAL: 1.25, GOAL_SPEED: -0.5, FEED: 0.02, MOST: 0.4, WATCHDOG: 0.1}, rel=1e-6
    )
    servo.watch(1.09)
    assert servo.mode == 10
    servo.watch(1.11)
    assert servo.mode == 11
    servo.take(made.data, 1.2)
    assert servo.mode == 11, "a time-out stays until the servo is stopped"


def test_the_adaptors_checksum_is_the_clients() -> None:
    from moteus.fdcanusb_device import _compute_crc8

    for text in (b"", b"OK ", b"rcv 0100 20040a E B F ", bytes(range(256))):
        assert checksum(text) == _compute_crc8(text)


def test_faults_have_the_names_of_the_protocol() -> None:
    assert fault_name(35) == "encoder fault"
    assert fault_name(99) == "limited by current"
    assert fault_name(77) == "fault 77"


# --- an adaptor with other habits -------------------------------------------------------------------------------------


@pytest.mark.parametrize("habit", ["pieces", "returns", "chatter", "empty lines"])
def test_an_adaptor_may_split_pad_and_mix_its_lines(bench: Bench, habit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    write = bench.terminal.send

    def send(data: bytes) -> None:
        if habit == "returns":
            data = data.replace(b"\n", b"\r\n")
        elif habit == "chatter":  # a frame of another node on the bus
            text = b"rcv 1200 50 E B F"
            data = data + b"%s *%02X\n" % (text, checksum(text + b" "))
        elif habit == "empty lines":
            data = b"\n" + data
        size = 7 if habit == "pieces" else len(data)
        for at in range(0, len(data), size):
            write(data[at : at + size])
            time.sleep(2e-4)

    monkeypatch.setattr(bench.terminal, "send", send)
    device = table(bench, homing="absolute")
    device.open()
    reading, command = records()
    for _ in range(10):
        assert device.read(reading)
    leads = (0.01, -0.02, 0.005)
    truth = [(s.place + s.zero) * lead for s, lead in zip(bench.bus.servos.values(), leads, strict=True)]
    assert reading["pose"][:3] == pytest.approx(truth, abs=1e-5)
    command["pose_target"] = (*(place + 1e-4 for place in truth), 1.0, 0.0, 0.0, 0.0)
    device.write(command)
    device.read(reading)
    for servo, lead, place in zip(bench.bus.servos.values(), leads, truth, strict=True):
        assert servo.registers[GOAL] * lead == pytest.approx(place + 1e-4, abs=1e-5)
    device.close()


def test_without_an_adaptor_it_is_told_before_anybody_holds_a_switch(monkeypatch: pytest.MonkeyPatch) -> None:
    from moteus.fdcanusb_device import FdcanusbDevice

    attached: list[str] = []
    monkeypatch.setattr(FdcanusbDevice, "detect_fdcanusbs", lambda: attached)
    assert XyzTable.unavailable_reason(XyzTableParams()).startswith("no CAN-FD adaptor (fdcanusb) is attached")
    attached.append("/dev/serial/by-id/usb-fdcanusb")
    assert XyzTable.unavailable_reason(XyzTableParams()) == ""
