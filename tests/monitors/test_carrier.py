"""A carried surface: T4, K4 to K6 and the sanity of its sensors, fed tick by tick; and the finger's speed, K2."""

from __future__ import annotations

import dataclasses
import math

import pytest
from small_devices import ARM, LIMITS, PERIOD, TABLE, Asked

from itouch.monitors import Arm, Surface, Trip, TripError
from itouch.plugin import Channel, Role, pose_target
from itouch.world.limits import DeviceLimits


class Table(Asked):
    """A surface whose sensors say what a test writes."""

    def __init__(
        self, limits: DeviceLimits = LIMITS, reads: slice = slice(None), command: Channel = TABLE[1][0]
    ) -> None:
        super().__init__(Surface, (TABLE[0][reads], (command,)), limits)
        assert isinstance(self.monitor, Surface)
        self.surface = self.monitor
        self.tick = 0
        self.moment.now = self.moment.time = -PERIOD

    def say(
        self, *, place: tuple[float, float, float] = (0.0, 0.0, 0.03), load: float = 0.0, tracking_error: float = 0.0,
        gap: float = 0.05, calibrated: bool = True, finger: tuple[float, float, float] = (0.0, 0.0, 0.0),
        side: float = 0.0, seconds: float = PERIOD,
    ) -> bool | None:  # fmt: skip
        self.reading["pose"][:3] = place
        if "wrench" in self.reading:
            self.reading["wrench"][:3] = (side, 0.0, load)
        moment = self.moment
        moment.tracking_error, moment.gap, moment.calibrated, moment.finger = tracking_error, gap, calibrated, finger
        self.check(seconds)
        self.tick += 1
        if self.state["looked"].item() != moment.now:
            return None
        found = self.surface.count(self.state, moment.now, moment.touched)
        if found < 0.0:
            raise TripError(Trip(int(-found)), self.surface.sentence(int(-found), self.state, self.reading, moment))
        return moment.touched

    @property
    def withdrawn(self) -> int:
        return int(self.state["withdrawn"])

    def follow(self, target: float, lifted: bool) -> float:
        return self.surface.follow(self.state, target, lifted)

    def until_trip(
        self, ticks: int, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0), **what: float
    ) -> tuple[Trip, float]:
        """Return the trip and the time [s] after which it came."""
        begin = self.tick
        for index in range(ticks):
            x, y, z = (part * index * PERIOD for part in velocity)
            try:
                self.say(place=(x, y, 0.03 + z), **what)  # type: ignore[arg-type]
            except TripError as error:
                self.words = str(error)
                return error.trip, (self.tick - begin + 1) * PERIOD
        return Trip.NONE, ticks * PERIOD


def test_a_surface_far_from_its_command_for_long_trips() -> None:
    surface = Table()
    trip, after = surface.until_trip(200, tracking_error=0.0051)
    assert (trip, after) == (Trip.TRACKING, pytest.approx(0.101))
    assert surface.words == "is 5.1 mm from its command"
    assert Table().until_trip(200, tracking_error=0.005)[0] is Trip.NONE


def test_coming_back_to_the_command_counts_anew() -> None:
    surface = Table()
    for _ in range(3):
        for _ in range(100):
            surface.say(tracking_error=0.006)
        surface.say(tracking_error=0.004)
        assert surface.state["strayed_for"].item() == 0.0


def test_the_plate_presses_with_five_newton_at_most() -> None:
    for load, trips in ((5.01, True), (-5.01, True), (4.99, False)):
        surface = Table()
        trip, after = surface.until_trip(5, load=load, gap=-0.001)
        assert trip is (Trip.PLATE_FORCE if trips else Trip.NONE)
        assert not trips or (after == pytest.approx(PERIOD) and surface.words == "presses with 5.0 N")
    tight = Table(dataclasses.replace(LIMITS, plate_force=1.0))
    assert tight.until_trip(5, load=2.51, gap=-0.001)[0] is Trip.PLATE_FORCE
    assert Table(dataclasses.replace(LIMITS, plate_force=1.0)).until_trip(5, load=2.49)[0] is Trip.NONE


def test_whether_it_is_touched_is_said_every_ten_milliseconds() -> None:
    surface = Table()
    said = [surface.say(load=0.06, gap=-0.001) for _ in range(25)]
    assert [index for index, touched in enumerate(said) if touched is not None] == [0, 10, 20]
    assert all(said[index] is True for index in (0, 10, 20))


@pytest.mark.parametrize(
    ("load", "gap", "calibrated", "touched"),
    [
        (0.051, 0.05, True, True), (-0.051, 0.05, True, True), (0.031, 0.05, True, True), (0.029, 0.05, True, False),
        (0.0, 0.00019, True, True), (0.0, 0.00021, True, False), (0.0, 0.00019, False, False), (0.0, -0.002, True, True),
    ],
)  # fmt: skip
def test_a_touch_is_felt_or_seen(load: float, gap: float, calibrated: bool, touched: bool) -> None:
    assert Table().say(load=load, gap=gap, calibrated=calibrated) is touched


def test_without_a_force_sensor_a_touch_is_seen() -> None:
    surface = Table(reads=slice(0, 1))
    assert surface.say(gap=0.05) is False
    for _ in range(9):
        surface.say(gap=0.05)
    assert surface.say(gap=-0.001) is True


def test_a_long_contact_withdraws_the_plate_until_the_finger_lifts() -> None:
    surface = Table(dataclasses.replace(LIMITS, contact_time=0.1))
    for _ in range(90):
        surface.say(load=1.0, gap=-0.001)
        assert surface.follow(0.03, False) == 0.03
    for _ in range(30):
        surface.say(load=1.0, gap=-0.001)
    assert surface.withdrawn == 1
    assert surface.follow(0.03, False) == 0.0
    assert surface.follow(0.03, True) == 0.0  # its clock has not fallen to half of the clamp
    for _ in range(70):
        surface.say()
    assert surface.follow(0.03, False) == 0.0
    assert surface.follow(0.03, True) == 0.03
    assert surface.withdrawn == 0
    assert surface.follow(0.03, False) == 0.03


def test_a_plate_that_does_not_get_away_trips() -> None:
    limits = dataclasses.replace(LIMITS, contact_time=0.1)
    surface = Table(limits)
    trip, after = surface.until_trip(1000, load=1.0, gap=-0.001)
    assert (trip, after) == (Trip.CONTACT_TIME, pytest.approx(0.611, abs=0.0101))
    assert surface.words == "has been touched for 0.6 s"
    assert surface.withdrawn == 1


def test_the_contact_time_is_ten_seconds_unless_the_scene_says_otherwise() -> None:
    surface = Table(dataclasses.replace(LIMITS, contact_time=None))
    surface.say(load=1.0)
    surface.state["contact_time"][...] = 9.985
    surface.say(load=1.0, seconds=0.01)
    assert surface.withdrawn == 0
    surface.say(load=1.0, seconds=0.01)
    assert surface.withdrawn == 1
    surface.state["contact_time"][...] = 59.995
    with pytest.raises(TripError, match=r"60.0 s"):
        surface.say(load=1.0, seconds=0.01)


def test_the_clock_falls_out_of_touch_as_fast_as_it_rises_in_touch() -> None:
    surface = Table()
    for load in (1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0):
        for _ in range(100):
            surface.say(load=load, gap=0.001)
    assert surface.state["contact_time"].item() == 0.0
    for _ in range(2000):
        surface.say(load=1.0, gap=0.0)
    for _ in range(500):
        surface.say()
    assert surface.state["contact_time"].item() == pytest.approx(1.5, abs=0.021)


@pytest.mark.parametrize(("on", "off"), [(1.0, 0.011), (9.9, 0.02), (0.5, 0.1)])
def test_tapping_does_not_get_past_the_clock(on: float, off: float) -> None:
    surface, longest = Table(), 0.0
    for _ in range(round(30.0 / (on + off))):
        for seconds, load in ((on, 1.0), (off, 0.0)):
            for _ in range(round(seconds / 0.01)):
                surface.say(load=load, gap=0.001, seconds=0.01)
                longest = max(longest, surface.state["contact_time"].item())
    assert surface.withdrawn == 1  # a finger that follows is told by the trip
    assert longest > 10.0


def test_forty_newton_sideways_or_a_torque_trip() -> None:
    surface = Table()
    assert surface.until_trip(5, side=40.0)[0] is Trip.PLATE_FORCE
    surface = Table()
    surface.reading["wrench"][4] = 0.51
    assert surface.until_trip(5)[0] is Trip.PLATE_FORCE


def test_a_plate_does_not_slide_past_a_finger_that_touches_it() -> None:
    surface = Table()
    trip, after = surface.until_trip(100, (0.24, 0.0, 0.0), load=1.0, gap=-0.001)
    assert (trip, after) == (Trip.SURFACE_SPEED, pytest.approx(0.061, abs=0.011))
    assert surface.words == "slides past the finger at 0.24 m/s"
    follows = Table()
    for index in range(200):
        follows.say(place=(0.24e-3 * index, 0.0, 0.03), finger=(0.24e-3 * index, 0.0, 0.03), load=1.0, gap=-0.001)
    still = Table()
    for index in range(200):  # the finger strokes a plate that stands
        still.say(finger=(0.5e-3 * index, 0.0, 0.03), load=1.0, gap=-0.001)


def test_a_runaway_surface_trips() -> None:
    for velocity in ((0.31, 0.0, 0.0), (0.0, -0.31, 0.0), (0.0, 0.0, -0.31), (0.22, 0.22, 0.0), (0.0, 0.22, 0.22)):
        surface = Table()
        trip, after = surface.until_trip(100, velocity)
        assert (trip, after) == (Trip.SURFACE_SPEED, pytest.approx(0.051))
        assert surface.words == "moves at 0.31 m/s"
    for velocity in ((0.29, 0.0, 0.0), (0.2, 0.2, 0.0)):
        assert Table().until_trip(200, velocity)[0] is Trip.NONE


def test_closing_in_on_a_near_finger_is_slower() -> None:
    surface = Table()
    trip, after = surface.until_trip(100, (0.0, 0.0, 0.16), gap=0.0199)
    assert (trip, after) == (Trip.SURFACE_SPEED, pytest.approx(0.051))
    assert surface.words == "closes in on the finger at 0.16 m/s"
    assert Table().until_trip(200, (0.0, 0.0, 0.14), gap=0.0199)[0] is Trip.NONE
    assert Table().until_trip(200, (0.0, 0.0, 0.16), gap=0.0201)[0] is Trip.NONE
    assert Table().until_trip(200, (0.0, 0.0, -0.25), gap=0.0)[0] is Trip.NONE


def test_a_moment_of_speed_is_not_a_runaway() -> None:
    surface = Table()
    for tick in range(200):
        surface.say(place=(0.012 * (tick % 20 < 10), 0.0, 0.03))


def test_a_pause_is_not_a_jump() -> None:
    surface = Table()
    for _ in range(100):
        surface.say()
    for index in range(100):
        surface.say(place=(0.1, 0.0, 0.01), seconds=PERIOD if index else 1.0)


@pytest.mark.parametrize("seconds", [0.007, 0.02, 0.023])
def test_a_slow_device_is_measured_by_its_times(seconds: float) -> None:
    for speed, trips in ((0.31, True), (0.29, False)):
        surface, tripped = Table(), False
        try:
            for index in range(20):
                surface.say(place=(speed * seconds * index, 0.0, 0.03), seconds=seconds)
        except TripError as error:
            tripped = error.trip is Trip.SURFACE_SPEED
        assert tripped is trips


def test_a_force_without_a_finger_is_doubted() -> None:
    surface = Table()
    trip, after = surface.until_trip(200, load=0.51, gap=0.0041)
    assert (trip, after) == (Trip.SENSOR_DISAGREE, pytest.approx(0.101, abs=0.0101))
    assert surface.words == "feels 0.5 N with the finger 4 mm away: one of the sensors must be wrong"
    for what in ({"load": 0.49, "gap": 0.05}, {"load": 0.51, "gap": 0.0039}):
        assert Table().until_trip(300, **what)[0] is Trip.NONE
    assert Table().until_trip(300, load=0.51, gap=0.0151, calibrated=0)[0] is Trip.SENSOR_DISAGREE
    assert Table().until_trip(300, load=0.51, gap=0.0149, calibrated=0)[0] is Trip.NONE


def test_a_short_doubt_about_the_force_does_not_trip() -> None:
    surface = Table()
    for _ in range(5):
        for _ in range(90):
            surface.say(load=1.0, gap=0.03)
        for _ in range(10):
            surface.say(load=0.0, gap=0.03)


def test_the_closing_speed_depends_on_gap_and_tracking_error() -> None:
    surface = Table().surface
    assert surface.closing(0.0199, 0.0) == 0.10
    assert surface.closing(0.0201, 0.0) == 0.25
    assert surface.closing(0.05, 0.0031) == 0.0
    assert surface.closing(0.05, 0.0029) == 0.25
    bare = Table(dataclasses.replace(LIMITS, speed=None, speed_near=None)).surface
    assert bare.closing(0.0, 0.0) == bare.closing(1.0, 0.0) == 0.0


def test_forgetting_keeps_the_contact_time_and_clears_the_rest() -> None:
    surface = Table(dataclasses.replace(LIMITS, contact_time=0.01))
    for _ in range(50):
        surface.say(load=1.0, gap=0.03, tracking_error=0.006)
    surface.forget()
    for name in ("strayed_for", "doubted", "places"):
        assert surface.state[name].item() == 0, name
    assert surface.state["contact_time"].item() > 0.0  # what a finger has got it keeps
    assert surface.withdrawn == 1


def test_all_that_it_remembers_is_state() -> None:
    first, second = Table(), Table()
    for index in range(137):
        first.say(
            place=(0.0001 * index, 0.0, 0.03), load=0.3 * (index % 7 > 2), tracking_error=0.006 * (index % 90 > 3)
        )
    second.state.raw[:] = first.state.raw
    second.moment.now, second.moment.time = first.moment.now, first.moment.time
    for index in range(60):
        for surface in (first, second):
            surface.say(place=(0.0137 - 0.0001 * index, 0.0, 0.03), load=0.3, tracking_error=0.006 * (index > 3))
    assert first.state.tobytes() == second.state.tobytes()


def fade(*velocity: float) -> float:
    arm = Asked(Arm, ARM)
    arm.moment.speed = math.hypot(*velocity)
    return arm.check()


def test_forces_fade_where_the_finger_is_fast() -> None:
    assert fade(0.0, 0.0, 0.0) == fade(0.79, 0.0, 0.0) == fade(0.46, -0.46, 0.46) == 1.0
    assert fade(0.0, 1.0, 0.0) == pytest.approx(0.5)
    assert fade(0.0, 0.0, -1.1) == pytest.approx(0.25)
    assert fade(1.2, 0.0, 0.0) == pytest.approx(0.0)
    assert fade(0.6, 0.6, 0.6) == pytest.approx((1.2 - 0.6 * math.sqrt(3)) / 0.4)
    for fast in ((1.21, 0.0, 0.0), (0.0, -1.21, 0.0), (0.7, 0.7, 0.75), (math.nan, 0.0, 0.0)):
        with pytest.raises(TripError, match=r"moves at (1.2[1-9]|nan) m/s") as caught:
            fade(*fast)
        assert caught.value.trip is Trip.SPEED


def test_what_was_sent_beyond_the_limit_trips() -> None:
    arm = Asked(Arm, ARM)
    arm.sent["wrench"] = (0.0, 0.0, 3.0, 0.0, 0.0, 0.0)
    assert arm.check() == 1.0
    arm.sent["wrench"] = (0.0, 2.0, 3.0, 0.0, 0.0, 0.0)
    with pytest.raises(TripError, match=r"was sent 3.6 N"):
        arm.check()


def test_exactly_at_a_limit_nothing_happens() -> None:
    assert Table().surface.closing(0.05, 0.003) == 0.25
    assert Table().until_trip(5, load=5.0, gap=-0.001)[0] is Trip.NONE
    assert Table().until_trip(300, load=0.51, gap=0.004)[0] is Trip.NONE


def test_withdrawing_goes_to_the_end_of_the_travel() -> None:
    low = pose_target(low=(-0.1, -0.1, 0.007), high=(0.1, 0.1, 0.06), speed=0.3)
    endless = Channel("pose_target", 7, "m", safe=low.safe, role=Role.SURFACE_POSE)
    for channel, bottom in ((low, 0.007), (endless, 0.0)):
        table = Table(command=channel)
        table.state["withdrawn"][...] = 1
        assert table.follow(0.03, False) == bottom
