"""Virtual ODrive servos: frames in, frames out; and a serial adaptor (slcan) that carries the frames as text lines."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from itouch_xyz_table import canframes as can_
from itouch_xyz_table.faults import FAULT, POSITION, TIMEOUT
from itouch_xyz_table.virtual import FASTEST, FEED, GOAL, GOAL_SPEED, MOST, VirtualServo

#: The error bit of an expired watchdog in firmware 0.6; period of the heartbeat [s].
WATCHDOG_ENDED, BEAT = 0x1000000, 0.1
#: Its supply [V].
SUPPLY_VOLTS = 24.0


@dataclass(slots=True)
class VirtualOdrive(VirtualServo):
    """One servo: its axis is that of `VirtualServo`, its interface is CAN frames.

    ``timeout`` [s] is that of its watchdog, infinite if it is off; ``constant`` its motor's torque constant [N m/A];
    ``ended`` the error when its watchdog expires, ``refuses`` the error when it is to be driven (0: none).
    """

    timeout: float = 0.1
    constant: float = 0.04
    ended: int = WATCHDOG_ENDED
    refuses: int = 0
    _beat: float = -math.inf
    _by_velocity: bool = False

    def hear(self, command: int, data: bytes, now: float, *, remote: bool) -> list[tuple[int, bytes]]:
        """Obey a frame and return the answers, each an identifier and data."""
        self._fed = now
        if not self.answers:
            return []
        if remote:
            return self._told(command)
        try:
            values = can_.unpack(command, data) if command != can_.CLEAR_ERRORS else ()
        except (KeyError, ValueError):
            return []
        self._obey(command, values)
        return []

    def _obey(self, command: int, values: tuple[float, ...]) -> None:
        at = self.registers
        if command == can_.SET_STATE:
            self._set_state(int(values[0]))
        elif command == can_.SET_MODE:
            self._by_velocity = int(values[0]) == can_.BY_VELOCITY
        elif command == can_.SET_POSITION and not self._by_velocity:
            at[GOAL], at[GOAL_SPEED], at[FEED] = values[0], values[1] / can_.MILLI, values[2] / can_.MILLI
        elif command == can_.SET_VELOCITY and self._by_velocity:
            at[GOAL], at[GOAL_SPEED], at[FEED] = math.nan, values[0], values[1]
        elif command == can_.SET_LIMITS:
            at[FASTEST], at[MOST] = values[0], values[1] * self.constant
        elif command == can_.CLEAR_ERRORS and self.mode in (FAULT, TIMEOUT):
            self.mode, self.fault = 0, 0
        elif command == can_.ESTOP:
            self.trip(0x2000000)

    def _set_state(self, state: int) -> None:
        if state == can_.IDLE and self.mode == POSITION:
            self.mode = 0
        elif state == can_.CLOSED_LOOP and self.mode == 0 and self.refuses:
            self.trip(self.refuses)
        elif state == can_.CLOSED_LOOP and self.mode == 0:
            self.mode = POSITION

    def _told(self, command: int) -> list[tuple[int, bytes]]:
        if command == can_.ESTIMATES:
            data = can_.pack(command, self.place + self.zero, self.speed)
        elif command == can_.CURRENTS:
            data = can_.pack(command, self.torque / self.constant, self.torque / self.constant)
        elif command == can_.SUPPLY:
            data = can_.pack(command, SUPPLY_VOLTS)
        elif command == can_.HEARTBEAT:
            return [self.beat()]
        else:
            return []
        return [(can_.number(self.number, command), data)]

    def watch(self, now: float) -> None:
        """Let go if no frame has come for too long by a time [s]."""
        if self.mode == POSITION and now - self._fed > self.timeout:
            self.mode, self.fault = FAULT, self.ended

    def restart(self) -> None:
        """Restart, as after a loss of the supply: idle, without errors."""
        self.mode, self.fault, self.registers, self._by_velocity = 0, 0, {}, False

    def beat(self) -> tuple[int, bytes]:
        """Return the heartbeat: identifier and data."""
        state = can_.CLOSED_LOOP if self.mode == POSITION else can_.IDLE
        error = self.fault if self.mode == FAULT else 0
        return can_.number(self.number, can_.HEARTBEAT), error.to_bytes(4, "little") + bytes((state, 0, 0, 0))

    def due(self, now: float) -> list[tuple[int, bytes]]:
        """Return the frames that are due by a time [s] without a request."""
        if now - self._beat < BEAT or not self.answers:
            return []
        self._beat = now
        return [self.beat()]


@dataclass(slots=True)
class VirtualCan:
    """The bus, and the adaptor at its end: text lines that end with a carriage return.

    ``lose`` decides for each frame of a servo whether it is lost, ``miss`` for each identifier from the host.
    """

    servos: dict[int, VirtualOdrive]
    lose: Callable[[], bool] = field(default=lambda: False)
    miss: Callable[[int], bool] = field(default=lambda number: False)
    open: bool = False
    _text: bytes = b""

    def frame(self, number: int, data: bytes, now: float, *, remote: bool) -> list[tuple[int, bytes]]:
        """Take a frame from the host and return the servos' answers."""
        if self.miss(number):
            return []
        servo = self.servos.get(number >> 5)
        answers = servo.hear(number & 31, data, now, remote=remote) if servo is not None else []
        return [answer for answer in answers if not self.lose()]

    def unasked(self, now: float) -> list[tuple[int, bytes]]:
        """Return the frames that the servos send without a request."""
        found = [answer for servo in self.servos.values() for answer in servo.due(now)]
        return [answer for answer in found if not self.lose()]

    def take(self, data: bytes, now: Callable[[], float]) -> bytes:
        """Take bytes from the host and return the adaptor's answer."""
        self._text += data
        out = b""
        while b"\r" in self._text:
            line, _, self._text = self._text.partition(b"\r")
            out += self._line(line.strip(), now())
        return out + (b"".join(map(_text, self.unasked(now()))) if self.open else b"")

    def _line(self, line: bytes, now: float) -> bytes:
        kind = line[:1]
        if kind in b"OLC" and line:
            self.open = kind != b"C"
            return b"\r"
        if kind not in b"tr" or not line:
            return b"\r" if kind in b"SY" else b"\a"
        try:
            number, size = int(line[1:4], 16), int(line[4:5])
            data = bytes.fromhex(line[5 : 5 + 2 * size].decode()) if kind == b"t" else b""
        except ValueError:
            return b"\a"
        if not self.open:
            return b"\a"
        return b"z\r" + b"".join(map(_text, self.frame(number, data, now, remote=kind == b"r")))


def _text(frame: tuple[int, bytes]) -> bytes:
    number, data = frame
    return b"t%03X%d%s\r" % (number, len(data), data.hex().upper().encode())
