"""A virtual TMCL module with steppers: frames in, frames out, a ramp generator for each motor, and a heartbeat."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from itouch_xyz_table import tmclframes as tm
from itouch_xyz_table.faults import POSITION
from itouch_xyz_table.virtual import VirtualServo

#: Time step of the ramp generator [s]; the greatest speed that a module accepts [microsteps/s].
STEP, FASTEST = 1e-3, 7_999_774
#: Factory settings: microsteps per second, and per second squared.
_FACTORY = {tm.MAX_SPEED: 51200, tm.MAX_ACCELERATION: 51200}
#: The parameters that can be set, each with its greatest value.
_SETTABLE = {
    tm.TARGET: (1 << 31) - 1, tm.ACTUAL: (1 << 31) - 1, tm.MAX_SPEED: FASTEST, tm.MAX_ACCELERATION: (1 << 31) - 1,
    tm.SEARCH_MODE: 255, tm.SEARCH_SPEED: FASTEST, tm.SWITCH_SPEED: FASTEST,
}  # fmt: skip
#: A frame that is not complete within this time [s] is dropped.
_BROKEN = 5e-3


@dataclass(slots=True)
class VirtualStepper(VirtualServo):
    """One motor.

    ``place`` [rev] is the axis's own position, which the module does not know.  It counts microsteps (``counter``), and
    the axis follows: at count 0 it is at ``shift`` [rev].  ``ended``: its end switch is pressed.
    """

    microsteps: float = 51200.0
    counter: float = 0.0
    rate: float = 0.0
    target: float = 0.0
    turning: float | None = None
    shift: float = 0.0
    ended: bool = False
    searching: bool = False
    set: dict[int, int] = field(default_factory=lambda: dict(_FACTORY))
    _now: float = math.nan

    def watch(self, now: float) -> None:
        """Advance the ramp generator to a time [s]."""
        if math.isnan(self._now):
            self._now = now
            self.counter = self.target = round((self.place - self.shift) * self.microsteps)
        while self._now + STEP <= now + 1e-9:
            self._now += STEP
            if self.mode == POSITION:
                self._ramp()

    def _ramp(self) -> None:
        most = self.set[tm.MAX_ACCELERATION] * STEP
        if self.searching and self.ended:
            self.halt()
            self.shift += self.counter / self.microsteps
            self.counter = self.target = 0.0
            return
        wanted = self.turning
        if wanted is None:
            rest = self.target - self.counter
            # The speed from which it can brake to zero at the target in whole time steps.
            braked = math.sqrt(2.0 * self.set[tm.MAX_ACCELERATION] * abs(rest) + 0.25 * most * most) - 0.5 * most
            wanted = math.copysign(min(self.set[tm.MAX_SPEED], braked, abs(rest) / STEP), rest)
        self.rate += max(-most, min(most, wanted - self.rate))
        self.counter += STEP * self.rate
        if self.turning is None and abs(self.target - self.counter) < 0.5 and abs(self.rate) <= most:
            self.counter, self.rate = self.target, 0.0

    def halt(self) -> None:
        """Stop at once."""
        self.mode, self.rate, self.turning, self.searching = 0, 0.0, None, False
        self.target = self.counter

    def goal(self) -> float:
        """Return the motor's position [rev], counted as ``place`` is."""
        return self.counter / self.microsteps + self.shift

    def restart(self) -> None:
        """Restart, as after a loss of the supply: it counts from where it is, with the factory limits."""
        self.halt()
        self.shift, self.counter, self.target = self.goal(), 0.0, 0.0
        self.set = dict(_FACTORY)

    def get(self, parameter: int) -> int | None:
        """Return a parameter of the axis; None if there is no such parameter."""
        if parameter == tm.ACTUAL:
            return round(self.counter)
        if parameter == tm.TARGET:
            return round(self.target)
        if parameter == tm.ACTUAL_SPEED:
            return round(self.rate)
        return self.set.get(parameter)

    def put(self, parameter: int, value: int) -> int:
        """Set a parameter of the axis; return the status code."""
        if parameter not in _SETTABLE:
            return 3
        if abs(value) > _SETTABLE[parameter]:
            return 4
        if parameter == tm.ACTUAL:
            self.shift += (self.counter - value) / self.microsteps
            self.counter = value
        elif parameter == tm.TARGET:
            self.target = value
        else:
            self.set[parameter] = value
        return tm.OK

    def turn(self, speed: float) -> None:
        """Turn without end at a speed [microsteps/s]."""
        self.mode, self.turning = POSITION, speed

    def move(self, place: float) -> None:
        """Go to a position [microsteps]."""
        self.mode, self.turning, self.searching, self.target = POSITION, None, False, place

    def search(self, kind: int) -> int | None:
        """Start or stop the search for the end switch, or tell whether it is running; None: an unknown request."""
        if kind == tm.SEARCH_START:
            right = bool(self.set.get(tm.SEARCH_MODE, 0) & tm.RIGHT_INSTEAD)
            speed = self.set.get(tm.SEARCH_SPEED, 0)
            self.turn(speed if right else -speed)
            self.searching = True
        elif kind == tm.SEARCH_STOP:
            self.halt()
        elif kind != tm.SEARCH_STATUS:
            return None
        return int(self.searching) if kind == tm.SEARCH_STATUS else 0


@dataclass(slots=True)
class VirtualTmcl:
    """The module: bytes in, bytes out.

    ``heartbeat``: whether it has one; ``deaf``: it ignores its heartbeat; ``tripped``: the heartbeat has stopped the
    motors.  ``spoil`` may change the bytes of an answer on their way.
    """

    motors: dict[int, VirtualStepper]
    address: int = 1
    heartbeat: bool = True
    deaf: bool = False
    answers: bool = True
    tripped: bool = False
    spoil: Callable[[bytes], bytes] = field(default=lambda data: data)
    globals: dict[int, int] = field(default_factory=dict)
    _fed: float = 0.0
    _data: bytes = b""
    _when: float = 0.0

    def take(self, data: bytes, now: Callable[[], float]) -> bytes:
        """Take bytes from the host and return the module's answer."""
        moment = now()
        for motor in self.motors.values():
            motor.watch(moment)
        self._beat(moment)
        if self._data and time.monotonic() - self._when > _BROKEN:
            self._data = b""
        if data:
            self._data, self._when = self._data + data, time.monotonic()
        out = b""
        while len(self._data) >= tm.SIZE:
            frame, self._data = self._data[: tm.SIZE], self._data[tm.SIZE :]
            answer = self._frame(frame, moment)
            out += self.spoil(answer) if answer else b""
        return out

    def _beat(self, now: float) -> None:
        """Stop all motors if the host has been silent for too long."""
        patience = 1e-3 * self.globals.get(tm.HEARTBEAT, 0)
        moving = any(motor.mode == POSITION for motor in self.motors.values())
        if patience and moving and not self.deaf and now - self._fed > patience:
            self.tripped = True
            for motor in self.motors.values():
                motor.halt()

    def restart(self) -> None:
        """Restart, as after a loss of the supply."""
        self.globals = {}
        for motor in self.motors.values():
            motor.restart()

    def _frame(self, frame: bytes, now: float) -> bytes:
        asked = tm.heard(frame)
        if not self.answers or (asked is not None and asked.module != self.address):
            return b""
        if asked is None:
            return tm.answer(tm.Answer(self.address, tm.WRONG_SUM, frame[1], 0))
        self._fed = now
        status, value = self._obey(asked)
        return tm.answer(tm.Answer(self.address, status, asked.command, value))

    def _obey(self, asked: tm.Request) -> tuple[int, int]:
        command, kind, value = asked.command, asked.type, asked.value
        if command in (tm.SET_GLOBAL, tm.GET_GLOBAL):
            if kind != tm.HEARTBEAT or not self.heartbeat:
                return 3, 0
            if command == tm.SET_GLOBAL:
                self.globals[kind] = value
            return tm.OK, self.globals.get(kind, 0)
        motor = self.motors.get(asked.motor)
        if motor is None:
            return 4, 0
        if command == tm.GET_AXIS:
            found = motor.get(kind)
            return (tm.OK, found) if found is not None else (3, 0)
        if command == tm.SET_AXIS:
            return motor.put(kind, value), value
        if command == tm.SEARCH:
            going = motor.search(kind)
            return (tm.OK, going) if going is not None else (3, 0)
        return self._move(motor, command, kind, value)

    @staticmethod
    def _move(motor: VirtualStepper, command: int, kind: int, value: int) -> tuple[int, int]:
        if command == tm.STOP:
            motor.halt()
        elif command == tm.MOVE and kind == tm.ABSOLUTE:
            motor.move(value)
        elif command in (tm.ROTATE_RIGHT, tm.ROTATE_LEFT):
            motor.turn(value if command == tm.ROTATE_RIGHT else -value)
        else:
            return (3 if command == tm.MOVE else 2), 0
        return tm.OK, value
