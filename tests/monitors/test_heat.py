"""Heat: T1 to T9 on one plate, fed sample by sample."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from small_devices import LIMITS, PLATE, Asked

from itouch.monitors import Heat, Trip, TripError, heat_kernels
from itouch.monitors.runaway_kernels import Look
from itouch.monitors.thresholds import FROZEN_DRIVE
from itouch.plugin import Channel, Role, current, heat_flux, plate_temperature, temperature, temperature_target
from itouch.world.limits import DeviceLimits

K0 = 273.15
STEP = 0.010


class Plate(Asked):
    """A plate whose sensors say what a test writes, checked every 10 ms."""

    def __init__(
        self,
        limits: DeviceLimits = LIMITS,
        channels: tuple[tuple[Channel, ...], tuple[Channel, ...]] = PLATE,
        touched: bool = False,
    ) -> None:
        super().__init__(Heat, channels, limits)
        self.moment.touched = touched
        self.count = 0

    def say(self, plate: float, *, sink: float = 25.0, flux: float = 0.0, drive: float = 0.0) -> None:
        """Check one sample: degC, degC, W/m2 and part of the limit of 2 A; each a little different."""
        self.count += 1
        self.reading["plate_temperature"] = K0 + plate + 1e-4 * (self.count % 2)
        if "sink_temperature" in self.reading:
            self.reading["sink_temperature"] = K0 + sink
        if "heat_flux" in self.reading:
            self.reading["heat_flux"] = flux
        if "current" in self.sent:
            self.sent["current"] = 2.0 * drive
        self.check(STEP)

    def until_trip(self, samples: int, temperature: float, rate: float = 0.0, **others: float) -> tuple[Trip, float]:
        """Return the trip and the time [s] after which it came; the plate changes by a rate [K/s]."""
        for index in range(samples):
            try:
                self.say(temperature + rate * STEP * index, **others)
            except TripError as error:
                self.words = str(error)
                return error.trip, (index + 1) * STEP
        return Trip.NONE, samples * STEP


@pytest.mark.parametrize(
    ("temperature", "share"),
    [(15.0, 1.0), (39.999, 1.0), (41.0, 0.5), (41.5, 0.25), (13.5, 0.5), (12.75, 0.25), (25.0, 1.0)],
)
def test_the_drive_is_cut_down_towards_the_trip(temperature: float, share: float) -> None:
    plate = Plate()
    for _ in range(3):
        plate.say(temperature)
    assert plate.share == pytest.approx(share, abs=1e-3)


@pytest.mark.parametrize(("temperature", "trips"), [(42.01, True), (41.99, False), (11.99, True), (12.01, False)])
def test_the_plate_trips(temperature: float, trips: bool) -> None:
    trip, _ = Plate().until_trip(3, temperature)
    assert trip is (Trip.PLATE_TEMPERATURE if trips else Trip.NONE)


def test_a_scene_that_tightens_moves_limit_and_trip() -> None:
    limits = dataclasses.replace(LIMITS, temperature=(291.15, 308.15))
    plate = Plate(limits)
    plate.say(36.0)
    assert plate.share == pytest.approx(0.5, abs=1e-3)
    assert Plate(limits).until_trip(1, 37.01)[0] is Trip.PLATE_TEMPERATURE
    assert Plate(limits).until_trip(1, 14.99)[0] is Trip.PLATE_TEMPERATURE
    assert Plate(dataclasses.replace(LIMITS, temperature=None)).until_trip(2, 41.9)[0] is Trip.NONE


@pytest.mark.parametrize(("rate", "start", "expected"), [(30.0, 36.0, 39.0), (-30.0, 18.0, 15.0)])
def test_a_fast_plate_trips_a_tenth_of_a_second_ahead(rate: float, start: float, expected: float) -> None:
    plate = Plate()
    trip, after = plate.until_trip(100, start, rate)
    assert trip is Trip.PLATE_TEMPERATURE
    assert start + rate * (after - STEP) == pytest.approx(expected, abs=0.31)
    assert "on its way to" in plate.words


def test_the_rate_is_that_of_the_last_fifty_milliseconds() -> None:
    plate = Plate()
    for index in range(20):
        plate.say(25.0 + 0.2 * index)
    for _ in range(5):
        plate.say(28.8)
    plate.say(31.2)  # 2.4 K in 50 ms: on its way to 36
    assert plate.share == 1.0
    with pytest.raises(TripError, match=r"33.3 degC, on its way to 42.3 degC"):
        plate.say(33.3)


def test_contact_rate_is_a_mean_over_half_a_second() -> None:
    plate = Plate(touched=True)
    for index in range(60):
        plate.say(20.0 + 15.0 * STEP * index)
    assert plate.share == pytest.approx(0.5, abs=1e-2)
    free = Plate()
    for index in range(60):
        free.say(20.0 + 15.0 * STEP * index)
    assert free.share == 1.0


def test_contact_rate_trips_at_twenty_kelvin_a_second_both_ways() -> None:
    for rate, start in ((21.0, 16.0), (-21.0, 38.0)):
        plate = Plate(touched=True)
        trip, after = plate.until_trip(60, start, rate)
        assert trip is Trip.PLATE_RATE
        assert after == pytest.approx(0.49, abs=0.02)
        assert "changes its plate by 20." in plate.words
    assert Plate(touched=True).until_trip(60, 20.0, 19.5)[0] is Trip.NONE
    limits = dataclasses.replace(LIMITS, plate_rate=2.0)
    assert Plate(limits, touched=True).until_trip(60, 20.0, 4.2)[0] is Trip.PLATE_RATE
    assert Plate(limits, touched=True).until_trip(60, 20.0, 3.8)[0] is Trip.NONE
    assert Plate(dataclasses.replace(LIMITS, plate_rate=None), touched=True).until_trip(60, 20.0, 19.5)[0] is Trip.NONE


def test_what_the_plate_did_before_the_touch_does_not_count() -> None:
    plate = Plate()
    for index in range(50):
        plate.say(20.0 + 20.0 * STEP * index)
    plate.moment.touched = bool(1)
    for _ in range(60):
        plate.say(29.8)
    assert plate.share == 1.0
    plate.moment.touched = bool(0)
    plate.say(29.8)
    assert np.isnan(plate.state["since"].item())


def test_the_mean_flux_of_a_second_cuts_down_and_trips() -> None:
    plate = Plate()
    assert plate.until_trip(100, 25.0, flux=19e3)[0] is Trip.NONE
    assert plate.share == 1.0  # not before a whole second is known
    plate.say(25.0, flux=-19e3)
    assert plate.share == pytest.approx(0.2, abs=1e-6)
    plate = Plate()
    trip, after = plate.until_trip(300, 25.0, flux=-20.1e3)
    assert (trip, after) == (Trip.FLUX, pytest.approx(1.01))
    assert "20.1 kW/m^2" in plate.words
    assert Plate().until_trip(300, 25.0, flux=19.9e3)[0] is Trip.NONE
    assert Plate().until_trip(300, 25.0, flux=20e3)[0] is Trip.FLUX  # a saturated sensor
    tight = dataclasses.replace(LIMITS, flux=3e3)
    assert Plate(tight).until_trip(300, 25.0, flux=4.1e3)[0] is Trip.FLUX
    assert Plate(tight).until_trip(300, 25.0, flux=3.9e3)[0] is Trip.NONE
    assert Plate(dataclasses.replace(LIMITS, flux=None)).until_trip(300, 25.0, flux=19.9e3)[0] is Trip.NONE


def test_old_fluxes_are_forgotten_after_a_second() -> None:
    plate = Plate()
    for _ in range(90):
        plate.say(25.0, flux=19e3)
    for _ in range(100):
        plate.say(25.0, flux=1e3)
    assert plate.share == 1.0


def test_the_sink_cuts_the_drive_down() -> None:
    plate = Plate()
    for sink, share in ((50.0, 1.0), (52.5, 0.5), (55.0, 0.0), (57.0, 0.0), (20.0, 1.0)):
        plate.say(25.0, sink=sink)
        assert plate.share == pytest.approx(share)


def test_the_tightest_of_all_shares_counts() -> None:
    plate = Plate()
    plate.say(41.0, sink=51.25)
    assert plate.share == pytest.approx(0.5, abs=1e-3)
    plate.say(25.0, sink=51.25)
    assert plate.share == pytest.approx(0.75)


@pytest.mark.parametrize(("temperature", "seconds"), [(41.0, 120.0 * 16), (40.0, 120.0 * 64), (41.5, 960.0)])
def test_the_dose_of_a_touch_trips_after_two_equivalent_minutes(temperature: float, seconds: float) -> None:
    plate = Plate(touched=True)
    plate.say(temperature)
    first = plate.state["dose"].item()
    assert first == pytest.approx(STEP * 120.0 / seconds, rel=2e-3)
    plate.state["dose"][...] = 120.0 - 1.5 * first
    plate.say(temperature)
    with pytest.raises(TripError, match=r"2.00 CEM43") as caught:
        plate.say(temperature)
    assert caught.value.trip is Trip.DOSE


def test_above_43_degrees_a_degree_doubles() -> None:
    plate = Plate(touched=True)
    heat = plate.monitor
    assert isinstance(heat, Heat)
    for kelvin, dose in ((K0 + 44.0, 2.0), (K0 + 43.0, 3.0), (K0 + 42.0, 3.25)):
        assert heat_kernels.count(heat.allowed, heat.memory(plate.state), kelvin, Look(0.0, 0.0, STEP, True)) == 0.0
        assert plate.state["dose"].item() == pytest.approx(dose * STEP)


def test_no_dose_below_39_degrees_or_without_a_touch() -> None:
    plate = Plate(touched=True)
    plate.say(38.9)
    plate.moment.touched = bool(0)
    plate.say(41.0)
    assert plate.state["dose"].item() == 0.0
    plate.moment.touched = bool(1)
    plate.say(39.1)
    assert plate.state["dose"].item() > 0.0


def test_a_tightened_dose_trips_earlier() -> None:
    plate = Plate(dataclasses.replace(LIMITS, dose=1e-3), touched=True)
    trip, after = plate.until_trip(100, 41.0)
    assert trip is Trip.DOSE
    assert after == pytest.approx(0.02)
    plate = Plate(dataclasses.replace(LIMITS, dose=None), touched=True)
    plate.state["dose"][...] = 119.99
    assert plate.until_trip(5, 41.0)[0] is Trip.NONE


def test_a_step_that_no_plate_can_do_trips() -> None:
    for size, trips in ((5.2, True), (-5.2, True), (4.8, False), (-4.8, False)):
        plate = Plate(channels=((PLATE[0][0],), ()))
        start = 26.0 if size > 0.0 else 28.0
        for _ in range(12):
            plate.say(start)
        trip, after = plate.until_trip(20, start + size)
        assert trip is (Trip.SENSOR_JUMP if trips else Trip.NONE)
        assert not trips or (after == pytest.approx(0.06) and f"{size:+.1f} K" in plate.words)


def test_a_step_at_the_very_start_is_not_judged() -> None:
    plate = Plate()
    for _ in range(4):
        plate.say(20.0)
    assert plate.until_trip(10, 25.5)[0] is Trip.NONE


def frozen(plate: Plate, drives: list[float], reads: float = K0 + 25.0) -> tuple[Trip, float]:
    """Return the trip of a plate that reads exactly the same under these drives, and after what time."""
    for index, drive in enumerate(drives):
        plate.reading["plate_temperature"] = reads
        plate.reading["sink_temperature"] = K0 + 25.0
        plate.sent["current"] = 2.0 * drive
        try:
            plate.check(STEP)
        except TripError as error:
            assert "reads the same plate_temperature for" in str(error)
            return error.trip, index * STEP
    return Trip.NONE, len(drives) * STEP


def test_a_frozen_sensor_under_a_changing_drive_trips() -> None:
    assert frozen(Plate(), [0.0] + [0.05] * 300) == (Trip.SENSOR_FROZEN, pytest.approx(1.01, abs=0.011))
    assert frozen(Plate(), [0.0] + [-0.3] * 300) == (Trip.SENSOR_FROZEN, pytest.approx(FROZEN_DRIVE / 0.3, abs=0.021))
    assert frozen(Plate(), [0.3] + [0.0] * 300)[0] is Trip.SENSOR_FROZEN
    assert frozen(Plate(), [0.0] + [0.021] * 300)[0] is Trip.SENSOR_FROZEN
    assert frozen(Plate(), [0.0] + [0.019] * 300)[0] is Trip.NONE


def test_a_plate_in_balance_under_a_steady_drive_is_not_frozen() -> None:
    assert frozen(Plate(), [0.4] * 1000)[0] is Trip.NONE


def moved_then_frozen(
    rate: float, drive: float, *, seconds: float = 8.0, limits: DeviceLimits = LIMITS, wobble: float = 0.0
) -> tuple[Trip, float]:
    """Let a plate move by a rate [K/s] for a second and a half under a drive, then read the same; say what trips when."""
    plate = Plate(limits)
    for index in range(150):
        plate.say(25.0 + rate * STEP * index, drive=drive + wobble * ((index + 1) % 2))
    return frozen(plate, [drive] * round(seconds / STEP), plate.reading["plate_temperature"].item())


@pytest.mark.parametrize(("rate", "drive"), [(-1.5, 0.35), (1.5, -0.35), (-0.25, 0.11), (-4.0, 0.49)])
def test_a_moving_plate_does_not_stop_under_a_steady_drive(rate: float, drive: float) -> None:
    """Frozen in the middle of a steady drive of a third it was seen by nobody: the plate went to 6 degC."""
    trip, after = moved_then_frozen(rate, drive)
    assert trip is Trip.SENSOR_FROZEN
    assert after == pytest.approx(max(0.5, 1.0 / abs(rate)), rel=0.1, abs=0.03)


@pytest.mark.parametrize(("rate", "drive"), [(6.5, 0.05), (-6.5, 0.0), (9.0, -0.09)])
def test_a_fast_plate_does_not_stop_by_itself(rate: float, drive: float) -> None:
    """A driver stuck at full strength, then its sensor frozen: for 0.94 s nobody saw it, and the plate went to 64 degC."""
    trip, after = moved_then_frozen(rate, drive)
    assert trip is Trip.SENSOR_FROZEN
    assert after == pytest.approx(0.21, abs=0.011)


@pytest.mark.parametrize("rate", [6.0, 8.0, -8.0])
@pytest.mark.parametrize("digits", [1, 2])
def test_a_device_that_ramps_to_its_target_may_stop_there_at_once(rate: float, digits: int) -> None:
    """Stimulators ramp at 8 K/s to a temperature, tell it in tenths, and hold it: nothing is wrong with that."""
    plate = Plate(channels=((PLATE[0][0],), (temperature_target(),)))
    goal = 28.0 + 0.8 * rate
    for index in range(400):
        there = min(max(28.0 + rate * max(0.0, STEP * index - 0.5), min(28.0, goal)), max(28.0, goal))
        plate.reading["plate_temperature"] = K0 + round(there, digits)
        plate.sent["temperature_target"] = K0 + goal
        plate.check(STEP)


@pytest.mark.parametrize("rate", [6.0, -8.0])
def test_a_device_that_stops_on_its_way_to_its_target_has_a_frozen_sensor(rate: float) -> None:
    plate = Plate(channels=((PLATE[0][0],), (temperature_target(),)))
    with pytest.raises(TripError, match="reads the same plate_temperature for 0.2[01] s"):
        for index in range(400):
            plate.reading["plate_temperature"] = K0 + 28.0 + rate * min(0.6, STEP * index)
            plate.sent["temperature_target"] = K0 + 28.0 + 0.85 * rate
            plate.check(STEP)


def test_a_plate_that_may_stop_is_not_frozen() -> None:
    assert moved_then_frozen(4.5, 0.015, seconds=0.9)[0] is Trip.NONE
    for rate, drive, wobble in ((-0.19, 0.35, 0.0), (-1.5, 0.1, 0.0), (0.0, 0.35, 0.0), (-1.5, 0.35, 0.1)):
        assert moved_then_frozen(rate, drive, wobble=wobble)[0] is Trip.NONE
    assert moved_then_frozen(-1.5, 0.35, seconds=0.5)[0] is Trip.NONE


def test_a_drive_without_a_ceiling_is_no_less_steady_for_it() -> None:
    """Its limit of 5 A made every wobble five times as large: nothing was steady, and a frozen sensor not seen."""
    endless = (PLATE[0], (Channel("current", 1, "A", safe=(0.0,), role=Role.DRIVE),))
    plate = Plate(dataclasses.replace(LIMITS, current=5.0), endless)
    for index in range(150):
        plate.say(25.0 - 1.5 * STEP * index, drive=0.875 + 0.03 * ((index + 1) % 2))  # 1.75 to 1.81 A
    trip, after = frozen(plate, [0.875] * 100, plate.reading["plate_temperature"].item())
    assert trip is Trip.SENSOR_FROZEN
    assert after == pytest.approx(1.0 / 1.5, abs=0.05)


def test_a_tighter_current_makes_no_drive_less_steady() -> None:
    """What wobbles by less than 2 % of the hardware's drive is steady, whatever part of the limit that is."""
    tight = dataclasses.replace(LIMITS, current=0.8)
    assert moved_then_frozen(-1.5, 0.12, wobble=0.018)[0] is Trip.SENSOR_FROZEN
    assert moved_then_frozen(-1.5, 0.12, wobble=0.018, limits=tight)[0] is Trip.SENSOR_FROZEN


def test_a_reading_that_changes_is_not_frozen() -> None:
    plate = Plate()
    frozen(plate, [0.0] + [0.3] * 40)
    plate.say(25.01, drive=0.3)
    assert plate.state["frozen_for"].item() == 0.0
    assert plate.state["frozen_drive"].item() == 0.0
    assert frozen(plate, [0.3] * 300)[0] is Trip.NONE


def test_a_plate_that_goes_against_its_drive_has_run_away() -> None:
    for drive, rate in ((0.6, 10.0), (-0.6, -10.0)):
        plate = Plate()
        trip, after = plate.until_trip(100, 25.0, rate, drive=drive)
        assert trip is Trip.RUNAWAY
        assert after == pytest.approx(0.16 + 0.2, abs=0.03)
        assert "went 2." in plate.words
    for drive, rate in ((0.6, -5.0), (-0.6, 5.0), (0.5, 5.0)):
        assert Plate().until_trip(190, 25.0, rate, drive=drive)[0] in (Trip.NONE,)


def test_a_plate_that_does_not_follow_a_strong_drive_has_run_away_unless_it_is_touched() -> None:
    plate = Plate()
    trip, after = plate.until_trip(300, 25.0, drive=0.6)
    assert (trip, after) == (Trip.RUNAWAY, pytest.approx(2.0, abs=0.011))
    assert "did not follow its drive for 2.0 s" in plate.words
    assert Plate(touched=True).until_trip(500, 25.0, drive=0.6)[0] is Trip.NONE
    assert Plate().until_trip(500, 25.0, drive=0.5)[0] is Trip.NONE
    assert Plate().until_trip(350, 25.0, -0.1, drive=0.6)[0] is Trip.NONE


def test_a_drive_that_turns_round_begins_anew() -> None:
    plate = Plate()
    for index in range(600):
        plate.say(25.0, drive=0.6 if index // 150 % 2 else -0.6)
    for index in range(600):
        plate.say(25.0, drive=0.6 if index % 150 else 0.1)


def test_the_lag_of_drive_and_sensor_is_let_pass() -> None:
    plate = Plate()
    for index in range(12):
        plate.say(25.0 + 0.3 * index, drive=0.9)
    for index in range(100):
        plate.say(28.3 - 0.05 * index, drive=0.9)


def test_a_display_without_flux_sink_or_current() -> None:
    channels = ((plate_temperature(),), (temperature_target(safe=300.0),))
    plate = Plate(channels=channels)
    assert plate.until_trip(300, 25.0)[0] is Trip.NONE
    assert plate.share == 1.0
    endless = (PLATE[0], (Channel("current", 1, "A", safe=(0.0,), role=Role.DRIVE),))
    plate = Plate(dataclasses.replace(LIMITS, current=None), endless)
    plate.say(25.0, drive=0.2)  # 0.4 A of a ceiling of 1 A that nobody states
    assert plate.state["driven_for"].item() == 0.0
    plate.say(25.0, drive=0.3)
    assert plate.state["driven_for"].item() == pytest.approx(STEP)


def test_forgetting_keeps_the_dose_and_clears_the_rest() -> None:
    plate = Plate(touched=True)
    for _ in range(20):
        plate.say(41.0, drive=0.6)
    dose = plate.state["dose"].item()
    plate.forget()
    assert plate.state["dose"].item() == dose > 0.0
    assert plate.state["samples"].item() == 0
    assert plate.state["driven_for"].item() == 0.0
    assert np.isnan(plate.state["frozen"].item())


def test_where_the_plate_may_never_be() -> None:
    plate = Plate()
    for temperature_c, beyond in ((8.1, False), (7.9, True), (44.9, False), (45.1, True)):
        plate.reading["plate_temperature"] = K0 + temperature_c
        assert plate.monitor.beyond(plate.reading) is beyond
        assert plate.monitor.shown(plate.reading) == f"at {temperature_c} degC"
    plate.reading["plate_temperature"] = np.nan
    assert plate.monitor.beyond(plate.reading) is False
    assert plate.monitor.shown(plate.reading) == "not measured"


def test_all_that_it_remembers_is_state() -> None:
    first, second = Plate(touched=True), Plate(touched=True)
    generator = np.random.default_rng(1)
    samples = [(float(t), float(f), float(d)) for t, f, d in generator.normal((30, 1e3, 0), (0.2, 300, 0.3), (400, 3))]
    for plate, flux, drive in samples[:250]:
        first.say(plate, flux=flux, drive=drive)
    second.state.raw[:] = first.state.raw
    second.moment.now, second.moment.time = first.moment.now, first.moment.time
    second.count = first.count
    for plate, flux, drive in samples[250:]:
        first.say(plate, flux=flux, drive=drive)
        second.say(plate, flux=flux, drive=drive)
    assert first.state.tobytes() == second.state.tobytes()


def test_a_drive_is_measured_by_the_limit_in_force() -> None:
    plate = Plate(channels=(PLATE[0], (current(limit=1.0),)))
    plate.say(25.0, drive=0.3)  # 0.6 A of 1 A, which is less than the scene's 2 A
    assert plate.state["driven_for"].item() == pytest.approx(STEP)


@pytest.mark.parametrize("limit", [3.1, 1.0, 0.1])
def test_a_tighter_current_does_not_switch_the_runaway_off(limit: float) -> None:
    plate = Plate(dataclasses.replace(LIMITS, current=limit))
    trip, after = plate.until_trip(400, 25.0, 1.5, drive=0.6 * min(4.0, limit) / 2.0)
    assert (trip, after) == (Trip.RUNAWAY, pytest.approx(2.0 / 1.5 + 0.15, abs=0.12))


@pytest.mark.parametrize("seconds", [0.007, 0.02, 0.023, 0.05])
def test_windows_are_times_whatever_the_rhythm(seconds: float) -> None:
    plate = Plate(touched=True)
    plate.reading["sink_temperature"], plate.reading["heat_flux"] = K0 + 25.0, 18e3
    for index in range(round(0.5 / seconds) + 1):  # 15 K/s for half a second
        plate.reading["plate_temperature"] = K0 + 20.0 + 15.0 * seconds * index
        plate.check(seconds)
    assert plate.share == pytest.approx(0.5, abs=15.0 * seconds / 5.0)
    plate.moment.touched = False
    for index in range(round(1.1 / seconds)):
        plate.reading["plate_temperature"] = K0 + 25.0 + 1e-3 * (index % 2)
        plate.check(seconds)
    assert plate.share == pytest.approx(0.4, abs=1e-6)


def test_the_dose_runs_on_without_news() -> None:
    plate = Plate(touched=True)
    plate.say(41.0)
    before = plate.state["dose"].item()
    for _ in range(10):
        plate.check(STEP, fresh=False)
    assert plate.state["dose"].item() - before == pytest.approx(0.1 * 0.25**2, rel=1e-3)
    assert plate.state["samples"].item() == 1


def test_time_in_the_cold_is_used_up() -> None:
    plate = Plate(touched=True)
    trip, after = plate.until_trip(13000, 15.5)
    assert (trip, after) == (Trip.COLD, pytest.approx(120.0, abs=0.1))
    assert (
        plate.monitor.exhausted_budget(plate.state)
        == "has been touched for as long as a cold plate may be in a session"
    )
    plate.forget()
    assert plate.monitor.exhausted_budget(plate.state)
    warm = Plate(touched=True)
    assert warm.until_trip(13000, 16.1)[0] is Trip.NONE


def test_every_two_seconds_of_strong_drive_are_judged_anew() -> None:
    plate = Plate(touched=True)
    assert plate.until_trip(202, 28.0, -1.5, drive=0.6)[0] is Trip.NONE
    trip, after = plate.until_trip(190, 25.0, 1.5, drive=0.6)
    assert trip is Trip.RUNAWAY
    assert after == pytest.approx(2.0 / 1.5, abs=0.05)


def test_the_first_fifty_milliseconds_are_not_extrapolated() -> None:
    plate = Plate()
    for temperature_c in (25.0, 26.0, 27.0, 28.0, 29.0):
        plate.say(temperature_c)
    assert plate.share == 1.0
    with pytest.raises(TripError, match=r"34.0 degC, on its way to 52.0"):
        plate.say(34.0)


def test_exactly_at_the_absolute_limits_is_not_beyond() -> None:
    plate = Plate()
    for kelvin in (281.15, 318.15):
        plate.reading["plate_temperature"] = kelvin
        assert plate.monitor.beyond(plate.reading) is False


class OneOfTwo(Asked):
    """Two plates on one device, each with its sensors and its drive, asked by the monitor of one of them."""

    def __init__(self, index: int) -> None:
        reads = [
            one for name in ("left", "right")
            for one in (temperature(f"{name}_plate", Role.SKIN_CONTACT_TEMPERATURE), heat_flux(f"{name}_flux"))
        ]  # fmt: skip
        super().__init__(Heat, (tuple(reads), (current("left", limit=2.0), current("right", limit=2.0))), LIMITS, index)


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize(("wrong", "field", "value"), [(0, "left_plate", K0 + 42.5), (1, "right_plate", K0 + 42.5),
                                                       (0, "left_flux", 3e4), (1, "right_flux", 3e4)])  # fmt: skip
def test_of_two_plates_each_is_judged_by_its_own_sensors(index: int, wrong: int, field: str, value: float) -> None:
    plates = OneOfTwo(index)
    for name, said in (
        ("left_plate", K0 + 25),
        ("right_plate", K0 + 25),
        ("left_flux", 0),
        ("right_flux", 0),
        (field, value),
    ):
        plates.reading[name] = said
    if index == wrong:
        with pytest.raises(TripError):
            for _ in range(200):
                plates.check(STEP)
    else:
        assert [plates.check(STEP) for _ in range(200)] == [1.0] * 200
