"""Simulated servos against the protocol's tables, and what the table's driver makes of them, without a bus."""

from __future__ import annotations

import math
import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch.plugin import Field, Record
from itouch_xyz_table.emulator import TableEmulator
from itouch_xyz_table.faults import fault_name
from itouch_xyz_table.table import XyzTable, XyzTableParams
from itouch_xyz_table.virtual import GOAL, POSITION, VirtualServo

TRAVEL = (0.3, 0.2, 0.1)


@pytest.mark.parametrize(
    ("register", "units"),
    [(0x01, (0.01, 1e-4, 1e-5)), (0x02, (0.1, 2.5e-4, 1e-5)), (0x03, (0.5, 0.01, 0.001)), (0x0D, (0.5, 0.1, 0.001))],
)
def test_what_is_asked_for_comes_in_the_units_of_its_width(register: int, units: tuple[float, ...]) -> None:
    servo = VirtualServo(1, place=0.5, speed=0.5, torque=0.5)
    said = {0x01: 0.5, 0x02: 0.5, 0x03: 0.5, 0x0D: 24.0}[register]
    for asked, answered, form, unit in zip((0x11, 0x15, 0x19, 0x1D), (0x21, 0x25, 0x29, 0x2D), "bhif", (*units, 1.0),
                                           strict=True):  # fmt: skip
        answer = servo.take(bytes((asked, register)), 0.0)
        assert answer[:2] == bytes((answered, register))
        assert struct.unpack("<" + form, answer[2:])[0] * unit == pytest.approx(said, abs=0.51 * unit * (form != "f"))


def test_a_servo_that_is_told_no_place_and_no_speed_stays() -> None:
    servo = VirtualServo(1, place=0.25)
    servo.mode, servo.registers = POSITION, {GOAL: math.nan}
    servo.advance(0.1)
    assert (servo.place, servo.speed) == (0.25, 0.0)


def test_every_fault_of_a_servo_has_a_name_of_its_own() -> None:
    names = [fault_name(code) for code in (*range(1, 8), *range(32, 49))]
    assert len(set(names)) == len(names)
    assert not any(name.startswith("fault ") for name in names)


def test_two_commands_at_one_moment_have_no_speed_between_them() -> None:
    table = XyzTable(XyzTableParams(port="/dev/null", travel=TRAVEL, lead=(0.005,) * 3, direction=(1, 1, -1)))
    table.clock = lambda: 5.0
    table._goals((0.0, 0.0, 0.01))
    at_once = table._goals((0.01, 0.0, 0.02))
    assert [goal.position for goal in at_once if goal] == pytest.approx([2.0, 0.0, -4.0])
    assert [goal.velocity for goal in at_once if goal] == [0.0] * 3
    table.clock = lambda: 5.01
    later = table._goals((0.0101, 0.0, 0.0199))
    assert [goal.velocity for goal in later if goal] == pytest.approx([2.0, 0.0, 2.0])


def test_an_axis_presses_its_switch_at_the_low_end_of_its_travel_alone() -> None:
    params = XyzTableParams(tmcl="/dev/null", travel=TRAVEL)
    emulator = TableEmulator(params)
    emulator._terminal: Any = SimpleNamespace(receive=lambda: b"", send=lambda data: None)
    reads, commands = XyzTable.channels(params)
    reading, command = Record.of(Field.of(c) for c in reads), Record.of(Field.of(c) for c in commands)
    lows = np.array([-0.15, -0.1, 0.0])
    for inside in range(4):  # the axes leave their ends one after the other
        reading["pose"][:3] = lows + 1e-3 * (np.arange(3) < inside)
        emulator.serve(0.0, reading, command)
        assert [motor.ended for motor in emulator._steppers] == [axis >= inside for axis in range(3)]


@pytest.mark.parametrize("begin", [0.0, 3.0])
def test_the_time_of_a_simulated_module_begins_with_the_sessions_however_long_the_machine_runs(begin: float) -> None:
    params = XyzTableParams(tmcl="/dev/none", homing="search", motors=(0, 1, 2))
    emulator = TableEmulator(params)
    assert begin <= emulator._time(begin) < begin + 60.0
    assert begin + 1.0 <= emulator._time(begin + 1.0) < begin + 61.0
