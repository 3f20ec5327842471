"""The table's emulator: virtual servos or a stepper module on a pseudo-terminal, with the table's twin as axes.

An ODrive's bus is emulated as a serial adaptor for python-can (``slcan``), a TMCL module as its serial port.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
from dataclasses import replace
from typing import Any

from itouch.plugin import DeviceError, Emulator, Record, Terminal
from itouch_xyz_table.faults import FAULT, POSITION
from itouch_xyz_table.virtual import GOAL_SPEED, MOST, VirtualBus, VirtualServo
from itouch_xyz_table.virtual_odrive import VirtualCan, VirtualOdrive
from itouch_xyz_table.virtual_tmcl import VirtualStepper, VirtualTmcl

#: Within this time [s] an ODrive has reported that its watchdog has expired.
TOLD = 0.15
#: Distance [m] from its low end below which an axis presses its stepper's end switch.
PRESSED = 1e-4


class TableEmulator(Emulator):
    """Servos whose shafts are the axes of the twin; the travel ends where the parameters say."""

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        self._leads = [lead * sign for lead, sign in zip(params.lead, params.direction, strict=True)]
        self.bus: VirtualBus | VirtualCan | VirtualTmcl
        self._servos: list[VirtualServo]
        #: In step with the host, a module's ramps must advance in every period.
        self.free_running = bool(params.tmcl)
        if params.tmcl:
            self._steppers = [
                VirtualStepper(int(n), microsteps=m) for n, m in zip(params.motors, params.microsteps, strict=True)
            ]
            self.bus = VirtualTmcl(
                {motor.number: motor for motor in self._steppers}, address=params.address, heartbeat=params.heartbeat
            )
            self._servos = [*self._steppers]
            x, y, _ = params.travel
            self._lows = dict(zip((motor.number for motor in self._steppers), (-x / 2, -y / 2, 0.0), strict=True))
        elif params.bus:
            motors = zip(params.ids, params.torque_constant, strict=True)
            drives = [VirtualOdrive(int(number), constant=constant) for number, constant in motors]
            self.bus, self._servos = VirtualCan({drive.number: drive for drive in drives}), [*drives]
        else:
            self._servos = [VirtualServo(int(n)) for n in params.ids]
            self.bus = VirtualBus({servo.number: servo for servo in self._servos})
        self._terminal: Terminal | None = None
        self._when = self._first = 0.0
        self._begun, self._ahead, self._stands = 0.0, 0.0, bool(params.bus or params.tmcl)
        self._ended, self._proven = 0.0, False

    @classmethod
    def with_default_address(cls, params: Any) -> Any:
        """Name a serial port of our own if no port is named."""
        if params.port or params.bus or params.tmcl:
            return params
        return replace(params, port=f"{tempfile.gettempdir()}/itouch-table-{os.getpid()}")

    @classmethod
    def with_private_address(cls, params: Any, folder: str) -> Any:
        """Name a serial port in a folder."""
        if params.tmcl:
            return replace(params, tmcl=f"{folder}/table")
        return replace(params, bus=f"slcan:{folder}/table") if params.bus else replace(params, port=f"{folder}/table")

    def open(self) -> str:
        """Create the serial port named in the parameters; return what is on which port."""
        if self.params.tmcl:
            self._terminal = Terminal(self.params.tmcl, baud=self.params.baud * self.speed)
            return f"stepper module of the table on {self.params.tmcl}"
        interface, _, place = self.params.bus.rpartition(":")
        if interface not in ("", "slcan"):
            raise DeviceError(f"bus = '{self.params.bus}': a simulated table has its bus at slcan:PATH")
        place = place.partition("@")[0]  # behind @: the speed of the port
        self._terminal = Terminal(self.params.port or place)
        return f"servos of the table on {self.params.port or place or self._terminal.path}"

    def close(self) -> None:
        """Remove the port."""
        terminal, self._terminal = self._terminal, None
        if terminal is not None:
            terminal.close()

    def file_descriptors(self) -> list[int]:
        """Return the serial port's descriptor."""
        return [self._terminal.fileno()] if self._terminal is not None else []

    def service_interval(self) -> float:
        """Return how long [s] nothing is due, at most until the serial port has transferred the next bytes."""
        return (
            min(super().service_interval(), self._terminal.due())
            if self._terminal is not None
            else super().service_interval()
        )

    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Show the twin's axes to the servos, answer the host, and pass the servos' goals to the twin.

        Return whether a servo is driven.
        """
        if self._terminal is None:
            return False
        now = self._time(now)
        place = reading["pose"].tolist()[:3]
        load = [0.0] * 3 if self.params.tmcl else reading["wrench"].tolist()[:3]
        load[2] -= self.params.weight
        lapse, self._when = now - self._when, now
        for servo, lead, p, f in zip(self._servos, self._leads, place, load, strict=True):
            servo.place = p / lead
            servo.torque = -f * lead / (math.tau * self.params.efficiency)
            if isinstance(servo, VirtualStepper):
                servo.ended = p <= self._lows[servo.number] + PRESSED
            servo.watch(now)
        answer = self.bus.take(self._terminal.receive(), lambda: now)
        if answer:
            self._terminal.send(answer)
        goal = command["pose_target"]
        for axis, (servo, lead) in enumerate(zip(self._servos, self._leads, strict=True)):
            wanted = servo.goal() * lead
            if servo.mode == POSITION and not math.isnan(wanted):
                goal[axis] = wanted
            elif servo.mode == POSITION:  # driven by velocity: towards an end, as in homing
                self._creep(servo, goal, axis, lead, lapse)
        return any(servo.mode == POSITION for servo in self._servos)

    def _time(self, now: float) -> float:
        """Return the simulated time, advanced with the host's until it starts: opening an ODrive awaits its watchdog.

        Once the watchdogs have expired nothing waits for them any more, and a session that starts slowly is not a
        silence.
        """
        if self._stands:
            if not self._begun:
                self._begun, self._first = time.monotonic(), now
            self._ahead = time.monotonic() - self._begun
            if isinstance(self.bus, VirtualTmcl):
                self._stands = now == self._first
                return now + self._ahead
            if not all(servo.mode == FAULT for servo in self._servos):
                self._ended = self._ahead
            self._stands = now == self._first and (not self._proven or self._ahead - self._ended < TOLD)
            self._proven |= self._ahead > self._ended
        return now + self._ahead

    def _creep(self, servo: VirtualServo, goal: Any, axis: int, lead: float, lapse: float) -> None:
        half = self.params.travel[axis] / 2
        low, high = (-half, half) if axis < 2 else (0.0, 2 * half)
        goal[axis] = min(max(goal[axis] + servo.registers.get(GOAL_SPEED, 0.0) * lead * lapse, low), high)
        if goal[axis] in (low, high):
            servo.torque = math.copysign(servo.registers.get(MOST, 0.0), servo.registers.get(GOAL_SPEED, 0.0))
