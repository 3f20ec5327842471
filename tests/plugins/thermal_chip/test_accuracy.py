"""What the simulated chip's current and readings are worth: steps, ramp, accuracy, noise; the bridge's ripple."""

from __future__ import annotations

import pytest

from itouch_thermal.chip.display import REFERENCE
from itouch_thermal.chip.figures_of_merit import accuracy, flux_per_ampere, ripple, rise_time, staircase, steps
from itouch_thermal.chip.pins import KELVIN, at_pins
from itouch_thermal.chip.program import Built, config
from itouch_thermal.chip.simulated import Chip
from itouch_thermal.display.params import Mismatch
from itouch_thermal.drivers.lineport import seal, seal_2, unseal_2

from conftest import Start  # isort: skip


def test_the_mean_flux_goes_in_steps_of_15_at_most(start: Start) -> None:
    means = staircase(start(), count=8)
    assert steps(means) <= 15.0
    assert means[-1] - means[0] == pytest.approx(7e-3, abs=0.7e-3)
    assert sum(b > a for a, b in zip(means, means[1:], strict=False)) >= 6


@pytest.mark.parametrize("off", [Mismatch(), Mismatch(resistance=0.2, seebeck=-0.1), Mismatch(resistance=-0.2)])
def test_the_loop_holds_the_current_whatever_the_module(start: Start, off: Mismatch) -> None:
    from dataclasses import replace

    host = start(params=replace(REFERENCE, mismatch=off))
    assert accuracy(host) < 6e-3
    assert rise_time(host) < 0.06


def test_the_supply_may_sag(start: Start) -> None:
    host = start()
    host.hold(1.0, 0.3)
    host.display.supply = 10.0
    assert host.hold(1.0, 0.4)[-1].state == "ok"
    assert host.display.last.current == pytest.approx(1.0, abs=5e-3)


def test_readings_are_right(start: Start) -> None:
    host = start(begin=(301.15, 305.15))
    host.hold(0.0, 0.5)
    for _ in range(5):
        answer = host.order(0.0)
        assert answer is not None
        assert answer.plate == pytest.approx(host.display.plate - KELVIN, abs=0.15)
        assert answer.sink == pytest.approx(32.0, abs=0.1)
        assert abs(answer.current) < 2e-3


def test_ripple_and_its_heat() -> None:
    """By hand: a triangle of supply D (1 - D) T / L in the coils; what its capacitors leave is small at the module."""
    peak, heat = ripple(0.3, slices=500, periods=200)
    triangle = 12.0 * 0.3 * 0.7 * 50e-6 / 200e-6
    assert peak < 0.1 * triangle
    assert peak == pytest.approx(
        triangle * 0.1 / (REFERENCE.resistance + 0.1), rel=0.2
    )  # through the series resistance
    assert heat == pytest.approx(0.5 * peak**2 / 12.0 * REFERENCE.resistance / REFERENCE.area, rel=0.2)
    assert heat < 0.5
    assert flux_per_ampere() == pytest.approx(9.6e3, rel=0.02)


@pytest.mark.parametrize("after", range(2, 20, 3))
def test_the_flux_is_the_mean_of_the_20_ms_before_the_order_whenever_that_comes(program: Built, after: int) -> None:
    """A mean that is made at times of the chip's own is told twice to a host that asks more often."""
    chip = Chip(program)

    def run(milliseconds: int, flux: float, heard: bytes = b"") -> bytes:
        pins = at_pins(
            config(), plate=298.15, sink=298.15, guard=298.15, flux=flux, seebeck=REFERENCE.seebeck,
            resistance=REFERENCE.resistance,
        )  # fmt: skip
        return b"".join(chip.run(pins, heard if k == 0 else b"").said for k in range(milliseconds))

    run(100 + after, 0.0)  # another phase of whatever the program counts
    run(40, 0.0, seal("?"))
    run(after, 1000.0)
    answer = unseal_2(run(8, 1000.0, seal_2("I 1 0.0")))
    chip.close()
    assert answer is not None
    assert answer.startswith("R 1 ")
    heard = after + 1.0  # the order takes about a millisecond
    assert float(answer.split()[4]) == pytest.approx(1000.0 * heard / 20.0, abs=75.0)
