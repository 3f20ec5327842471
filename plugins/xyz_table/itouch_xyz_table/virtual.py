"""Virtual moteus servos on a virtual CAN-FD adaptor: registers, watchdog, faults, and a simple axis for each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from itouch_xyz_table.faults import FAULT, POSITION, TIMEOUT
from itouch_xyz_table.multiplex import Read, Write, decode, reply

MODE, VOLTAGE, TEMPERATURE, FAULT_CODE = 0x00, 0x0D, 0x0E, 0x0F
PLACE, SPEED, TORQUE, HOME = 0x01, 0x02, 0x03, 0x0C
#: What a servo's position refers to: its rotor only, or a position that it was given.
BY_ROTOR, TOLD = 1, 2
GOAL, GOAL_SPEED, FEED, KP, KD, MOST, WATCHDOG, FASTEST = 0x20, 0x21, 0x22, 0x23, 0x24, 0x25, 0x27, 0x28
EXACT = 0x131
#: Unit of one count in int8, int16 and int32, by register.
_UNITS = {
    PLACE: (0.01, 0.0001, 0.00001), SPEED: (0.1, 0.00025, 0.00001), TORQUE: (0.5, 0.01, 0.001),
    VOLTAGE: (0.5, 0.1, 0.001), TEMPERATURE: (1.0, 0.1, 0.001), GOAL: (0.01, 0.0001, 0.00001),
    GOAL_SPEED: (0.1, 0.00025, 0.00001), FEED: (0.5, 0.01, 0.001), MOST: (0.5, 0.01, 0.001),
    KP: (1 / 127, 1 / 32767, 1 / 2147483647), KD: (1 / 127, 1 / 32767, 1 / 2147483647),
    WATCHDOG: (0.01, 0.001, 0.000001), FASTEST: (0.1, 0.00025, 0.00001), EXACT: (0.01, 0.0001, 0.00001),
}  # fmt: skip
#: The servo's own watchdog [s] if a command sets none.
_DEFAULT_WATCHDOG = 0.1


@dataclass(slots=True)
class VirtualServo:
    """One servo.

    ``place``, ``speed``, ``torque`` [rev, rev/s, N m] are the axis's; the owner of the physics may set them, by default
    `advance` moves a stiff axis between two ends.  ``zero`` is added to ``place`` in what the servo reports.
    """

    number: int
    low: float = -math.inf
    high: float = math.inf
    place: float = 0.0
    speed: float = 0.0
    torque: float = 0.0
    load: float = 0.0
    zero: float = 0.0
    mode: int = 0
    fault: int = 0
    home: int = BY_ROTOR
    answers: bool = True
    led: bool = False
    registers: dict[int, float] = field(default_factory=dict)
    _fed: float = 0.0

    def take(self, data: bytes, now: float) -> bytes:
        """Obey a frame at a time [s] and return the data of the reply."""
        out = b""
        commanded = False
        for part in decode(data):
            if isinstance(part, Write):
                commanded |= self._write(part, now)
            else:
                out += reply(part, [self._raw(part.first + i, part.kind) for i in range(part.size)])
        if commanded:
            self._fed = now
        return out

    def _write(self, write: Write, now: float) -> bool:
        value = math.nan if write.value is None else write.value
        if write.kind < 3 and write.register in _UNITS:
            value *= _UNITS[write.register][write.kind]
        if write.register == MODE:
            return self._set_mode(int(value))
        if write.register == EXACT:
            self.zero, self.home = value - self.place, TOLD
            return False
        self.registers[write.register] = value
        return False

    def _set_mode(self, mode: int) -> bool:
        if mode == 0:
            self.mode, self.fault = 0, 0
            return False
        if self.mode in (FAULT, TIMEOUT):  # latched until it is stopped
            return False
        self.registers = {}  # a new command clears the registers of the last one
        self.mode = mode
        return mode == POSITION

    def _raw(self, register: int, kind: int) -> float:
        value = {
            MODE: float(self.mode), PLACE: self.place + self.zero, SPEED: self.speed, TORQUE: self.torque,
            VOLTAGE: 24.0, TEMPERATURE: 31.0, FAULT_CODE: float(self.fault), HOME: float(self.home),
        }.get(register, 0.0)  # fmt: skip
        return value if kind == 3 else value / _UNITS.get(register, (1.0, 1.0, 1.0))[kind]

    def trip(self, code: int) -> None:
        """Stop with a fault."""
        self.mode, self.fault = FAULT, code

    def start_anew(self) -> None:
        """Lose the supply for a moment: no force, and a position known only within a turn of the rotor."""
        self.mode, self.fault, self.registers, self.home = 0, 0, {}, BY_ROTOR
        self.zero = -round(self.place)

    def watch(self, now: float) -> None:
        """Stop if no command has come for too long by a time [s]."""
        patience = self.registers.get(WATCHDOG, _DEFAULT_WATCHDOG)
        if self.mode == POSITION and not math.isnan(patience) and now - self._fed > patience:
            self.mode = TIMEOUT

    def goal(self) -> float:
        """Return the goal [rev], counted as ``place`` is."""
        return self.registers.get(GOAL, math.nan) - self.zero

    def advance(self, step: float) -> None:
        """Move a stiff axis for ``step`` seconds; at its ends it stops with the greatest allowed torque."""
        if self.mode != POSITION:
            self.speed, self.torque = 0.0, 0.0
            return
        most, fastest = self.registers.get(MOST, math.inf), self.registers.get(FASTEST, math.inf)
        wanted = self.registers.get(GOAL_SPEED, 0.0)
        if not math.isnan(self.goal()):
            wanted += 60.0 * (self.goal() - self.place)
        self.speed = max(-fastest, min(fastest, wanted))
        place = self.place + step * self.speed
        feed = self.registers.get(FEED, 0.0)
        self.torque = max(-most, min(most, self.load if self.load else feed))
        if not self.low <= place <= self.high:
            self.torque = math.copysign(most, self.speed)
            place, self.speed = min(max(place, self.low), self.high), 0.0
        self.place = place


def checksum(text: bytes) -> int:
    """Return the CRC-8, polynomial 0x97, of a line up to its asterisk."""
    crc = 0
    for byte in text:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x97) & 0xFF if crc & 0x80 else crc << 1 & 0xFF
    return crc


@dataclass(slots=True)
class VirtualBus:
    """The adaptor: lines of text in and out; ``mute`` and ``garble`` count answers to lose or to damage."""

    servos: dict[int, VirtualServo]
    mute: int = 0
    garble: int = 0
    _text: bytes = b""

    def take(self, data: bytes, now: Callable[[], float]) -> bytes:
        """Take bytes from the host and return the adaptor's answer."""
        self._text += data
        out = b""
        while b"\n" in self._text:
            line, _, self._text = self._text.partition(b"\n")
            out += self._line(line.strip(), now())
        return out

    def _line(self, line: bytes, now: float) -> bytes:
        checked = line[-3:-2] == b"*"
        if checked:
            line, given = line[:-3], int(line[-2:], 16)
            if checksum(line) != given:
                return b"ERR checksum\n"
        words = line.split()
        if words[:2] != [b"can", b"send"]:
            return b"ERR unknown command\n"
        target, data = int(words[2], 16), bytes.fromhex(words[3].decode())
        servo = self.servos.get(target & 0x7F)
        out = _sealed(b"OK", checked)
        if servo is None or not servo.answers:
            return out
        answer = servo.take(data, now)
        if not target & 0x8000:
            return out
        if self.mute > 0:
            self.mute -= 1
            return out
        source = target >> 8 & 0x7F
        text = b"rcv %04x %s E B F" % (servo.number << 8 | source, answer.hex().encode())
        sealed = _sealed(text, checked)
        if self.garble > 0:
            self.garble -= 1
            sealed = sealed.replace(b"rcv 0", b"rcv 7", 1)
        return out + sealed


def _sealed(text: bytes, checked: bool) -> bytes:
    if not checked:
        return text + b"\n"
    return b"%s *%02X\n" % (text, checksum(text + b" "))


__all__ = ["Read", "VirtualBus", "VirtualServo", "Write", "checksum"]
