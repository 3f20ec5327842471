"""Late answers of a rig of one's own, or of a LabJack: no reading is said to be newer than it can be known to be.

Each reading tells when it was measured, on a clock that only the wires move.
"""

from __future__ import annotations

import random
import struct
import time
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pymodbus.client
import pytest
from pymodbus.exceptions import ModbusIOException
from test_line_protocol_variants import OwnRig
from test_line_protocol_variants import on_a_line as on_a_terminal

from itouch.exchange.thread import ThreadedDevice
from itouch.plugin import Field, Record, Timestamps, timestamps
from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.drivers import FluxSensor, Infrared, LabJack, LinePort, labjack, lineport, modbus
from itouch_thermal.drivers.lineport import KELVIN, seal, seal_2, unseal, unseal_2
from itouch_thermal.drivers.rig import Rig
from itouch_thermal.drivers.virtual import VirtualT7
from itouch_thermal.film import touch_film
from itouch_thermal.film.film_params import T7, FilmParams, ForceSensor, Thermometer
from itouch_thermal.film.touch_film import TouchFilm

#: How much longer [s] than usual an answer may take until it counts as late.
PROMPT = 5e-3
#: When the clock begins [s].  So many seconds later a temperature is as many kelvin above this one, a flux
#: hundred times as many W/m2.
BEGIN, ROOM = 100.0, 290.0
#: A reading tells its time to so many seconds.
EXACT = 2e-5
#: How long a byte takes on a line, and how long a request is on its way to a T7 [s].
BAUD, WAY = 115200, 5e-4
BYTE = 10.0 / BAUD
#: What a usual exchange takes at most: a command of 20 bytes and an answer of 70, or a T7's two ways.
USUAL = 90 * BYTE
CHANNELS = ["plate_temperature", "sink_temperature", "heat_flux", "skin_temperature", "skin_valid"]
#: How long a request is held up before the device measures, and its answer after that [s].
Late = Callable[[], tuple[float, float]]


def in_time() -> tuple[float, float]:
    return 0.0, 0.0


class Clock:
    """A clock that only waiting moves, and what is late on it."""

    def __init__(self) -> None:
        self.now = BEGIN
        self.late: Late = in_time
        #: Whether a T7 averages an input by itself.
        self.averages = True

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Drivers and stamps by such a clock, and a T7 by it."""
    found = Clock()
    for module in (lineport, labjack, modbus, timestamps, touch_film):
        monkeypatch.setattr(module, "time", found, raising=False)

    def client(host: str, **settings: Any) -> Client:
        return Client(found, settings["timeout"])

    monkeypatch.setattr(pymodbus.client, "ModbusTcpClient", client)
    return found


class Named(NamedTuple):
    """What a display names."""

    line: LinePort
    labjack: LabJack | None = None
    mecom: None = None


class Line:
    """A line to a rig of either version; all arrives in order, but for answers that are lost."""

    def __init__(self, clock: Clock, version: int, takes: float = 0.0) -> None:
        self.port, self._clock, self._version, self._takes = "line", clock, version, takes
        self.lose: Callable[[], bool] = lambda: False
        self._heard = self._arrived = 0.0
        self._coming: deque[tuple[float, bytes]] = deque()

    def close(self) -> None: ...

    def clear(self) -> None:
        while self._coming and self._coming[0][0] <= self._clock.now:
            self._coming.popleft()

    def send(self, request: bytes) -> None:
        body = unseal(request) or unseal_2(request)
        assert body is not None
        before, after = self._clock.late()
        self._heard = max(self._heard, self._clock.now + len(request) * BYTE + before) + self._takes
        answer = (seal_2 if self._version == 2 else seal)(self._said(body, self._heard - BEGIN - self._takes))
        self._arrived = max(self._arrived, self._heard + len(answer) * BYTE + after)
        if not self.lose():
            self._coming.append((self._arrived, answer[:-1]))

    def receive(self, wait: float) -> bytes | None:
        limit = self._clock.now + wait
        if not self._coming or self._coming[0][0] > limit:
            self._clock.now = max(self._clock.now, limit)
            return None
        arrives, answer = self._coming.popleft()
        self._clock.now = max(self._clock.now, arrives)
        return answer

    def _said(self, body: str, passed: float) -> str:
        if body == "?":
            more = " amps=3 plate=10:43 sink=58 silence=0.2 reset=power cut=none" if self._version == 2 else ""
            return f"N itouch-line {self._version} bench{more}"
        warm = ROOM - KELVIN + passed
        number = f"{body.split()[1]} " if self._version == 2 else ""
        state = " ok" if self._version == 2 else ""
        return f"R {number}{warm:.6f} {warm:.6f} {1e2 * passed:.4f} {warm:.6f} 0.00000{state}"


class Client:
    """A connection to a T7: its inputs' voltages tell the time."""

    def __init__(self, clock: Clock, timeout: float) -> None:
        self._clock, self._t7, self.connected = clock, VirtualT7(averages=clock.averages), False
        self.comm_params = SimpleNamespace(timeout_connect=timeout)
        self._coming, self._arrives, self._free = b"", 0.0, 0.0

    def connect(self) -> bool:
        self.connected = True
        return True

    def close(self) -> None:
        self.connected, self._coming = False, b""

    def read_holding_registers(self, address: int, count: int) -> Any:
        answer = self._asked(struct.pack(">BHH", 3, address, count))
        return self._read(answer, list(struct.unpack(f">{count}H", answer[2:])) if len(answer) > 2 else [])

    def write_registers(self, address: int, words: list[int]) -> Any:
        request = struct.pack(f">BHHB{len(words)}H", 16, address, len(words), 2 * len(words), *words)
        return self._read(self._asked(request), [])

    @staticmethod
    def _read(answer: bytes, words: list[int]) -> Any:
        refused = bool(answer[0] & 0x80)
        return SimpleNamespace(
            isError=lambda: refused, exception_code=answer[1], function_code=answer[0], registers=words
        )

    def send(self, request: bytes) -> None:
        answer, self._arrives = self._answered(request[7:])
        self._coming = request[:4] + struct.pack(">H", len(answer) + 1) + request[6:7] + answer

    def recv(self, size: int) -> bytes:
        limit = self._clock.now + self.comm_params.timeout_connect
        if self._arrives > limit:
            self._clock.now = limit
            return b""
        self._clock.now = max(self._clock.now, self._arrives)
        found, self._coming = self._coming[:size], self._coming[size:]
        return found

    def _asked(self, request: bytes) -> bytes:
        limit = self._clock.now + self.comm_params.timeout_connect
        answer, arrives = self._answered(request)
        self._clock.now = min(arrives, limit)
        if arrives > limit:
            raise ModbusIOException("silence")
        return answer

    def _answered(self, request: bytes) -> tuple[bytes, float]:
        """Return the answer to a request sent now, and when it arrives."""
        before, after = self._clock.late()
        takes = self._t7.takes(request)
        begin = max(self._free, self._clock.now + WAY + before)
        self._free = begin + takes
        for number in range(1, 1 + round(takes * 1e3) if takes else 2):
            passed = begin + (1e-3 * number if takes else 0.0) - BEGIN
            self._t7.volts.update({0: 1e-4 * passed, 2: passed, 3: passed, 4: passed})
            self._t7.see(passed)
        answer = self._t7.answer(request)
        assert answer is not None
        return answer, begin + takes + WAY + after


def on_a_line(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, version: int, age: float, takes: float = 0.0, lost: float = 0.0
) -> LinePort:
    line, chance = Line(clock, version, takes), random.Random(6)
    line.lose = lambda: chance.random() < lost
    monkeypatch.setattr(lineport, "SerialLine", lambda *words, **more: line)
    return LinePort(port="line", baud=BAUD, age=age)


def sensors(averaging: float = 0.0, *, flux: bool = True) -> LabJack:
    film = FluxSensor(sensitivity=1e-6) if flux else None
    return LabJack(host="t7", averaging=averaging, flux_sensor=film, infrared=Infrared(slope=1.0, zero=ROOM))


def newer(clock: Clock, rig: Rig, late: Late, exchanges: int = 300, **ages: float) -> dict[str, list[float]]:
    """Return, by channel, by how much newer than it is each reading is said to be [s].

    ``ages`` [s] are how old the readings of some channels were when they were sent.
    """
    told, found = Timestamps(CHANNELS), dict[str, list[float]]()
    clock.late = late
    for _ in range(exchanges):
        told.begin()
        read = rig.exchange(0.0, told)
        moments = dict(zip(CHANNELS, told.measurement_times(), strict=True))
        passed = {
            "plate_temperature": read.plate - ROOM, "sink_temperature": read.sink - ROOM,
            "heat_flux": read.flux / 1e2, "skin_temperature": read.skin - ROOM,
        }  # fmt: skip
        for name, seconds in passed.items():
            found.setdefault(name, []).append(moments[name] + ages.get(name, 0.0) - BEGIN - seconds)
        clock.sleep(5e-3)
    return found


def held_up(seed: int, share: float = 0.2, longest: float = 0.06) -> Late:
    """Hold up some requests, and some answers, for any time."""
    chance = random.Random(seed)
    return lambda: (
        chance.uniform(0.0, longest) if chance.random() < share else 0.0,
        chance.uniform(0.0, longest) if chance.random() < share else 0.0,
    )


LATE: dict[str, Late] = {
    "answers 40 ms late": lambda: (0.0, 0.04),
    "answers 20 ms late": lambda: (0.0, 0.02),
    "now and then": held_up(3),
    "now and then for long": held_up(4, 0.05, 0.09),
}


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("age", [0.0, 10e-3], ids=["without an age", "with an age"])
@pytest.mark.parametrize("late", LATE)
def test_no_reading_of_a_rig_is_said_to_be_newer_than_it_is(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, version: int, age: float, late: str
) -> None:
    """By more than a usual exchange takes, and 5 ms; in version 1 no answer is taken for that to a later command."""
    rig = Rig(Named(line=on_a_line(clock, monkeypatch, version, age)))
    newer(clock, rig, in_time, 12)
    for said in newer(clock, rig, LATE[late], **dict.fromkeys(CHANNELS, age)).values():
        assert max(said) < USUAL + PROMPT


@pytest.mark.parametrize("after", [5e-3 * number for number in range(21)])
def test_a_late_answer_of_version_1_is_none_to_the_next_command(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, after: float
) -> None:
    """The first answer comes when the command has just been repeated, the second one any time later."""
    rig = Rig(Named(line=on_a_line(clock, monkeypatch, 1, 0.0)))
    newer(clock, rig, in_time, 12)
    coming = iter([(0.0, 0.065), (0.0, after)])
    for said in newer(clock, rig, lambda: next(coming, (0.0, 0.0)), 12).values():
        assert max(said) < USUAL + PROMPT


@pytest.mark.parametrize("version", [1, 2])
def test_no_reading_of_a_rig_is_said_to_be_newer_where_answers_are_lost(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, version: int
) -> None:
    """Those to greetings are, too."""
    rig = Rig(Named(line=on_a_line(clock, monkeypatch, version, 0.0, lost=0.05)))
    for said in newer(clock, rig, held_up(5, 0.1, 0.03)).values():
        assert max(said) < USUAL + PROMPT


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("takes", [0.0, 2e-3, 15e-3])
def test_a_prompt_answer_of_a_rig_keeps_its_time(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, version: int, takes: float
) -> None:
    """It counts from the middle of its exchange, however long this rig's exchanges always take."""
    rig = Rig(Named(line=on_a_line(clock, monkeypatch, version, 0.0, takes)))
    newer(clock, rig, in_time, 12)
    for said in newer(clock, rig, in_time, 30).values():
        assert max(abs(one) for one in said) < 0.5 * (USUAL + takes)


@pytest.mark.parametrize("averaging", [0.0, 20e-3], ids=["of the skin", "of the flux, with a mean"])
def test_a_rigs_readings_have_their_own_time_beside_a_labjack(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, averaging: float
) -> None:
    """They are neither of the LabJack's sample nor of the time in which that averages."""
    line = on_a_line(clock, monkeypatch, 2, 0.0)
    rig = Rig(Named(line=line, labjack=sensors(averaging, flux=averaging > 0.0)))
    found = newer(clock, rig, in_time, 30)
    for name in CHANNELS[:2] if averaging else CHANNELS[:3]:
        assert max(abs(one) for one in found[name]) < 0.5 * USUAL


def test_the_age_of_a_rigs_flux_counts_beside_a_labjack_that_sees_only_the_skin(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = on_a_line(clock, monkeypatch, 2, 10e-3)
    rig = Rig(Named(line=line, labjack=sensors(flux=False)))
    found = newer(clock, rig, in_time, 30, heat_flux=10e-3)
    assert max(abs(one) for one in found["heat_flux"]) < USUAL


def test_the_skin_that_only_the_rig_sees_has_the_time_of_the_rig(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thermometer at the LabJack sees no finger, and is asked after the rig has answered."""
    blind = LabJack(host="t7", infrared=Infrared(slope=1.0, zero=ROOM - 200.0))
    rig = Rig(Named(line=on_a_line(clock, monkeypatch, 2, 0.0), labjack=blind))
    newer(clock, rig, in_time, 12)
    assert max(newer(clock, rig, LATE["now and then"])["skin_temperature"]) < USUAL + PROMPT


@pytest.mark.parametrize("averaging", [0.0, 20e-3], ids=["single samples", "means"])
@pytest.mark.parametrize("can", [True, False], ids=["of its own", "of samples asked for"])
@pytest.mark.parametrize("late", ["never", *LATE])
def test_no_sample_of_a_labjack_is_said_to_be_newer_than_it_is(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, averaging: float, can: bool, late: str
) -> None:
    clock.averages = can
    rig = Rig(Named(line=on_a_line(clock, monkeypatch, 2, 0.0), labjack=sensors(averaging)))
    newer(clock, rig, in_time, 12)
    found = newer(clock, rig, LATE.get(late, in_time), 150)
    for name in ("heat_flux", "skin_temperature"):
        assert max(found[name]) < 2.0 * WAY + (PROMPT if late in LATE else EXACT)
        assert late in LATE or min(found[name]) > -2.0 * WAY


@pytest.mark.parametrize("late", ["never", *LATE])
def test_no_reading_of_a_film_is_said_to_be_newer_than_it_is(clock: Clock, late: str) -> None:
    """Each of its readings is of its own request."""
    t7 = T7(
        host="t7", flux_sensor=FluxSensor(sensitivity=1e-6), infrared=Infrared(slope=1.0, zero=ROOM),
        force_sensor=ForceSensor(slope=1.0), thermometer=Thermometer(slope=1.0, zero=ROOM),
    )  # fmt: skip
    film = TouchFilm(FilmParams(labjack=t7))
    reads, _ = TouchFilm.channels(film.params)
    reading, told = Record.of(Field.of(channel) for channel in reads), Timestamps([channel.name for channel in reads])
    film.timestamps = told
    film.open()
    for number in range(150):
        clock.late = LATE[late] if late in LATE and number > 12 else in_time
        told.begin()
        film.read(reading)
        moments = dict(zip((channel.name for channel in reads), told.measurement_times(), strict=True))
        passed = {
            "heat_flux": reading["heat_flux"].item() / 1e2, "wrench": -reading["wrench"][2],
            "film_temperature": reading["film_temperature"].item() - ROOM,
            "skin_temperature": reading["skin_temperature"].item() - ROOM,
        }  # fmt: skip
        for name, seconds in passed.items():
            assert moments[name] - BEGIN - seconds < 2.0 * WAY + (PROMPT if late in LATE else EXACT)
        clock.sleep(5e-3)


@pytest.mark.punctual
@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("age", [0.0, 10e-3], ids=["without an age", "with an age"])
def test_the_loop_is_told_an_age_of_a_late_reading_that_is_not_too_small(version: int, age: float) -> None:
    """In real time, through the thread that exchanges with the display: what the monitors of ages see."""
    begin, rig = time.monotonic(), OwnRig(version)

    def answer(number: str, amps: float) -> str:
        rig.late = 0.04 if rig.orders % 4 == 0 else 0.0
        values = f"{ROOM - KELVIN + time.monotonic() - begin - age:.6f} 25.1 120.0 nan {amps:.5f}"
        return f"R {number} {values} ok" if version == 2 else f"R {values}"

    rig.answers = answer
    with on_a_terminal(rig) as terminal:
        display = ThermalDisplay(DisplayParams(line=LinePort(port=terminal.path, baud=250_000, age=age)))
        display.timeout_factor = 3.0
        reads, _ = ThermalDisplay.channels(display.params)
        reading, ticks = Record.of(Field.of(channel) for channel in reads), np.zeros(len(reads), np.int64)
        plate = [channel.name for channel in reads].index("plate_temperature")
        threaded, late = ThreadedDevice(display, patience=10.0), 0
        threaded.open()
        while late < 8:
            if not threaded.read(reading):
                time.sleep(1e-4)
                continue
            tick = round((time.monotonic() - begin) * 1e3)
            threaded.measured(reading, tick, ticks)
            true = 1e3 * (reading["plate_temperature"].item() - ROOM)
            late += tick - true > 1e3 * age + 40.0
            assert ticks[plate] - true < 1e3 * (USUAL + PROMPT) + 1.0
        threaded.close()
