"""A rig of one's own behind a bad wire, at random: lines are lost, damaged, cut, doubled, held up, or come in pieces.

Each reading tells when it was measured, on a clock that only waiting moves; each command has a current of its own.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
import serialx

from itouch.plugin import DeviceError, Timestamps, timestamps
from itouch_thermal.drivers import LinePort, lineport, serialport
from itouch_thermal.drivers.lineport import KELVIN, LineDriver, seal, seal_2, unseal, unseal_2

#: How much longer [s] than usual an answer may take until it counts as late; when the clock begins [s].
PROMPT, BEGIN = 5e-3, 100.0
#: So many seconds later a temperature is as many kelvin above this one.
ROOM = 290.0
BAUD = 115200
BYTE = 10.0 / BAUD
#: What a usual exchange takes at most on the wire, and how long the port waits for a byte [s].
USUAL, POLL = 90 * BYTE, 0.01
CASES = 150


class Clock:
    """A clock that only waiting moves; who asks it without end hangs."""

    def __init__(self) -> None:
        self.now, self._asked = BEGIN, 0

    def monotonic(self) -> float:
        self._asked += 1
        assert self._asked < 10**6, "the driver hangs"
        return self.now


@dataclass
class Faults:
    """How often which fault occurs; what is held up is so for any time up to the longest [s]."""

    lost: float = 0.0
    unheard: float = 0.0
    damaged: float = 0.0
    misheard: float = 0.0
    cut: float = 0.0
    doubled: float = 0.0
    talk: float = 0.0
    held_up: tuple[float, float] = (0.0, 0.0)
    kept: tuple[float, float] = (0.0, 0.0)
    #: How long it takes to answer [s], by the time that has passed; whether it measures first; when it is off [s].
    takes: Callable[[float], float] = field(default=lambda passed: 0.0)
    first: bool = True
    off: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def any(cls, chance: random.Random) -> Faults:
        names = ("lost", "unheard", "damaged", "misheard", "cut", "doubled", "talk")
        found = cls(**{name: chance.choice([0.02, 0.1, 0.3]) for name in names if chance.random() < 0.3})
        times = [(share, chance.choice([0.01, 0.06, 0.1, 0.3])) for share in (0.03, 0.2)]
        found.held_up, found.kept = (chance.choice([*times, (0.0, 0.0)]) for _ in range(2))
        slow = chance.choice([0.0, 2e-3, 30e-3])
        drifts = chance.random() < 0.2
        found.takes = lambda passed: 2e-3 + 23e-3 * min(1.0, passed) if drifts else slow
        found.first = chance.random() < 0.5
        if chance.random() < 0.2:
            begin = chance.uniform(0.1, 0.5)
            found.off = (begin, begin + chance.choice([0.01, 0.1, 1.0]))
        return found


class Wire:
    """A serial port with a rig at its other end; what is sent arrives in order, byte by byte."""

    def __init__(self, clock: Clock, chance: random.Random, version: int, faults: Faults) -> None:
        self._clock, self._chance, self._faults, self._version = clock, chance, faults, version
        self._coming, self._half = deque[tuple[float, int]](), b""
        self._heard = self._free = self._arrived = 0.0
        self._greeted, self.deaf = False, False
        #: When commands were sent [s]; the currents that have reached the rig.
        self.sent, self.currents = list[float](), [math.nan]

    def open(self) -> None: ...

    def close(self) -> None: ...

    def fileno(self) -> int:
        return 0

    def reset_read_buffer(self) -> None:
        while self._coming and self._coming[0][0] <= self._clock.now:
            self._coming.popleft()

    def read(self, size: int) -> bytes:
        arrives = self._coming[0][0] if self._coming else math.inf
        self._clock.now = max(self._clock.now, min(arrives, self._clock.now + POLL))
        found = bytearray()
        while self._coming and self._coming[0][0] <= self._clock.now:
            found.append(self._coming.popleft()[1])
        return bytes(found)

    def write(self, line: bytes) -> None:
        if line.startswith(b"I"):
            self.sent.append(self._clock.now)
        if self._is(self._faults.unheard):
            return
        self._heard = max(self._heard, self._clock.now + self._late(self._faults.held_up)) + len(line) * BYTE
        heard = self._half + self._worn(line, self._faults.misheard)
        *lines, self._half = heard.split(b"\n")
        for one in lines:
            self._hear(one)

    def _is(self, share: float) -> bool:
        return self._chance.random() < share

    def _late(self, times: tuple[float, float]) -> float:
        return self._chance.uniform(0.0, times[1]) if self._is(times[0]) else 0.0

    def _worn(self, line: bytes, damaged: float) -> bytes:
        at = self._chance.randrange(len(line))
        if self._is(damaged):
            line = line[:at] + bytes([line[at] ^ 1 << self._chance.randrange(7)]) + line[at + 1 :]
        return line[:at] + line[at + 1 :] if self._is(self._faults.cut) else line

    def _hear(self, line: bytes) -> None:
        begin = max(self._heard, self._free)
        body = unseal(line) if self._version == 1 else "?" if unseal(line) == "?" else unseal_2(line)
        if self._faults.off[0] <= begin - BEGIN < self._faults.off[1]:
            self._greeted = False
            return
        if body is None or (body == "?" and self.deaf):
            return
        self._free = begin + self._faults.takes(begin - BEGIN)
        answer = (seal_2 if self._version == 2 else seal)(self._said(body, begin))
        if self._is(self._faults.lost):
            return
        answer = self._worn(answer, self._faults.damaged)
        talk = self._chance.choice([b"hello\n", b"\0\0", b"R words\n", b"N x*00\n", b"\xff\n"])
        answer = (talk if self._is(self._faults.talk) else b"") + answer
        times = 2 if self._version == 2 and self._is(self._faults.doubled) else 1
        begin = max(self._arrived, self._free + self._late(self._faults.kept))
        self._coming.extend((begin + (1 + at) * BYTE, byte) for at, byte in enumerate(times * answer))
        self._arrived = begin + times * len(answer) * BYTE

    def _said(self, body: str, begin: float) -> str:
        if body == "?":
            self._greeted = True
            more = " amps=3 plate=10:43 sink=58 silence=0.2 reset=power cut=none" if self._version == 2 else ""
            return f"N itouch-line {self._version} bench{more}"
        *number, amps = body.split()[1:]
        if self._version == 2 and not self._greeted:
            return "E greet it first"
        self.currents.append(float(amps))
        warm = ROOM - KELVIN + (begin if self._faults.first else self._free) - BEGIN
        return " ".join(["R", *number, f"{warm:.6f} {warm:.6f} 0.0 nan {float(amps):.5f}", *["ok"] * len(number)])


def wired(monkeypatch: pytest.MonkeyPatch, seed: int, version: int, faults: Faults) -> tuple[Clock, Wire]:
    clock = Clock()
    wire = Wire(clock, random.Random(seed), version, faults)
    for module in (lineport, serialport, timestamps):
        monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(serialport, "share", lambda *words: None)
    monkeypatch.setattr(serialx, "serial_for_url", lambda *words, **more: wire)
    return clock, wire


def broken(clock: Clock, wire: Wire, chance: random.Random, slowest: float) -> str:
    """Drive a rig until it fails, and close it; return which law has been broken, or nothing."""
    try:
        rig = LineDriver(LinePort(port="line", baud=BAUD))
    except DeviceError:
        return ""
    told, found = Timestamps(["plate_temperature"]), set[str]()
    for _ in range(60):
        asked, amps, sent = clock.now, round(chance.uniform(-0.25, 0.25), 5), len(wire.sent)
        told.begin()
        try:
            read = rig.exchange(amps, told)
        except DeviceError:
            break
        finally:
            found |= {"a current waits"} if wire.sent[sent:][:1] != [asked] else set()
        newer = told.measurement_times()[0] - BEGIN - (read.plate - ROOM)
        found |= {"said to be newer than it is"} if newer > USUAL + slowest + PROMPT else set()
        found |= {"another command's answer"} if abs(read.current - amps) > 1e-6 else set()
        clock.now += 5e-3
    try:
        rig.close()
    except DeviceError:
        return ", ".join(found)
    return ", ".join(found | ({"zero has not come"} if wire.currents[-1] else set()))


@pytest.mark.parametrize("version", [1, 2])
def test_random_wire_faults_end_no_session(monkeypatch: pytest.MonkeyPatch, version: int) -> None:
    """All currents are on the wire at once, no answer is another command's or too new, and zero comes at the end.

    If it can't, that is told.  (What an adaptor gives twice, version 1 can't tell from a new answer.)
    """
    found = dict[int, str]()
    for seed in range(CASES):
        chance = random.Random(seed)
        faults = Faults.any(chance)
        if said := broken(*wired(monkeypatch, seed, version, faults), chance, faults.takes(10.0)):
            found[seed] = said
    assert found == {}


def test_a_rig_that_answers_no_greeting_while_it_is_driven(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message says what a program of version 1 must do, which goes on until a command is lost."""
    _, wire = wired(monkeypatch, 1, 1, faults := Faults())
    rig = LineDriver(LinePort(port="line", baud=BAUD))
    wire.deaf = True
    rig.exchange(0.1)
    faults.lost = 1.0
    with pytest.raises(
        DeviceError, match="did not answer 'I 0.10000', sent again and again; check its power and its cable$"
    ):
        rig.exchange(0.1)
    faults.lost = 0.0
    with pytest.raises(DeviceError, match=r"answer '\?'.*, and that its program answers '\?' at any time$"):
        rig.exchange(0.1)
    with pytest.raises(DeviceError, match=r"answer '\?'"):
        rig.close()
    assert wire.currents[-1] == 0.0
