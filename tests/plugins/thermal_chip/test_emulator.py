"""The display's driver on its emulator with the chip in it, in simulated time: what a virtual rig does every period."""

from __future__ import annotations

from pathlib import Path

import pytest

from itouch.plugin import Field, Record
from itouch_thermal import ThermalDisplay
from itouch_thermal.chip.line import SimulatedLine
from itouch_thermal.chip.program import Built
from itouch_thermal.display.params import DisplayParams, Mismatch
from itouch_thermal.drivers import LinePort
from itouch_thermal.drivers.emulator import DisplayEmulator
from itouch_thermal.drivers.lineport import seal, seal_2, unseal_2
from itouch_thermal.drivers.virtual import Plate

PARAMS = DisplayParams(
    seebeck=0.052, resistance=1.95, conductance=0.54, line=LinePort(port="/nowhere", baud=250000, firmware="reference")
)


def course(line: SimulatedLine, amps: list[float]) -> list[float]:
    """Order currents every 10 ms; return the current of every millisecond."""
    line.open()
    try:
        greeting, _ = line.take(seal("?"), 0.0)
        assert unseal_2(greeting.rstrip(b"\n")) is not None
        found = []
        for time in range(10 * len(amps)):
            data = seal_2(f"I {time // 10} {amps[time // 10]:.5f}") if time % 10 == 0 else b""
            said, current = line.take(data, 1e-3 * (time + 1))
            assert bool(said) == bool(data), "a whole line is answered at once, and nothing is said unasked"
            found.append(current)
    finally:
        line.close()
    return found


def test_what_the_chip_does_depends_on_no_clock(program: Built) -> None:
    amps = [0.0] * 8 + [1.0] * 12 + [-0.5] * 10
    first, again = (course(SimulatedLine(PARAMS, Plate(plate=296.15, sink=299.15)), amps) for _ in range(2))
    assert first == again
    assert first[195] == pytest.approx(1.0, abs=0.02)
    assert first[295] == pytest.approx(-0.5, abs=0.02)
    assert max(abs(a) for a in first[:75]) < 0.02


def test_an_emulator_with_the_reference_program_lives(program: Built, tmp_path: Path) -> None:
    from dataclasses import replace

    params = replace(PARAMS, line=replace(PARAMS.line, port=f"{tmp_path}/port"))
    emulator = DisplayEmulator(params)
    assert emulator.free_running
    assert not DisplayEmulator(replace(params, line=LinePort(port="x"))).free_running
    reads, commands = ThermalDisplay.channels(params)
    reading, command = (Record.of(Field(c.name, "f8", c.size) for c in side) for side in (reads, commands))
    reading["plate_temperature"], reading["sink_temperature"] = 296.15, 297.15
    assert "simulated chip" in emulator.open()
    try:
        for time in range(30):
            assert not emulator.serve(1e-3 * time, reading, command)
        assert command["current"].item() == pytest.approx(0.0, abs=1e-3)
    finally:
        emulator.close()


def test_the_twin_behind_a_chip_need_not_have_its_delay_too() -> None:
    DisplayParams(delay=4e-3, mismatch=Mismatch(delay=-4e-3))
    with pytest.raises(ValueError, match="more than the delay"):
        DisplayParams(delay=4e-3, mismatch=Mismatch(delay=-5e-3))
