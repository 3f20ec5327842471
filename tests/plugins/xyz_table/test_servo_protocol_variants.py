"""The table's driver, in its thread, against servos that answer otherwise than ours, or start anew in mid-session."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from random import Random

import pytest
from test_moteus import Bench, records, table

from itouch.exchange import ThreadedDevice
from itouch_xyz_table import homing
from itouch_xyz_table.multiplex import Write
from itouch_xyz_table.servos import ServoError
from itouch_xyz_table.virtual import EXACT, HOME, VirtualBus, VirtualServo, checksum

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def drive(
    device: ThreadedDevice, place: tuple[float, float, float], until: Callable[[list[float]], bool]
) -> list[list[float]]:
    """Lead an open table to a place until something is true of a reading; return all that was read."""
    reading, command = records()
    command["pose_target"] = (*place, 1.0, 0.0, 0.0, 0.0)
    end, found = time.monotonic() + 300.0, list[list[float]]()
    while time.monotonic() < end:
        device.write(command)
        if device.read(reading):
            found.append(reading["pose"][:3].tolist())
            if until(found[-1]):
                return found
        time.sleep(5e-4)
    raise AssertionError("it never came to that")


def near(place: tuple[float, float, float]) -> Callable[[list[float]], bool]:
    return lambda found: max(abs(a - b) for a, b in zip(found, place, strict=True)) < 2e-5


def through_its_answers(bench: Bench, change: Callable[[bytes], bytes]) -> None:
    """Let the adaptor change the bytes of servos' answers, with a check sum that is right."""
    write = bench.terminal.send

    def send(data: bytes) -> None:
        lines = data.splitlines(keepends=True)
        for at, line in enumerate(lines):
            if line.startswith(b"rcv"):
                words = line.rstrip().rpartition(b" *")[0].split()
                words[2] = change(bytes.fromhex(words[2].decode())).hex().encode()
                text = b" ".join(words)
                lines[at] = b"%s *%02X\n" % (text, checksum(text + b" "))
        write(b"".join(lines))

    bench.terminal.send = send  # type: ignore[method-assign]


GOAL = (0.001, 0.0, 0.004)


def test_an_answer_of_which_a_part_is_missing_is_none(bench: Bench) -> None:
    """One in ten: such a servo is asked again, and no reading is made of what it has not said."""
    chance, short = Random(3), [0]

    def cut(answer: bytes) -> bytes:
        if chance.random() >= 0.1:
            return answer
        short[0] += 1
        return answer[:3]  # its mode, and no more

    through_its_answers(bench, cut)
    device = ThreadedDevice(table(bench), patience=30.0)
    device.open()
    found = drive(device, GOAL, near(GOAL))
    drive(device, GOAL, lambda _: short[0] > 20)
    device.close()
    assert all(max(map(abs, place)) < 0.02 for place in found)


class Talkative:
    """A servo that answers in another order, in numbers of another width, and with more than it was asked for."""

    def __init__(self, servo: VirtualServo) -> None:
        object.__setattr__(self, "servo", servo)

    def __getattr__(self, name: str) -> object:
        return getattr(self.servo, name)

    def __setattr__(self, name: str, value: object) -> None:
        setattr(self.servo, name, value)

    def take(self, data: bytes, now: float) -> bytes:
        servo = self.servo
        if not servo.take(data, now):
            return b""
        return b"".join((
            bytes((0x21, 0x0F, servo.fault, 0x22, 0x0D, 48, 31, 0x21, 0x0C, servo.home)),
            b"\x2d\x04" + struct.pack("<f", 0.7),  # a current that nobody has asked for
            b"\x2d\x03" + struct.pack("<f", servo.torque), b"\x29\x02" + struct.pack("<i", round(servo.speed / 1e-5)),
            b"\x2d\x01" + struct.pack("<f", servo.place + servo.zero), b"\x25\x00" + struct.pack("<h", servo.mode),
            b"\x50",
        ))  # fmt: skip


def test_servos_that_answer_in_another_order_and_width(bench: Bench) -> None:
    servos = bench.bus.servos
    servos.update({number: Talkative(servo) for number, servo in servos.items()})  # type: ignore[misc]
    device = ThreadedDevice(table(bench), patience=30.0)
    device.open()
    drive(device, GOAL, near(GOAL))
    device.close()


@pytest.mark.parametrize("axis", [0, 2])
def test_a_servo_that_starts_anew_in_mid_motion_is_told_and_not_led_to_a_wrong_place(bench: Bench, axis: int) -> None:
    """It has lost what homing told it: by its own count the goal is elsewhere, and it obeys at once."""
    device = ThreadedDevice(table(bench), patience=30.0)
    device.open()
    drive(device, GOAL, lambda place: place[2] > 0.002)
    servo = bench.bus.servos[axis + 1]
    stood = servo.place
    servo.start_anew()
    with pytest.raises(ServoError, match=f"{'xyz'[axis]} .*has restarted") as told:
        drive(device, GOAL, lambda _: False)
    assert "check its supply" in str(told.value)
    device.close()
    moved = abs(servo.place - stood) * (0.01, 0.02, 0.005)[axis]
    assert servo.mode == 0
    assert moved < 4e-3
    device.open()  # and it can be homed again
    drive(device, GOAL, near(GOAL))
    device.close()


def test_a_place_that_jumps_is_not_believed(bench: Bench) -> None:
    """A servo that is told nothing at homing, and whose count is another after a start."""
    for servo in bench.bus.servos.values():
        servo.zero = -servo.place
    servos = table(bench, homing="absolute")
    servos.clock = lambda: bench.now  # by the machine's, a table that nobody asked for long may have gone so far
    device = ThreadedDevice(servos, patience=30.0)
    device.open()
    found = drive(device, (0.0, 0.0, 0.0), near((0.0, 0.0, 0.0)))
    # farther than it may have gone in the time of three answers, for each of which a bench waits
    bench.bus.servos[1].zero += 20.0
    with pytest.raises(ServoError, match=r"axis x says that it is .* mm from where it just was"):
        found += drive(device, (0.0, 0.0, 0.0), lambda place: found.append(place) or False)  # type: ignore[func-returns-value]
    assert max(abs(place[0]) for place in found) < 1e-3
    device.close()


def refuses(bench: Bench, monkeypatch: pytest.MonkeyPatch, part: float, *, does_it: bool = False) -> list[int]:
    """Let the adaptor refuse a part of its lines, though it may have done what they say; return how many, counted."""
    chance, count, line = Random(7), [0], VirtualBus._line

    def answer(bus: VirtualBus, asked: bytes, now: float) -> bytes:
        if chance.random() >= part:
            return line(bus, asked, now)
        count[0] += 1
        rest = line(bus, asked, now).partition(b"\n")[2] if does_it else b""
        said = b"ERR tx queue full"
        return (b"%s *%02X\n" % (said, checksum(said + b" ")) if asked[-3:-2] == b"*" else said + b"\n") + rest

    monkeypatch.setattr(VirtualBus, "_line", answer)
    return count


@pytest.mark.parametrize("does_it", [False, True])
def test_an_adaptor_that_refuses_one_line_in_ten_is_asked_again(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, does_it: bool
) -> None:
    """Also while the table homes and its servos are told where they are."""
    count = refuses(bench, monkeypatch, 0.1, does_it=does_it)
    device = ThreadedDevice(table(bench), patience=30.0)
    device.open()
    for goal in (GOAL, (0.0, 0.0, 0.0), GOAL):
        drive(device, goal, near(goal))
    drive(device, GOAL, lambda _: count[0] > 100)
    device.close()


def test_an_adaptor_that_refuses_every_line_is_asked_within_a_bound_and_quoted(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuses(bench, monkeypatch, 1.0)
    with pytest.raises(ServoError, match=r"servo x \(id 1\) does not answer: check its cable .*ERR tx queue full"):
        ThreadedDevice(table(bench, patience=1.0), patience=30.0).open()


def test_a_servo_that_does_not_take_its_place_is_told_and_not_led_by_a_wrong_zero(bench: Bench) -> None:
    """Old firmware passes over a register that it does not know, and answers as if all were well."""

    class Old(VirtualServo):
        def _write(self, write: Write, now: float) -> bool:
            return False if write.register == EXACT else super()._write(write, now)

    for number, servo in bench.bus.servos.items():
        bench.bus.servos[number] = Old(number, low=servo.low, high=servo.high, place=servo.place, zero=3.0)
    device = table(bench)
    with pytest.raises(
        ServoError, match="axis z was told that it is at 0.0 mm and says 15.0 mm: .* update its firmware"
    ):
        device.open()
    assert {servo.mode for servo in bench.bus.servos.values()} == {0}


@pytest.mark.parametrize(
    ("home", "zero", "said"),
    [(0, 0.0, "counts from where it was switched on"), (1, 3.0, "says 30.0 mm, outside its travel of -6 to 6 mm")],
)
def test_servos_that_cannot_know_where_they_are_are_refused(bench: Bench, home: int, zero: float, said: str) -> None:
    for servo in bench.bus.servos.values():
        servo.home, servo.zero = home, zero - servo.place
    with pytest.raises(ServoError, match=f'axis x does not know where it is: .* {said}; .* homing="stops"'):
        table(bench, homing="absolute").open()


def test_an_answer_that_does_not_say_by_what_a_servo_knows_its_place_is_no_new_start(bench: Bench) -> None:
    answers = [0]

    def sometimes(answer: bytes) -> bytes:
        answers[0] += 1
        at = answer.find(bytes((HOME, bench.bus.servos[1].home)))
        return answer[: at + 1] + b"\x80" + answer[at + 2 :] if at >= 0 and answers[0] % 10 == 0 else answer

    device = ThreadedDevice(table(bench, homing="absolute"), patience=30.0)
    device.open()
    through_its_answers(bench, sometimes)
    drive(device, (0.0, 0.0, 0.0), lambda _: answers[0] > 60)
    device.close()


def test_a_line_that_ends_the_clients_reader_in_a_second_try_is_lived_through(bench: Bench) -> None:
    """The client waits longer for its answers than the driver does there, and has no time to tell of it."""
    lines, nonsense = [0], b"rcv 1"
    write = bench.terminal.send

    def send(data: bytes) -> None:
        lines[0] += 1
        if 100 < lines[0] < 104:
            data = b"%s *%02X\n" % (nonsense, checksum(nonsense + b" "))
        write(data)

    bench.terminal.send = send  # type: ignore[method-assign]
    device = ThreadedDevice(table(bench, homing="absolute", patience=2.0), patience=30.0)
    device.open()
    drive(device, (0.0, 0.0, 0.0), lambda _: lines[0] > 200)
    device.close()


def test_an_axis_that_finds_no_end_is_stopped_at_once(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not by its watchdog, a tenth of a second later."""
    monkeypatch.setattr(homing, "_GRACE", -0.3)
    with pytest.raises(ServoError, match="axis z found no end"):
        table(bench).open()
    assert {servo.mode for servo in bench.bus.servos.values()} == {0}
