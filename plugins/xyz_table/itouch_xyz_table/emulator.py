"""The table's wire: three virtual servos on a pseudo-terminal, with the table's twin as their axes."""

from __future__ import annotations

import math
import os
import tempfile
from dataclasses import replace
from typing import Any

from itouch.plugin import Emulator, Record, Terminal
from itouch_xyz_table.faults import POSITION
from itouch_xyz_table.virtual import GOAL_SPEED, MOST, VirtualBus, VirtualServo


class TableEmulator(Emulator):
    """Servos whose shafts are the axes of the twin; the ends of the travel are those of the parameters."""

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        self._leads = [lead * sign for lead, sign in zip(params.lead, params.direction, strict=True)]
        self.bus = VirtualBus({int(n): VirtualServo(int(n)) for n in params.ids})
        self._servos = list(self.bus.servos.values())
        self._terminal: Terminal | None = None
        self._when = 0.0

    @classmethod
    def somewhere(cls, params: Any) -> Any:
        """Name a serial port of our own if none is named."""
        return params if params.port else replace(params, port=f"{tempfile.gettempdir()}/itouch-table-{os.getpid()}")

    @classmethod
    def elsewhere(cls, params: Any, folder: str) -> Any:
        """Name a serial port in a folder."""
        return replace(params, port=f"{folder}/table")

    def open(self) -> str:
        """Make the serial port that the parameters name."""
        self._terminal = Terminal(self.params.port)
        return f"servos of the table on {self.params.port or self._terminal.path}"

    def close(self) -> None:
        """Take the port away."""
        terminal, self._terminal = self._terminal, None
        if terminal is not None:
            terminal.close()

    def handles(self) -> list[int]:
        """Return the serial port's descriptor."""
        return [self._terminal.fileno()] if self._terminal is not None else []

    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Show the twin's axes to the servos, answer the host, and tell the twin where to go."""
        if self._terminal is None:
            return False
        place, load = reading["pose"].tolist()[:3], reading["wrench"].tolist()[:3]
        load[2] -= self.params.weight
        lapse, self._when = now - self._when, now
        for servo, lead, p, f in zip(self._servos, self._leads, place, load, strict=True):
            servo.place = p / lead
            servo.torque = -f * lead / (math.tau * self.params.efficiency)
            servo.watch(now)
        data = self._terminal.receive()
        if data:
            self._terminal.send(self.bus.take(data, lambda: now))
        goal = command["pose_target"]
        for axis, (servo, lead) in enumerate(zip(self._servos, self._leads, strict=True)):
            wanted = servo.goal() * lead
            if servo.mode == POSITION and not math.isnan(wanted):
                goal[axis] = wanted
            elif servo.mode == POSITION:  # it is led by its speed: towards an end, as in homing
                self._creep(servo, goal, axis, lead, lapse)
        return any(servo.mode == POSITION for servo in self._servos)

    def _creep(self, servo: VirtualServo, goal: Any, axis: int, lead: float, lapse: float) -> None:
        half = self.params.travel[axis] / 2
        low, high = (-half, half) if axis < 2 else (0.0, 2 * half)
        goal[axis] = min(max(goal[axis] + servo.registers.get(GOAL_SPEED, 0.0) * lead * lapse, low), high)
        if goal[axis] in (low, high):
            servo.torque = math.copysign(servo.registers.get(MOST, 0.0), servo.registers.get(GOAL_SPEED, 0.0))
