"""A LabJack one of whose answers in ten is bad: no session ends, and a reading is never as old as a session may not bear."""

from __future__ import annotations

import contextlib
import random
import socket
import struct
import threading
import time
from collections.abc import Iterator

import pytest

from itouch.plugin import DeviceError
from itouch_thermal.drivers import FluxSensor, Infrared, LabJack
from itouch_thermal.drivers.labjack import LabJackDriver
from itouch_thermal.drivers.modbus import ModbusLine
from itouch_thermal.drivers.virtual import VirtualT7

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

VOLTS = 1e-4


class BadT7:
    """A T7 whose answers are bad now and then, once it is open."""

    def __init__(self, kind: str) -> None:
        self.kind, self.bad, self.count = kind, False, 0
        self._chance, self._t7 = random.Random(5), VirtualT7()
        self._t7.volts[0], self._t7.volts[2] = VOLTS, 1.6
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.host = f"127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self) -> None:
        self._listener.close()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                line, _ = self._listener.accept()
                line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._talk, args=(line,), daemon=True).start()

    def _talk(self, line: socket.socket) -> None:
        waiting = b""
        with contextlib.suppress(OSError), line:
            while data := line.recv(4096):
                waiting += data
                while len(waiting) >= 8 and len(waiting) >= 6 + int.from_bytes(waiting[4:6], "big"):
                    end = 6 + int.from_bytes(waiting[4:6], "big")
                    request, waiting = waiting[:end], waiting[end:]
                    for piece in self._said(request):
                        line.sendall(piece)

    def _said(self, request: bytes) -> Iterator[bytes]:
        """Yield the pieces of an answer; a hang-up is an error."""
        answer = self._t7.answer(request[7:])
        assert answer is not None
        number = int.from_bytes(request[:2], "big")
        whole = struct.pack(">HHH", number, 0, len(answer) + 1) + request[6:7] + answer
        ill = self.bad and self._chance.random() < 0.1
        self.count += ill
        if self.kind == "late":
            time.sleep(0.03)
        if self.kind == "byte by byte":
            yield from (whole[at : at + 1] for at in range(len(whole)))
        elif not ill or self.kind == "late":
            yield whole
        elif self.kind == "refuses":
            yield struct.pack(">HHHBBB", number, 0, 3, request[6], request[7] | 0x80, 4)
        elif self.kind == "cut":
            yield whole[:-1]
        elif self.kind == "another number":
            yield struct.pack(">H", number + 7 & 0xFFFF) + whole[2:]
        elif self.kind == "an old one first":
            yield struct.pack(">H", number - 1 & 0xFFFF) + whole[2:-4] + b"\x40\x00\x00\x00" + whole
        elif self.kind == "another protocol":
            yield whole[:2] + b"\0\5" + whole[4:]
        elif self.kind == "another function":
            yield whole[:7] + bytes((whole[7] ^ 1,)) + whole[8:]
        elif self.kind == "hangs up":
            raise OSError


KINDS = ["late", "byte by byte", "cut", "lost", "another number", "an old one first", "another protocol",
         "another function", "hangs up"]  # fmt: skip


def sensors(host: str) -> LabJack:
    infrared = Infrared(channel=2, slope=20.0, zero=273.15)
    return LabJack(host=host, flux_sensor=FluxSensor(sensitivity=1.2e-6), infrared=infrared)


@pytest.mark.parametrize("kind", KINDS)
def test_one_bad_answer_in_ten_ends_nothing(kind: str) -> None:
    t7 = BadT7(kind)
    driver = LabJackDriver(sensors(t7.host), patience=4.0)
    first = driver.exchange(296.15)
    t7.bad = True
    for _ in range(100):
        assert driver.exchange(296.15) == first
    assert t7.count > 5
    driver.close()
    t7.close()


def test_three_answers_lost_in_a_row_are_asked_for_again_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """A reading may be 100 ms old: the full patience of 200 ms is for one that has never answered."""
    t7 = BadT7("lost")
    driver = LabJackDriver(sensors(t7.host))
    settings, waits = driver._line._client.comm_params, list[float]()
    driver.exchange(296.15)

    def silent(address: int, count: int) -> None:
        waits.append(settings.timeout_connect)
        raise OSError("silence")

    monkeypatch.setattr(driver._line._client, "read_holding_registers", silent)
    with pytest.raises(DeviceError, match="does not answer"):
        driver.exchange(296.15)
    assert sum(waits[:3]) < 0.1
    assert waits[3] == 0.2
    driver.close()
    t7.close()


def test_who_hangs_up_between_two_exchanges_is_connected_to_anew() -> None:
    """A device that ends idle connections with a reset: the next request, of a mean, finds no line."""
    value, ended = struct.pack(">f", 2.5), threading.Event()

    def work() -> None:
        for number in range(2):
            line, _ = listener.accept()
            with line:
                head = line.recv(12)[:7]
                line.sendall(head[:4] + b"\0\7" + head[6:] + b"\3\4" + value)
                if number:
                    line.recv(1)
                else:
                    line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            ended.set()

    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(300.0)
        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        wire = ModbusLine("T7", f"127.0.0.1:{listener.getsockname()[1]}", patience=8.0)
        assert wire.floats(0) == [2.5]
        assert ended.wait(300.0)
        wire.ask(7000)
        assert wire.answer() == (2.5, True)
        wire.close()
        thread.join()


def test_a_refusal_names_its_register_and_its_exception() -> None:
    t7 = BadT7("refuses")
    driver = LabJackDriver(sensors(t7.host), patience=4.0)
    t7.bad = True
    with pytest.raises(DeviceError, match=r"refuses register 0: exception 4$"):
        for _ in range(100):
            driver.exchange(296.15)
    driver.close()
    t7.close()
