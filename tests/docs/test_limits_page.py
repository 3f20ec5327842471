"""The page of the safety limits says the numbers that the program holds."""

from __future__ import annotations

import re

import pytest
from listings import DOCS

from itouch.loop.engine import Engine
from itouch.monitors import thresholds
from itouch.plugin import Role
from itouch.scene import rigs
from itouch.servo.handle import Handle
from itouch.world import limits as has
from itouch_tools.cli.explain import examples

PAGE = (DOCS / "reference" / "safety-limits.md").read_text(encoding="utf-8")


def celsius(kelvin: float) -> str:
    return f"{kelvin - 273.15:g} °C"


#: Number of a row and a word of it -> what must stand in it, in this order.
ROWS = {
    ("T1", "high"): [celsius(value[1]) for value in (has.PLATE_TEMPERATURE, has.PLATE_TRIP, has.PLATE_ABSOLUTE)],
    ("T2", "low"): [celsius(value[0]) for value in (has.PLATE_TEMPERATURE, has.PLATE_TRIP, has.PLATE_ABSOLUTE)],
    ("T3", "dose"): [celsius(thresholds.DOSE_FROM), f"{has.DOSE_WARNING / 60:g} CEM43", f"{has.DOSE / 60:g} CEM43"],
    ("T4", "contact"): [f"{has.CONTACT_TIME:g} s", f"{has.CONTACT_TIME_LONGEST:g} s", f"{has.CONTACT_TIME_TRIP:g} s"],
    ("T4c", "below"): [celsius(has.COLD_FROM), f"{has.COLD_TIME:g} s", celsius(has.COLD_ABSOLUTE)],
    ("T5", "rate"): [f"{has.PLATE_RATE:g} K/s", f"{2 * has.PLATE_RATE:g} K/s"],
    ("T6", "flux"): [f"{has.FLUX / 1e3:g} kW/m²", f"{has.FLUX / 1e3 * 4 / 3:g} kW/m²"],
    ("T7", "sink"): [celsius(value) for value in (has.SINK, has.SINK_TRIP, has.SINK_ABSOLUTE)],
    ("T8", "sensors"): [f"step of {thresholds.STEP:g} K", f"same for {thresholds.FROZEN:g} s"],
    ("T9", "drive"): [
        f"{thresholds.RUNAWAY_DRIVE * 100:g} %", f"{thresholds.RUNAWAY_WRONG:g} K against", f"{thresholds.RUNAWAY_STILL:g} K",
        f"{thresholds.RUNAWAY_TIME:g} s",
    ],
    ("K1", "force of an arm"): [f"{has.FORCE:g} N"],
    ("K2", "speed"): [f"{has.ARM_SPEED:g} m/s", f"{has.ARM_SPEED_TRIP:g} m/s"],
    ("K3", "increase"): [f"{has.FORCE_SLEW:g} N/s", f"{has.RAMP:g} s"],
    ("K4", "plate"): [f"{value:g} N" for value in (has.PLATE_FORCE, has.PLATE_FORCE_TRIP, has.PLATE_FORCE_ABSOLUTE)],
    ("K5", "towards"): [f"{has.NEAR * 1e3:g} mm", f"{has.SPEED_NEAR:.2f} m/s", f"{has.SPEED_NEAR_TRIP:.2f} m/s"],
    ("K5", "otherwise"): [f"{has.SPEED:.2f} m/s", f"{has.SPEED_TRIP:.2f} m/s"],
    ("K6", "command"): [
        f"{has.TRACKING * 1e3:g} mm", f"{has.TRACKING_TRIP * 1e3:g} mm", f"{has.TRACKING_TIME * 1e3:g} ms",
    ],
    ("W1", "age"): [
        f"{has.WATCHDOG[Role.FORCE_ON_OPERATOR] * 1e3:g} ms arm", f"{has.WATCHDOG[Role.SURFACE_POSE] * 1e3:g} ms table",
        f"{has.WATCHDOG_OTHER * 1e3:g} ms thermal",
    ],
    ("W3", "hold"): [f"{has.HOLD * 1e3:g} ms"],
}  # fmt: skip


@pytest.mark.parametrize(("row", "wanted"), ROWS.items(), ids=str)
def test_a_row_says_what_holds(row: tuple[str, str], wanted: list[str]) -> None:
    number, word = row
    (line,) = [line for line in PAGE.splitlines() if line.startswith(f"| {number} |") and word in line]
    at = 0
    for value in wanted:
        found = re.compile(r"(?<![\d.])" + re.escape(value)).search(line, at)
        assert found, f"'{value}' is not in: {line}"
        at = found.end()


def test_what_is_told_to_users_of_the_switch_is_how_long_it_holds() -> None:
    told = f"{has.HOLD * 1e3:g} ms"
    assert told in str(Handle.hold.__doc__) and told in str(Engine.hold.__doc__)
    assert told in str(examples()["released"])


def test_a_rig_may_ask_for_no_longer_contact_than_the_default() -> None:
    assert rigs.CONTACT_TIME == has.CONTACT_TIME


def test_no_row_is_left_out() -> None:
    told = re.findall(r"^\| ([TKW]\dc?) \|", PAGE, flags=re.M)
    assert set(told) == {number for number, _ in ROWS} | {"W2", "W4"}  # deaths and re-arming have tests of their own
