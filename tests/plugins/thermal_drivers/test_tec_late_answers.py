"""A TEC controller's answer that may be to an earlier sending of its request is no newer than that."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from typing import Any

import pytest

from itouch.plugin import Timestamps
from itouch_thermal.drivers import mecom, tec
from itouch_thermal.drivers.driver_params import Mecom
from itouch_thermal.drivers.mecom import crc16

PLATE, SINK, CURRENT = tec.OBJECT_TEMPERATURE, tec.SINK_TEMPERATURE, tec.ACTUAL_CURRENT
#: How long [s] a byte takes on the line.
BYTE = 10.0 / 57600
#: Degrees a second by which plate and sink change: their temperatures tell when they were measured.
SLOPE, ROOM = 0.01, 20.0


class Line:
    """A line to a controller, on a clock of its own; each answer is on its way for as long as ``late`` says."""

    def __init__(self, bulk: bool) -> None:
        self.now, self.port, self._bulk = 100.0, "line", bulk
        self.late: Callable[[], float] = lambda: 0.0
        self._coming: list[tuple[float, bytes]] = []
        self._values: dict[int, bytes] = {tec.STATUS: struct.pack(">i", 2), tec.VOLTAGE_LIMIT: struct.pack(">f", 12.0)}

    def clock(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def close(self) -> None: ...

    def clear(self) -> None:
        self._coming = [one for one in self._coming if one[0] > self.now]

    def send(self, request: bytes) -> None:
        self.now += len(request) * BYTE
        head, payload = request[:7], request[7:-5].decode()
        answer = self._answered(payload)
        body = b"!" + head[1:] + answer
        check = crc16(body) if answer else crc16(request[:-5])
        message = body + b"%04X" % check
        arrives = self.now + (len(message) + 1) * BYTE + self.late()
        arrives = max([arrives, *(when for when, _ in self._coming)])  # in order
        self._coming.append((arrives, message))

    def receive(self, wait: float) -> bytes | None:
        if self._coming and self._coming[0][0] <= self.now + wait:
            arrives, message = self._coming.pop(0)
            self.now = max(self.now, arrives)
            return message
        self.now += wait
        return None

    def _answered(self, payload: str) -> bytes:
        if payload.startswith("?VX"):
            if not self._bulk:
                return b"+01"
            wanted = [int(payload[5 + 6 * i : 9 + 6 * i], 16) for i in range(int(payload[3:5], 16))]
            return b"".join(self._value(one).hex().upper().encode() for one in wanted)
        if payload.startswith("?VR"):
            return self._value(int(payload[3:7], 16)).hex().upper().encode()
        if payload.startswith("VS"):
            self._values[int(payload[2:6], 16)] = bytes.fromhex(payload[8:])
            return b""
        return b"8065-TEC"

    def _value(self, parameter: int) -> bytes:
        if parameter in (PLATE, SINK):
            return struct.pack(">f", ROOM + SLOPE * (self.now - 100.0))
        return self._values.get(parameter, bytes(4))


class Told(Timestamps):
    """Remembers how old [s] a driver says that each channel is."""

    def __init__(self) -> None:
        super().__init__(["plate_temperature", "sink_temperature"])
        self.said: dict[str, float] = {}

    def measured(self, *channels: str, ago: float = 0.0, inside: float = 0.0) -> None:
        self.said.update(dict.fromkeys(channels, ago + inside))


def ages(monkeypatch: pytest.MonkeyPatch, late: Callable[[], float], bulk: bool = True) -> list[tuple[float, float]]:
    """Return of each reading of plate and sink how old it was said to be, and how old it was at most [s]."""
    line = Line(bulk)
    made: Any = lambda *words, **more: line  # noqa: E731
    monkeypatch.setattr(mecom, "SerialLine", made)
    for module in (mecom, tec):
        monkeypatch.setattr(module, "monotonic", line.clock)
    monkeypatch.setattr(mecom, "sleep", line.sleep)
    driver, stamps, found = tec.TecDriver(Mecom(port="line")), Told(), []
    line.late = late
    for _ in range(200):
        reading = driver.exchange(0.0, stamps)
        for name, value in (("plate_temperature", reading.plate), ("sink_temperature", reading.sink)):
            measured = 100.0 + (value - tec.KELVIN - ROOM) / SLOPE
            found.append((stamps.said[name], line.now - measured))
        line.sleep(0.005)
    return found


#: A temperature in single precision is so many seconds off at most.
EXACT = 2e-6 / SLOPE


@pytest.mark.parametrize("bulk", [True, False], ids=["in one request", "one by one"])
def test_no_reading_is_said_to_be_newer_than_it_is(monkeypatch: pytest.MonkeyPatch, bulk: bool) -> None:
    """Also one of the sink, which is not read in every exchange."""
    chance = random.Random(5)
    for said, age in ages(monkeypatch, lambda: 0.045 if chance.random() < 0.2 else 0.0, bulk):
        assert said >= age - EXACT


@pytest.mark.parametrize("bulk", [True, False], ids=["in one request", "one by one"])
def test_where_all_are_in_time_the_age_is_exact(monkeypatch: pytest.MonkeyPatch, bulk: bool) -> None:
    for said, age in ages(monkeypatch, lambda: 0.0, bulk):
        assert said == pytest.approx(age, abs=EXACT)
