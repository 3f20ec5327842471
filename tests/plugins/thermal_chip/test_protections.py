"""Every protection of the reference display's program, seen at its pins: in simavr, with a plate behind them."""

from __future__ import annotations

import math
import random

import pytest

from itouch_thermal.chip.display import REFERENCE, plain
from itouch_thermal.chip.figures_of_merit import soak_limit, soak_peak
from itouch_thermal.chip.host import Answer, SimulatedHost
from itouch_thermal.chip.pins import KELVIN, thermistor
from itouch_thermal.chip.program import Built, built, config
from itouch_thermal.drivers.lineport import seal, seal_2
from itouch_thermal.drivers.stated_limits import StatedLimits, unmet_limits

from conftest import Start  # isort: skip

HOT = thermistor(353.15, config())
NUMBERS = config()


def driven(host: SimulatedHost, amps: float = 1.0) -> Answer:
    answer = host.hold(amps, 0.2)[-1]
    assert answer.state == "ok"
    assert answer.current == pytest.approx(amps, abs=0.02)
    assert host.display.last.current == pytest.approx(amps, abs=0.02)
    return answer


def off(host: SimulatedHost) -> bool:
    return host.display.last.enabled == 0.0 and abs(host.display.last.current) < 1e-3


@pytest.mark.parametrize(
    ("inputs", "volts", "state"),
    [
        (("plate",), HOT, "plate-hot"), (("guard",), HOT, "plate-hot"), (("plate", "guard"), HOT, "plate-hot"),
        (("plate",), thermistor(274.15, NUMBERS), "plate-cold"), (("sink",), HOT, "sink-hot"),
        (("plate",), 5.0, "plate-sensor"), (("plate",), 0.0, "plate-sensor"), (("guard",), 5.0, "plate-sensor"),
        (("sink",), 5.0, "sink-sensor"), (("sink",), 0.0, "sink-sensor"), (("current",), 5.0, "current"),
        (("guard",), thermistor(296.15 + 4.0, NUMBERS), "sensors-differ"),
    ],
)  # fmt: skip
def test_each_bad_measurement_cuts_the_current_off_and_latches(
    start: Start, inputs: tuple[str, ...], volts: float, state: str
) -> None:
    host = start()
    driven(host)
    host.display.forced = dict.fromkeys(inputs, volts)
    took = 0
    while not off(host):
        host.order(1.0, period=20)
        took += 20
        assert took <= 200
    answer = host.hold(2.0, 0.1)[-1]
    assert answer.state == state
    assert math.isnan(answer.plate) == (state == "plate-sensor" and "plate" in inputs)
    assert math.isnan(answer.sink) == (state == "sink-sensor")
    assert off(host)
    if state != "current":  # which no look at the temperatures can know to be over
        assert host.ask("C") == "E what has cut it off is not over"
    host.display.forced = {}
    host.wait(300)
    assert host.hold(2.0, 0.1)[-1].state == state, "it is latched"
    assert off(host)
    greeting = host.ask("C")
    assert greeting is not None
    assert StatedLimits.read(greeting).cut == "none"
    driven(host)


@pytest.mark.parametrize("how", ["reset", "brown-out", "power"])
def test_a_reset_takes_the_current_away_is_told_and_does_not_release(start: Start, how: str) -> None:
    host = start()
    driven(host)
    host.display.chip.reset(how)
    host.wait(5)
    assert off(host)
    host.wait(100)
    assert host.ask("I 1 1.0") == "E restarted: greet first"
    assert off(host)
    stated = StatedLimits.read(host.begin())
    assert stated.reset == how
    driven(host)
    host.display.forced["plate"] = HOT
    host.hold(1.0, 0.1)
    host.display.forced.clear()
    host.display.chip.reset(how)
    assert StatedLimits.read(host.begin()).cut == "plate-hot"
    assert host.hold(1.0, 0.2)[-1].state == "plate-hot"
    assert off(host)


@pytest.mark.parametrize("interrupts", [True, False])
def test_a_program_that_hangs_is_off_within_the_watchdogs_time(start: Start, interrupts: bool) -> None:
    host = start()
    driven(host, -1.0)
    host.display.chip.hang(interrupts=interrupts)
    took = 0
    while not off(host):
        host.wait(1)
        took += 1
        assert took <= 75
    assert took > 5, "it did hang"
    assert StatedLimits.read(host.begin()).reset == "watchdog"
    driven(host)


def test_a_converter_that_stops_is_noticed(start: Start) -> None:
    host = start()
    driven(host)
    host.display.chip.stop_converter()
    host.wait(10)
    assert off(host)
    assert host.order(1.0).state == "converter"  # type: ignore[union-attr]


def test_a_silent_host_cuts_the_current_off_without_a_latch(start: Start) -> None:
    host = start()
    driven(host, 2.0)
    host.wait(150)
    assert host.display.last.current > 1.9
    host.wait(100)
    assert off(host)
    driven(host, 2.0)  # nothing is latched: a host may be late


def test_only_an_order_feeds_the_watchdog_and_only_a_number_is_one(start: Start) -> None:
    host = start()
    for text in (
        "I 1", "I", "I 1 ", "I 1  1", "I 1 +1", "I 1 1.", "I 1 .5", "I 1 1e0", "I 1 nan", "I 1 inf", "I 1 1,0",
        "I 1 1.0 ", "I 1 0x1", "I 1 --1", "I 1 1.0000001", "I 256 1", "I -1 1", "I 1 12345", "I abc", "I 1 1.0x", "i 1 1",
    ):  # fmt: skip
        answer = host.ask(text)
        assert answer in ("E not a number", "E unknown command"), text
    for text in ("I 1 3.0001", "I 1 -3.1", "I 1 9999"):
        assert host.ask(text) == "E out of range"
    assert off(host)
    driven(host)
    for _ in range(30):
        host.ask("I 1 x")
        host.wait(6)
    assert off(host)
    assert host.ask("?" * 70) is None
    assert host.ask("I 1 3.0") is not None


def test_a_line_that_is_not_whole_is_no_order(start: Start) -> None:
    """The check sum is of 16 bits: of 3000 spoilt lines one in 65536 may pass, none here."""
    host = start()
    rng = random.Random(5)
    good = seal_2("I 7 3.00000")
    for _ in range(400):
        spoilt = bytearray(good)
        for _ in range(rng.randrange(1, 4)):
            spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
        host.display.step(bytes(spoilt) + b"\n")
        host.wait(3)
    host.display.step(seal("I 3.0"))  # version 1's sum is not enough
    host.wait(5)
    assert off(host)
    driven(host)


def test_the_current_changes_no_faster_than_its_slew(start: Start) -> None:
    host = start()
    host.hold(-2.5, 0.2)
    seen = []
    host.display.taps.append(lambda display: seen.append(display.last.current))
    host.hold(2.5, 0.2)
    fastest = max(b - a for a, b in zip(seen, seen[1:], strict=False)) / 1e-3
    assert 0.9 * NUMBERS["SLEW_A_PER_S"] < fastest < 2.2 * NUMBERS["SLEW_A_PER_S"]  # filter and module follow a ramp
    took = sum(-2.4 < amps < 2.4 for amps in seen) * 1e-3
    assert took == pytest.approx(4.8 / NUMBERS["SLEW_A_PER_S"], abs=0.01)


def test_near_a_limit_the_current_is_held_back_before_it_is_cut_off(start: Start) -> None:
    for amps, begin in ((-3.0, 311.15), (3.0, 286.15)):
        host = start(begin=(begin, 303.15))
        answers = host.hold(amps, 2.0)
        assert answers[-1].state == "held-back"
        assert 10.0 < host.display.plate - KELVIN < 43.0


def test_the_program_tells_its_limits(start: Start) -> None:
    host = start(greet=False)
    greeting = host.begin()
    assert greeting.startswith("N itouch-line 2 uno ")
    found = StatedLimits.read(greeting)
    assert found == StatedLimits(
        NUMBERS["MOST_A"], (NUMBERS["PLATE_COLD_C"], NUMBERS["PLATE_HOT_C"]), NUMBERS["SINK_HOT_C"],
        NUMBERS["SILENCE_MS"] * 1e-3, "power", "none",
    )  # fmt: skip
    assert unmet_limits(found, {"temperature": (288.15, 313.15), "current": 3.0}) == []


def test_the_sinks_limit_keeps_the_plate_below_45_whatever_the_fan_does() -> None:
    """Soak after a cut, from both hot limits: for good fans and a dead one; and the limit itself, found by halving."""
    for _, plate in soak_limit(NUMBERS):
        assert plate < 45.0
    dead = plain(REFERENCE)
    low, high = 43.0, 58.0
    for _ in range(8):
        middle = 0.5 * (low + high)
        hot = soak_peak(dead, NUMBERS["PLATE_HOT_C"] + KELVIN, middle + KELVIN, seconds=60.0)
        low, high = (middle, high) if hot < 318.15 else (low, middle)
    assert NUMBERS["SINK_HOT_C"] <= min(58.0, low), f"at most {low:.1f} degC"
    assert NUMBERS["PLATE_HOT_C"] <= 43.0
    assert NUMBERS["PLATE_COLD_C"] >= 10.0


def test_it_is_compiled_as_the_arduino_ide_does_it_too(start: Start) -> None:
    arduino = built(arduino=True)
    assert arduino.flash < 32256
    assert arduino.ram < 1024
    host = start(program=arduino)
    driven(host)
    host.wait(250)
    assert off(host)


def test_the_program_fits_into_flash_and_ram(program: Built) -> None:
    assert program.flash < 12_000
    assert program.ram < 1024
