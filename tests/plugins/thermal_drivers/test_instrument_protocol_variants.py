"""The display's drivers against instruments with other habits, all legal: splitting, letters, checks, delays."""

from __future__ import annotations

import contextlib
import random
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from test_thermal_drivers import SENSOR, served

from itouch.plugin import DeviceError, Terminal
from itouch_thermal.drivers import Infrared, LabJack, Mecom
from itouch_thermal.drivers.labjack import LabJackDriver
from itouch_thermal.drivers.mecom import MecomClient, MecomError, MecomRefusal, crc16
from itouch_thermal.drivers.modbus import ModbusLine
from itouch_thermal.drivers.tec import TecDriver
from itouch_thermal.drivers.virtual import Plate, VirtualMecom, VirtualT7

# an instrument is a thread beside the driver here: on a busy machine either is kept waiting
pytestmark = pytest.mark.punctual


def check(body: bytes) -> bytes:
    return body + b"%04X" % crc16(body) + b"\r"


def own_check(answer: bytes) -> bytes:
    """An acknowledgement with a check sum of its own, as one known client demands."""
    return check(answer[:7]) if len(answer) == 12 else answer


def lower(answer: bytes) -> bytes:
    """A value in small letters; the check sum is that of what is sent."""
    body = answer[:7] + answer[7:-5].lower()
    return check(body) if len(answer) > 12 and answer[7:8] != b"T" else answer


def old_first(answer: bytes) -> bytes:
    """The answer to an earlier request comes once more before it."""
    stale = b"!" + answer[1:3] + b"%04X" % (int(answer[3:7], 16) - 1 & 0xFFFF) + b"3F800000"
    return check(stale) + answer


HABITS: dict[str, Callable[[bytes], bytes]] = {
    "own check": own_check, "lower": lower, "noise": lambda answer: b"\x00\xff#!" + answer, "old first": old_first,
    "half an answer before": lambda answer: answer[:5] + answer, "line feed": lambda answer: b"\n" + answer,
    "talks": lambda answer: b"READY\rboot 1.2.3\r" + answer,
}  # fmt: skip


@pytest.mark.parametrize("pieces", [0, 1, 5])
@pytest.mark.parametrize("habit", HABITS)
def test_a_tec_controller_may_split_and_vary_its_answers(habit: str, pieces: int) -> None:
    terminal, device, rng = Terminal(), VirtualMecom(Plate(plate=300.0, sink=301.5), address=2), random.Random(3)
    waiting = bytearray()

    def step() -> None:
        data = terminal.receive()
        for whole in device.take(data).splitlines(keepends=True) if data else ():
            waiting.extend(HABITS[habit](whole))
        size = rng.randrange(1, pieces + 1) if pieces else len(waiting)
        if waiting:
            terminal.send(bytes(waiting[:size]))
            del waiting[:size]

    with served(step):
        tec = TecDriver(Mecom(port=terminal.path, address=0), patience=8.0)  # address 0: whichever is there
        for current in (0.5, -1.25, 2.0):
            reading = tec.exchange(current)
            assert reading.plate == pytest.approx(300.0, abs=1e-4)
            assert device.output() == pytest.approx(current)
        assert reading.sink == pytest.approx(301.5, abs=1e-4)
        tec.close()
        assert device.output() == 0.0
    terminal.close()


@pytest.mark.parametrize("kind", ["damaged", "cut", "lost", "late"])
def test_one_bad_answer_in_ten_ends_nothing(kind: str) -> None:
    """In any order: also several in a row, as chance has it."""
    terminal, device, chance = Terminal(), VirtualMecom(Plate(plate=300.0, sink=301.5), address=2), random.Random(7)
    waiting: list[tuple[float, bytes]] = []
    opened = [False]

    def bad(whole: bytes) -> bytes:
        at = chance.randrange(len(whole) - 1)
        wrong = whole[:at] + bytes((whole[at] ^ 1 << chance.randrange(7),)) + whole[at + 1 :]
        return {"damaged": wrong, "cut": whole[at + 1 :], "lost": b"", "late": whole}[kind]

    def step() -> None:
        data, now = terminal.receive(), time.monotonic()
        for whole in device.take(data).splitlines(keepends=True) if data else ():
            ill = opened[0] and chance.random() < 0.1
            waiting.append((now + (0.03 if ill and kind == "late" else 0.0), bad(whole) if ill else whole))
        terminal.send(b"".join(text for when, text in waiting if when <= now))
        waiting[:] = [(when, text) for when, text in waiting if when > now]

    with served(step):
        tec = TecDriver(Mecom(port=terminal.path), patience=3.0)
        opened[0] = True
        for number in range(200):
            current = 0.01 * (number % 100)
            assert tec.exchange(current).plate == pytest.approx(300.0, abs=1e-4)
            assert device.output() == pytest.approx(current)
        opened[0] = False
        tec.close()
    terminal.close()


@pytest.mark.parametrize("code", [2, 3, 4])
def test_one_request_in_ten_that_the_controller_has_not_understood_ends_nothing(code: int) -> None:
    """What is damaged on the way to it is refused with a whole answer: general communication error, format error."""
    terminal, device, chance = Terminal(), VirtualMecom(Plate(plate=300.0, sink=301.5), address=2), random.Random(9)
    opened, refused = [False], [0]

    def step() -> None:
        for request in terminal.receive().splitlines(keepends=True):
            if opened[0] and chance.random() < 0.1:
                refused[0] += 1
                terminal.send(check(b"!" + request[1:7] + b"+%02d" % code))
            else:
                terminal.send(device.take(request))

    with served(step):
        tec = TecDriver(Mecom(port=terminal.path), patience=3.0)
        opened[0] = True
        for number in range(100):
            current = 0.01 * number
            assert tec.exchange(current).plate == pytest.approx(300.0, abs=1e-4)
            assert device.output() == pytest.approx(current)
        opened[0] = False
        tec.close()
    assert refused[0] > 10
    terminal.close()


def test_a_controller_that_understands_nothing_is_told_with_its_reason() -> None:
    terminal = Terminal()

    def step() -> None:
        for line in terminal.receive().splitlines():
            terminal.send(check(b"!" + line[1:7] + b"+04"))

    with served(step):
        client = MecomClient(terminal.path, address=2, patience=8.0)
        with pytest.raises(MecomRefusal, match="format error"):
            client.read_float(1000)
        client.close()
    terminal.close()


def test_a_controller_that_answers_under_another_address_is_told_with_what_to_write() -> None:
    terminal, device = Terminal(), VirtualMecom(Plate(plate=300.0, sink=301.5), address=2)

    def step() -> None:
        data = terminal.receive()
        for whole in device.take(data).splitlines(keepends=True) if data else ():
            terminal.send(check(b"!00" + whole[3:-5]))

    with served(step):
        client = MecomClient(terminal.path, address=2)
        with pytest.raises(MecomError, match='one of address 0 did: if that is yours, write address="0"'):
            client.read_float(1000)
        client.close()
    terminal.close()


@pytest.mark.parametrize("late", [10e-3, 30e-3])
def test_a_controller_whose_answers_are_late(late: float) -> None:
    terminal, device = Terminal(), VirtualMecom(Plate(plate=300.0, sink=301.5), address=2)
    waiting: list[tuple[float, bytes]] = []
    asked = [0]

    def step() -> None:
        data, now = terminal.receive(), time.monotonic()
        for whole in device.take(data).splitlines(keepends=True) if data else ():
            asked[0] += 1
            after = max([now, *(when for when, _ in waiting)])  # one after the other: who is overrun gets ever later
            waiting.append((after + late, whole))
        terminal.send(b"".join(text for when, text in waiting if when <= now))
        waiting[:] = [(when, text) for when, text in waiting if when > now]

    with served(step):
        tec = TecDriver(Mecom(port=terminal.path), patience=3.0)
        before = asked[0]
        for _ in range(40):
            assert tec.exchange(0.5).current == pytest.approx(0.5)
        assert asked[0] - before < 3 * 80  # it is not asked again and again for what it is about to say
        tec.close()
    terminal.close()


@pytest.mark.parametrize("answer", [b"+05", b"+5", b"+99", b"+", b"+xy", b"NaN", b"7FC0000", b"7FC000001", b"zzzzzzzz"])
def test_any_answer_is_a_value_or_a_named_error(answer: bytes) -> None:
    terminal = Terminal()

    def step() -> None:
        for line in terminal.receive().splitlines():
            terminal.send(check(b"!" + line[1:7] + answer))

    with served(step):
        client = MecomClient(terminal.path, address=2, patience=8.0)
        with pytest.raises(MecomRefusal if answer.startswith(b"+") else MecomError):
            client.read_float(1000)
        client.close()
    terminal.close()


def another(answer: bytes, data: bytes) -> bytes:
    """What a controller of the next address answers to a request of the same number."""
    return check(b"!%02X" % (int(answer[1:3], 16) + 1) + answer[3:7] + data)


def test_another_controllers_answer_on_the_same_line_is_not_taken() -> None:
    terminal, device = Terminal(), VirtualMecom(Plate(plate=300.0, sink=301.5), address=2)

    def step() -> None:
        data = terminal.receive()
        for whole in device.take(data).splitlines(keepends=True) if data else ():
            hot = struct.pack(">f", 39.0).hex().upper().encode() * ((len(whole) - 12) // 8)
            terminal.send(another(whole, hot) + whole)

    with served(step):
        client = MecomClient(terminal.path, address=2, patience=8.0)
        assert client.read_float(1000) == pytest.approx(26.85, abs=1e-4)
        client.write_float(50001, 1.0)
        client.close()
    terminal.close()


def test_a_line_that_is_never_quiet_holds_up_nobody() -> None:
    """Answers to others, one every few milliseconds: each would begin the patience anew."""
    terminal, said = Terminal(), [0]

    def step() -> None:
        terminal.receive()
        if said[0] < 10_000:
            said[0] += 1
            terminal.send(check(b"!02FFFF3F800000"))

    with served(step):
        client = MecomClient(terminal.path, address=2)
        with pytest.raises(MecomError, match="did not answer 3 times"):
            client.read_float(1000)
        assert said[0] < 10_000  # it has not waited for the end of it
        client.close()
    terminal.close()


@contextmanager
def modbus(device: VirtualT7, *, piece: int = 0, delay: float = 0.0, unit: int | None = None) -> Iterator[str]:
    """Serve a T7, with answers in pieces, late, or under a unit number of its own."""
    listener = socket.create_server(("127.0.0.1", 0))
    ending = threading.Event()

    def work() -> None:
        listener.settimeout(0.1)
        while not ending.is_set():
            try:
                line, _ = listener.accept()
            except TimeoutError:
                continue
            with line:
                line.settimeout(0.1)
                line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                _talk(line, device, ending, piece, delay, unit)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield f"127.0.0.1:{listener.getsockname()[1]}"
    finally:
        ending.set()
        thread.join()
        listener.close()


def _talk(
    line: socket.socket, device: VirtualT7, ending: threading.Event, piece: int, delay: float, unit: int | None
) -> None:
    heard = b""
    while not ending.is_set():
        try:
            data = line.recv(4096)
        except TimeoutError:
            continue
        except OSError:
            return
        if not data:
            return
        heard += data
        while len(heard) >= 8 and len(heard) >= 6 + struct.unpack(">H", heard[4:6])[0]:
            length = struct.unpack(">H", heard[4:6])[0]
            request, heard = heard[: 6 + length], heard[6 + length :]
            body = device.answer(request[7:])
            if body is None:
                continue
            who = request[6:7] if unit is None else bytes((unit,))
            answer = request[:4] + struct.pack(">H", len(body) + 1) + who + body
            time.sleep(delay)
            for at in range(0, len(answer), piece or len(answer)):
                line.sendall(answer[at : at + (piece or len(answer))])
                time.sleep(0.001 if piece else 0.0)


def sensors(host: str) -> LabJack:
    return LabJack(host=host, flux_sensor=SENSOR, infrared=Infrared())


@pytest.mark.parametrize(
    ("piece", "delay", "busy"), [(0, 0.0, 0), (1, 0.0, 0), (3, 0.02, 2), (0, 0.15, 0), (0, 0.0, 2)]
)
def test_a_t7_may_split_and_delay_its_answers(piece: int, delay: float, busy: int) -> None:
    device = VirtualT7(volts={0: SENSOR.voltage(1234.0, 300.0), 2: 1.65})
    with modbus(device, piece=piece, delay=delay) as host:
        driver = LabJackDriver(sensors(host), patience=8.0)
        for _ in range(3):
            device.injected.busy = busy
            read = driver.exchange(300.0)
            assert read.flux == pytest.approx(1234.0, rel=1e-3)  # high word first: otherwise it would be nonsense
            assert read.skin == pytest.approx(273.15 + 33.0, abs=1e-3)
        device.injected.busy = 9
        with pytest.raises(DeviceError, match="refuses register"):
            driver.exchange(300.0)
        driver.close()


def test_answers_of_another_number_without_an_end_hold_up_nobody() -> None:
    """A T7 whose line brings answers that nobody asked for: the loop gets an error, and not silence."""
    listener, ending, sent = socket.create_server(("127.0.0.1", 0)), threading.Event(), [0]

    def work() -> None:
        line.settimeout(0.5)
        with line:
            head = line.recv(12)
            while not ending.is_set() and sent[0] < 20_000:
                sent[0] += 1
                with contextlib.suppress(OSError):
                    line.sendall(bytes((head[0], head[1] ^ 1)) + struct.pack(">HHBBBI", 0, 7, 1, 3, 4, 0))
                time.sleep(1e-3)

    wire = ModbusLine("T7", f"127.0.0.1:{listener.getsockname()[1]}")
    line, _ = listener.accept()
    listener.close()  # who connects anew finds nobody
    thread = threading.Thread(target=work)
    thread.start()
    wire.ask(0)
    with pytest.raises(DeviceError, match="does not answer"):
        wire.answer()
    assert sent[0] < 20_000
    ending.set()
    wire.close()
    thread.join()


def test_a_t7_that_answers_too_late_is_told_in_time_and_is_there_again() -> None:
    device = VirtualT7(volts={0: SENSOR.voltage(-500.0, 300.0), 2: 1.65})
    with modbus(device) as host:
        driver = LabJackDriver(sensors(host))
        device.injected.lost = 8
        begin = time.monotonic()
        with pytest.raises(DeviceError, match="does not answer"):
            driver.exchange(300.0)
        assert time.monotonic() - begin < 60.0  # it ends
        device.injected.lost = 0
        assert driver.exchange(300.0).flux == pytest.approx(-500.0, rel=1e-3)
        driver.close()


@pytest.mark.parametrize("lost", [False, True])
def test_a_t7_that_has_started_anew_is_not_believed(lost: bool) -> None:
    """Its input is against ground then, and of another range: nobody could tell by the voltage alone."""
    device = VirtualT7(volts={0: SENSOR.voltage(800.0, 300.0), 2: 1.65})
    with modbus(device) as host:
        driver = LabJackDriver(sensors(host), patience=8.0)
        for _ in range(60):
            assert driver.exchange(300.0).flux == pytest.approx(800.0, rel=1e-3)
        device.restart()
        if lost:  # the line, too: then it is asked at once
            driver._line._client.close()
        with pytest.raises(DeviceError, match=r"has restarted, or another program has set it: its input AIN0"):
            for _ in range(1 if lost else 60):
                driver.exchange(300.0)
        driver.close()
