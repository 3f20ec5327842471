"""The safe sequence: its order, how long it waits, and what it says of devices that are not safe."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from small_devices import ARM, LIMITS, PERIOD, PLATE, TABLE, Fake, FakeTwin, Supervised, model, state

from itouch.plugin import HOLD, RETRACT, Channel, DeviceError, Record, Role, pose_target
from itouch.plugin.timestamps import Timestamped
from itouch.safety import DeviceFaultError, Outcome, SafeSequence, Status, Trip
from itouch.safety.actuation import BACKWARDS, HELD
from itouch.safety.sequence import (
    AT_END,
    CLEAR,
    LEAVE_TIME,
    NEARER,
    SAFE_TIME,
    SETTLE,
    STANDS,
    STOOD,
    UNHEARD,
    WATCH_TIME,
    WRONG_WAY,
    _end,
)


class Line(Fake, Timestamped):
    """A device whose readings were measured so many ticks before they come."""

    behind = 0

    def measured(self, state: Record, tick: int, ticks: NDArray[np.int64]) -> None:
        ticks[...] = tick - self.behind


class Rig:
    """An arm, a table that carries a plate, and a display on it; the table obeys, and the finger follows for a while."""

    def __init__(self, *, twin: bool = False, table: object = TABLE, speed: float = 0.25) -> None:
        slow = dataclasses.replace(LIMITS, speed=speed)
        models = [
            model(ARM, name="arm"), model(table, name="table", twin=twin, limits=slow),  # type: ignore[arg-type]
            model(PLATE, name="plate", carrier="table"),
        ]  # fmt: skip
        self.state = state(*models)
        self.twin = FakeTwin()
        parts: list[dict[str, object]] = [{"device": Fake()}, {"device": Line()}, {"device": Fake()}]
        if twin:
            parts[1] = {"twin": self.twin}
        self.all = [
            Supervised(one, self.state, PERIOD, **part)  # type: ignore[arg-type]
            for one, part in zip(models, parts, strict=True)
        ]
        self.arm, self.table, self.plate = self.all
        self.height, self.load, self.temperature, self.own = 0.03, 1.0, 300.0, 300.0
        self.leaves_after, self.ticks = 0.005, 0
        self.obey: Callable[[float], None] = self.follow
        self.noise = True
        self.sent: list[tuple[float, float, float]] = []
        if self.arm.gate.device is not None and self.plate.gate.device is not None:
            self.arm.gate.device.read = self.say_arm  # type: ignore[method-assign]
            self.plate.gate.device.read = self.say_plate  # type: ignore[method-assign]
        if twin:
            self.twin.says = self.say_table
        elif self.table.gate.device is not None:
            self.table.gate.device.read = self.say_table  # type: ignore[method-assign]
        for one in self.all:
            one.lifecycle.reset()
            one.lifecycle.open()
            one.gate.read(0)
            one.lifecycle.enable()
        self.arm.sent["wrench"][0] = 1.0
        self.plate.sent["current"][0] = 1.5
        self.finger = 0.03
        self.sequence = SafeSequence([one.gate for one in self.all], self.state, PERIOD, self.move)

    def say_arm(self, reading: Record) -> bool:
        reading["pose"] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        return True

    def say_table(self, reading: Record) -> bool:
        reading["pose"] = (0.0, 0.0, self.height, 1.0, 0.0, 0.0, 0.0)
        if "plate_temperature" in reading:
            reading["plate_temperature"] = reading["sink_temperature"] = self.own
        if "wrench" in reading:
            reading["wrench"] = (0.0, 0.0, -self.load - 1e-6 * (self.ticks % 2) * self.noise, 0.0, 0.0, 0.0)
        return True

    def say_plate(self, reading: Record) -> bool:
        reading["plate_temperature"] = reading["sink_temperature"] = self.temperature
        return True

    def follow(self, goal: float) -> None:
        self.height = goal
        self.load = 1.0 if 0.03 - self.height < self.leaves_after else 0.0

    def move(self) -> None:
        self.ticks += 1
        self.sent.append((
            self.arm.sent["wrench"][0].item(), self.table.sent["pose_target"][2].item(),
            self.plate.sent["current"][0].item(),
        ))  # fmt: skip
        self.obey(self.table.sent["pose_target"][2].item())
        if self.twin.place is not None:
            self.twin.place[2] = self.height

    def stop(self, device: str, trip: Trip = Trip.TRACKING) -> Outcome:
        after: list[int] = []
        begin = self.state["tick"].item()

        def note() -> None:
            after.append(self.state["tick"].item())
            assert self.state["stopping"].item() == 1

        outcome = self.sequence.carry_out(DeviceFaultError(device, 0, trip, "has failed"), note)
        assert after == list(range(begin + 1, begin + len(after) + 1))
        assert self.state["stopping"].item() == 0
        assert 0.0 < outcome.seconds <= len(after) * PERIOD * (1.0 + 1e-9)  # safe by then; minded until all stands
        return outcome


def test_force_off_and_retract_at_once_the_plate_when_the_finger_has_left() -> None:
    rig = Rig()
    outcome = rig.stop("arm", Trip.SPEED)
    assert outcome.safe
    assert outcome.also == {}
    assert [force for force, _, _ in rig.sent] == [0.0] * len(rig.sent)
    drops = [height for _, height, _ in rig.sent]
    assert drops == pytest.approx([0.03 - 0.00025 * (n + 1) for n in range(len(drops))])
    left = next(n for n, (_, height, _) in enumerate(rig.sent) if 0.03 - height >= 0.005)
    assert [drive for _, _, drive in rig.sent] == [1.5] * (left + 1) + [0.0] * (len(rig.sent) - left - 1)
    assert rig.arm.latch.status is Status.FAULT
    assert rig.arm.latch.trip is Trip.SPEED
    assert rig.table.latch.status is rig.plate.latch.status is Status.OPEN
    assert outcome.devices["arm"] == "wrench off"
    assert outcome.devices["table"].startswith("retracted 5.")
    assert outcome.devices["plate"] == "current off, plate at 26.9 degC"
    assert outcome.seconds == pytest.approx(0.021, abs=0.002)


def test_a_plate_at_fault_is_cut_at_once() -> None:
    rig = Rig()
    assert rig.stop("plate", Trip.PLATE_TEMPERATURE).safe
    assert {drive for _, _, drive in rig.sent} == {0.0}
    assert rig.plate.latch.status is Status.FAULT


def test_a_finger_that_stays_is_waited_for_three_tenths_of_a_second() -> None:
    rig = Rig()
    rig.leaves_after = math.inf
    outcome = rig.stop("arm")
    kept = sum(drive == 1.5 for _, _, drive in rig.sent)
    assert kept * PERIOD == pytest.approx(LEAVE_TIME, abs=2 * PERIOD)
    assert not outcome.safe
    assert outcome.seconds == pytest.approx(SAFE_TIME)
    assert outcome.devices["table"].endswith(", still touched")
    assert not rig.plate.gate.actuation.keeping


def test_ticks_that_a_late_machine_leaves_out_are_waited_for_too() -> None:
    """What is waited for at most is over by the clock; what must have had its time has it in ticks that were run."""
    rig = Rig()
    rig.leaves_after = math.inf
    nothing = DeviceFaultError("arm", 0, Trip.TRACKING, "has failed")
    outcome = rig.sequence.carry_out(nothing, lambda: rig.sequence.leave_out(9))
    kept = sum(drive == 1.5 for _, _, drive in rig.sent)
    assert kept * 10 * PERIOD == pytest.approx(LEAVE_TIME, abs=20 * PERIOD)
    assert len(rig.sent) * PERIOD == pytest.approx(SAFE_TIME)
    assert outcome.seconds == pytest.approx(10 * SAFE_TIME)
    assert rig.stop("arm").seconds == pytest.approx(SAFE_TIME)  # the next one begins anew


def test_a_surface_that_does_not_go_is_told() -> None:
    rig = Rig()

    def stuck(goal: float) -> None:
        rig.load = 0.0

    rig.obey = stuck
    outcome = rig.stop("arm")
    assert not outcome.safe
    assert outcome.devices["table"] == "retracted only 0.0 mm"


def test_how_far_a_surface_came_that_is_stuck_is_said() -> None:
    rig = Rig()
    rig.obey = lambda goal: rig.follow(max(goal, 0.028))
    outcome = rig.stop("arm")
    assert not outcome.safe
    assert outcome.devices["table"] == "retracted only 1.7 mm, still touched"  # seen a period after it was told to go


def test_a_surface_at_the_end_of_its_travel_is_safe() -> None:
    rig = Rig()
    rig.height = rig.table.sent["pose_target"][2] = 0.0009
    rig.load = 0.0
    rig.table.gate.device_monitors.forget()
    rig.table.gate.read(1)
    rig.obey = lambda goal: None
    outcome = rig.stop("arm")
    assert outcome.safe
    assert outcome.devices["table"] == "retracted 0.0 mm"


def test_a_surface_that_goes_the_wrong_way_is_held_then_driven_back() -> None:
    rig = Rig()

    def reversed_drive(goal: float) -> None:
        rig.height = 0.06 - goal
        rig.load = 1.0 if rig.height > 0.025 else 0.0

    rig.obey = reversed_drive
    outcome = rig.stop("table")
    assert outcome.safe
    assert outcome.devices["table"] == "goes the wrong way: held 8.0 mm further back"
    highest = min(height for _, height, _ in rig.sent)
    assert highest == pytest.approx(0.03 - 0.0015, abs=5.1e-4)
    assert rig.table.gate.actuation.stopped is not None
    assert rig.table.gate.actuation.stopped.item() == 1
    held = [height for _, height, _ in rig.sent].count(highest)
    assert held * PERIOD == pytest.approx(0.05, abs=0.004)
    assert held == 52  # for more than 50 ms, and the tick in which it was seen


def test_one_that_turns_round_on_its_way_back_is_held_where_it_was_furthest() -> None:
    """Direction was minded by where the retreat began: a surface might come as far back as that, and 10 N at a finger."""
    rig = Rig()
    turned: list[tuple[float, float]] = []

    def turns(goal: float) -> None:
        if rig.ticks <= 24:
            rig.height = goal
            return
        turned.append((rig.height, goal))
        stood, asked = turned[0]
        rig.height = stood + (asked - goal)
        rig.load = 1.0 if rig.height > 0.02 else 0.0  # the finger has followed

    rig.obey = turns
    outcome = rig.stop("table")
    furthest = turned[0][0]
    assert furthest < 0.025
    assert max(height for height, _ in turned) < furthest + 0.0025
    assert rig.height < furthest + 0.0025
    assert outcome.safe
    assert outcome.devices["table"].startswith("goes the wrong way: held ")


def test_one_that_goes_the_wrong_way_untouched_is_only_held() -> None:
    rig = Rig()

    def reversed_drive(goal: float) -> None:
        rig.height, rig.load = 0.06 - goal, 0.0

    rig.obey = reversed_drive
    outcome = rig.stop("table")
    assert outcome.safe
    assert outcome.devices["table"].startswith("goes the wrong way: held -1.")
    assert rig.height < 0.0325


def test_what_is_still_being_driven_back_at_the_end_is_held_there() -> None:
    rig = Rig()

    def reversed_drive(goal: float) -> None:
        rig.height, rig.load = 0.06 - goal, 1.0

    rig.obey = reversed_drive
    outcome = rig.stop("table")
    assert not outcome.safe
    assert rig.table.gate.actuation.stopped is not None
    assert rig.table.gate.actuation.stopped.item() == 1


def test_a_second_fault_on_the_way_is_latched_and_told() -> None:
    rig = Rig()

    def broken(goal: float) -> None:
        rig.follow(goal)
        rig.temperature = math.nan

    rig.obey = broken
    outcome = rig.stop("arm")
    assert outcome.also == {"plate": "not-a-number"}
    assert rig.plate.latch.status is Status.FAULT
    assert outcome.devices["plate"] == "can't be verified: its sensors are not believed, or it does not answer"
    assert not outcome.safe


def test_a_device_that_fails_to_obey_does_not_stop_the_others() -> None:
    rig = Rig()
    assert isinstance(rig.plate.gate.device, Fake)
    rig.plate.gate.device.write_fails = OSError("gone")
    outcome = rig.stop("arm")
    assert outcome.also == {"plate": "device-error"}
    assert rig.height < 0.025


def test_hardware_that_is_not_believed_can_not_be_verified() -> None:
    for trip in (Trip.SENSOR_RANGE, Trip.DEVICE_ERROR, Trip.SENSOR_FROZEN):
        rig = Rig()
        rig.leaves_after = 0.0
        outcome = rig.stop("table", trip)
        assert not outcome.safe
        assert "can't be verified" in outcome.devices["table"]
        kept = sum(drive == 1.5 for _, _, drive in rig.sent)
        assert kept * PERIOD == pytest.approx(LEAVE_TIME, abs=2 * PERIOD)  # a sensor that lies ends no waiting


def slow_table(rig: Rig, silent: int, behind: int) -> None:
    """Let the table say nothing for so many ticks of the sequence, then what was true so many ticks before."""
    past = [(rig.height, rig.load)] * (behind + 1)
    assert rig.table.gate.device is not None
    device = rig.table.gate.device

    def read(reading: Record) -> bool:
        past.append((rig.height, rig.load))
        if rig.ticks <= silent:
            return False
        height, load = past[-1 - behind]
        reading["pose"] = (0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0)
        reading["wrench"] = (0.0, 0.0, -load - 1e-6 * (rig.ticks % 2), 0.0, 0.0, 0.0)
        return True

    device.read = read  # type: ignore[method-assign]
    device.behind = behind  # type: ignore[attr-defined]


@pytest.mark.parametrize("behind", [0, 7, 20])
@pytest.mark.parametrize("silent", [0, 20, 60])
def test_one_that_was_late_is_believed_when_it_answers_again(silent: int, behind: int) -> None:
    """A busy machine was late by a tick, and a reversed table then rose for half a second: it was not listened to."""
    rig = Rig()
    slow_table(rig, silent, behind)
    rig.obey = lambda goal: (setattr(rig, "height", 0.06 - goal), setattr(rig, "load", 0.0))[0]
    outcome = rig.stop("table", Trip.SILENT)
    assert outcome.devices["table"].startswith("goes the wrong way: held ")
    late = silent + 2 * behind  # it answers, then says what was measured since, then that it has come nearer
    assert rig.height < 0.03 + (late + 12) * 0.00025


@pytest.mark.parametrize("behind", [7, 20])
def test_what_a_late_wire_tells_of_the_time_before_says_nothing_of_the_retreat(behind: int) -> None:
    """It had risen while nothing was heard, as it should: that is no reason to hold it."""
    rig = Rig()
    slow_table(rig, 3, behind)
    rig.height, rig.load = 0.035, 0.0  # the last that was heard of it was 30 mm
    rig.table.sent["pose_target"][2] = 0.035
    outcome = rig.stop("table", Trip.SILENT)
    assert outcome.safe
    assert outcome.devices["table"].startswith("retracted ")


def test_one_that_never_answers_again_is_not_believed() -> None:
    rig = Rig()
    slow_table(rig, 10**6, 0)
    outcome = rig.stop("table", Trip.SILENT)
    assert not outcome.safe
    assert "can't be verified" in outcome.devices["table"]


def test_a_read_without_a_new_reading_is_not_judged() -> None:
    """A number that stands still because nothing has come is not frozen, and one that was bad is bad once."""
    rig = Rig()
    seen: list[int] = []
    rig.table.gate.device_monitors.believe = lambda tick, seconds: seen.append(tick)  # type: ignore[method-assign]
    assert rig.table.gate.device is not None
    rig.table.gate.device.read = lambda reading: False  # type: ignore[method-assign]
    assert not rig.table.gate.verify(5)
    assert not seen
    rig.table.gate.device.read = lambda reading: True  # type: ignore[method-assign]
    assert rig.table.gate.verify(6)
    assert seen == [6]
    rig.table.gate.fault(Trip.SPEED, 7)
    assert rig.table.gate.verify(8)
    assert seen == [6]


def test_the_true_place_of_a_twin_counts_where_its_sensors_lie() -> None:
    rig = Rig(twin=True)
    rig.twin.place = [0.0, 0.0, 0.03]
    outcome = rig.stop("table", Trip.NOT_A_NUMBER)
    assert outcome.safe
    assert outcome.seconds == pytest.approx(LEAVE_TIME, abs=2 * PERIOD)
    assert outcome.devices["table"].startswith("retracted 30.0 mm")


def test_a_twin_without_a_true_place_is_measured() -> None:
    rig = Rig(twin=True)
    assert rig.stop("arm").devices["table"].startswith("retracted 5.")


def test_a_reading_that_stands_still_is_not_believed() -> None:
    rig = Rig(twin=True)
    rig.twin.place = [0.0, 0.0, 0.03]
    frozen = {"height": rig.height, "load": rig.load}

    def say(reading: Record) -> bool:
        reading["pose"] = (0.0, 0.0, frozen["height"], 1.0, 0.0, 0.0, 0.0)
        reading["wrench"] = (0.0, 0.0, frozen["load"], 0.0, 0.0, 0.0)
        return True

    rig.twin.says = say
    outcome = rig.stop("arm")
    assert outcome.safe
    assert outcome.devices["table"].startswith("retracted 30.0 mm")


def test_without_a_force_sensor_the_finger_is_taken_to_leave() -> None:
    rig = Rig(table=((TABLE[0][0],), TABLE[1]))
    outcome = rig.stop("arm")
    assert outcome.safe
    assert outcome.devices["table"] == "retracted 3.0 mm"
    assert [drive for _, _, drive in rig.sent][:3] == [1.5, 0.0, 0.0]


@pytest.mark.parametrize(("load", "said"), [(0.0, "held where it is"), (1.0, "held where it is, still touched")])
def test_a_surface_whose_plugin_holds_it_is_held(load: float, said: str) -> None:
    holds = dataclasses.replace(TABLE[1][0], safe=HOLD)
    rig = Rig(table=(TABLE[0], (holds,)))
    rig.load = load
    rig.obey = lambda goal: None
    outcome = rig.stop("arm")
    assert outcome.devices["table"] == said
    assert outcome.safe is (load == 0.0)


@pytest.mark.parametrize("safe", [HOLD, RETRACT], ids=["held", "retracted"])
@pytest.mark.parametrize(("temperature", "safely"), [(300.0, True), (319.15, False)])
def test_a_surface_with_a_plate_of_its_own_is_safe_when_both_are(safe: Any, temperature: float, safely: bool) -> None:
    both = (
        (*TABLE[0], PLATE[0][0], PLATE[0][1]), (dataclasses.replace(TABLE[1][0], safe=safe), PLATE[1][0])
    )  # fmt: skip
    rig = Rig(table=both)
    rig.own = temperature
    rig.load = 0.0
    rig.obey = lambda goal: setattr(rig, "height", goal)
    outcome = rig.stop("arm", Trip.SPEED)
    assert outcome.safe is safely
    said = (
        "off, but the plate is at 46.0" if not safely else "held where it is, plate" if safe is HOLD else "retracted "
    )
    assert outcome.devices["table"].startswith(said)


@pytest.mark.parametrize(("until", "known"), [(300, False), (460, True)])
def test_what_has_not_answered_for_a_tenth_of_a_second_is_not_verified(until: int, known: bool) -> None:
    """The table does not obey, and all wait for half a second; meanwhile the arm falls silent."""
    rig = Rig()
    rig.obey = lambda goal: None
    rig.arm.gate.device.read = lambda reading: rig.ticks < until and rig.say_arm(reading)  # type: ignore[method-assign,union-attr]
    outcome = rig.stop("table")
    assert outcome.seconds == pytest.approx(SAFE_TIME, abs=2 * PERIOD)
    assert (outcome.devices["arm"] == "wrench off") is known
    assert outcome.devices["arm"].startswith("can't be verified") is not known


def test_a_surface_without_ends_retracts_nowhere() -> None:
    endless = Channel("pose_target", 7, "m", safe=TABLE[1][0].safe, role=TABLE[1][0].role)
    rig = Rig(table=(TABLE[0], (endless,)))
    rig.load = 0.0
    rig.obey = lambda goal: None
    outcome = rig.stop("arm")
    assert not outcome.safe
    assert outcome.devices["table"] == "retracted only 0.0 mm"


def test_a_plate_beyond_what_may_ever_be_is_not_safe() -> None:
    rig = Rig()
    for one in rig.all:
        one.latch.disable()
    rig.temperature = 318.5
    rig.plate.gate.device_monitors.forget()
    outcome = rig.stop("plate", Trip.PLATE_TEMPERATURE)
    assert not outcome.safe
    assert outcome.devices["plate"] == "off, but the plate is at 45.4 degC"


def test_a_command_that_stays_on_is_told() -> None:
    rig = Rig()
    rig.plate.gate.fault(Trip.FLUX, 0)
    rig.plate.gate.actuation.keeping = True
    rig.plate.sent["current"][0] = 0.5
    rig.sequence._carried = []
    outcome = rig.stop("arm")
    assert not outcome.safe
    assert outcome.devices["plate"] == "current is not off"


def test_a_device_that_only_reads_has_nothing_to_switch_off() -> None:
    one = model((ARM[0], ()), name="tracker")
    data = state(one)
    it = Supervised(one, data, PERIOD, device=Fake())
    it.lifecycle.open()
    sequence = SafeSequence([it.gate], data, PERIOD, lambda: None)
    outcome = sequence.carry_out(DeviceFaultError("tracker", 0, Trip.SPEED, "x"), lambda: None)
    assert outcome == Outcome(True, PERIOD, {"tracker": "nothing to switch off"}, {})


@pytest.mark.parametrize(
    "raised", [(KeyboardInterrupt(),), (OSError("full"), ValueError(), KeyboardInterrupt()), (OSError("full"),)]
)
@pytest.mark.parametrize("where", ["listener", "step", "judgement"])
def test_the_sequence_is_carried_out_whatever_is_raised_meanwhile(
    raised: tuple[BaseException, ...], where: str
) -> None:
    """By who listens, or by Ctrl-C anywhere: the stop was over then, with a finger pressed and a plate driven."""
    rig = Rig()
    left = list(raised)
    move, mind = rig.move, rig.sequence._mind_direction

    def fail() -> None:
        if left and rig.ticks > 2:
            raise left.pop(0)

    def moves() -> None:
        move()
        if where == "step":
            fail()

    def minds(heights: dict[str, float]) -> None:
        if where == "judgement":
            fail()
        mind(heights)

    rig.sequence._move, rig.sequence._mind_direction = moves, minds  # type: ignore[method-assign]
    outcome = rig.sequence.carry_out(
        DeviceFaultError("arm", 0, Trip.SPEED, "x"), fail if where == "listener" else lambda: None
    )
    assert rig.sequence.interrupted is (raised[0] if len(raised) == 1 else raised[2])
    assert outcome.safe
    assert outcome.devices["table"].startswith("retracted 5.")
    assert rig.sent[-1] == (0.0, rig.table.sent["pose_target"][2].item(), 0.0)
    assert rig.stop("arm").safe
    assert rig.sequence.interrupted is None


def test_a_sequence_in_which_each_tick_fails_ends() -> None:
    """Whoever paces it is called in each: 5000 ticks went by in no time, and no device had any to follow."""
    rig = Rig()
    calls, paced = [], list[int]()

    def fail() -> None:
        calls.append(0)
        raise OSError("full")

    rig.sequence._move = fail
    outcome = rig.sequence.carry_out(
        DeviceFaultError("arm", 0, Trip.SPEED, "x"), lambda: paced.append(rig.sequence._tick.item())
    )
    assert round(SAFE_TIME / PERIOD) <= len(calls) <= round(WATCH_TIME / PERIOD)
    assert paced == list(range(paced[0], paced[0] + len(calls)))
    assert not outcome.safe and not rig.plate.gate.actuation.keeping


def test_the_constants_of_the_sequence_are_those_of_the_safety_case() -> None:
    """As the safety case has them; what each does is tested by multiples of it, which a wrong one would not change."""
    assert (LEAVE_TIME, SAFE_TIME, WATCH_TIME) == (0.3, 0.5, 5.0)
    assert (STANDS, STOOD, NEARER, SETTLE) == (0.3e-3, 0.05, 3e-3, 0.05)
    for load, safe in ((0.09, True), (0.11, False)):
        rig = Rig()

        def pressed(goal: float, rig: Rig = rig, load: float = load) -> None:
            rig.height, rig.load = goal, load

        rig.obey = pressed
        assert rig.stop("arm").safe is safe
    for height, safe in ((0.0009, True), (0.001, True), (0.0015, False)):
        rig = Rig()
        rig.height, rig.load = height, 0.0
        rig.table.gate.device_monitors.forget()
        rig.table.gate.read(1)
        rig.obey = lambda goal: None
        assert rig.stop("arm").safe is safe


def test_a_second_sequence_begins_anew() -> None:
    rig = Rig()

    def reversed_drive(goal: float) -> None:
        rig.height, rig.load = 0.06 - goal, 0.0

    rig.obey = reversed_drive
    rig.stop("table")
    first = rig.sequence._begun["table"]
    rig.table.lifecycle.rearm(0)
    rig.height = 0.03
    rig.table.gate.device_monitors.forget()
    rig.table.gate.read(2)
    rig.table.lifecycle.enable()
    rig.obey, rig.ticks = rig.follow, 0
    outcome = rig.stop("table")
    assert outcome.safe
    assert outcome.seconds < 0.03
    assert rig.sequence._held_for == {}
    assert rig.sequence._begun["table"] != first


def test_only_what_is_carried_by_what_retracts_keeps_its_drive() -> None:
    rig = Rig()
    assert [one.model.name for one in rig.sequence._carried] == ["plate"]
    models = [model(PLATE, name="a", carrier="b"), model(ARM, name="b")]
    data = state(*models)
    both = [Supervised(one, data, PERIOD, device=Fake()) for one in models]
    assert SafeSequence([one.gate for one in both], data, PERIOD, lambda: None)._carried == []


@pytest.mark.parametrize(("every", "safe"), [(20, True), (10**9, False)])
def test_a_display_may_answer_now_and_then_but_must_not_fall_silent(every: int, safe: bool) -> None:
    """Over a wire a reading comes every 20 ms or so: that one is waited for; one that never comes is not safe."""
    rig = Rig()
    assert rig.plate.gate.device is not None

    def say(reading: Record) -> bool:
        return rig.say_plate(reading) and rig.ticks % every == every - 1

    rig.plate.gate.device.read = say  # type: ignore[method-assign]
    assert rig.stop("arm", Trip.SPEED).safe is safe


@pytest.mark.parametrize("behind", [7, 20])
def test_a_backlog_from_before_any_stop_says_nothing_of_the_retreat(behind: int) -> None:
    """An arm trips while a table behind a wire goes down; it then comes up: what arrives at first is its way down."""
    rig = Rig()
    slow_table(rig, 0, behind)
    rig.load = 0.0
    rig.obey = lambda goal: setattr(rig, "height", 0.06 - goal)
    outcome = rig.stop("arm", Trip.SPEED)
    assert outcome.devices["table"].startswith("goes the wrong way: held ")
    assert rig.height < 0.03 + (2 * behind + 12) * 0.00025


def test_readings_that_were_all_measured_before_the_stop_verify_nothing() -> None:
    rig = Rig()
    assert rig.table.gate.device is not None
    stuck = rig.state["tick"].item() - 1
    rig.table.gate.device.measured = lambda state, tick, ticks: ticks.__setitem__(Ellipsis, stuck)  # type: ignore[attr-defined]
    outcome = rig.stop("arm", Trip.SPEED)
    assert not outcome.safe
    assert outcome.devices["table"] == "not measured since it was told to retract"


def pushed(rig: Rig, way: Callable[[], float], lag: int = 0) -> None:
    """Let a table go up as it is told to go down where ``way`` is -1, and push the finger before it."""
    before = [rig.table.sent["pose_target"][2].item()]
    moves = [0.0] * lag

    def obey(goal: float) -> None:
        moves.append(way() * (goal - before[0]))
        before[0] = goal
        rig.height = min(0.06, max(0.0, rig.height + moves[-1 - lag]))
        rig.finger = max(rig.finger, rig.height)
        rig.load = 1.0 if rig.finger == rig.height else 0.0

    rig.obey = obey


@pytest.mark.parametrize("lag", [0, 5, 20])
def test_one_that_turns_round_again_while_it_is_driven_back_goes_down_after_all(lag: int) -> None:
    """Its drive is reversed when all stop, and not any more when it has been driven back for some time."""
    rig = Rig()
    pushed(rig, lambda: -1.0 if rig.ticks < 90 else 1.0, lag)
    outcome = rig.stop("arm", Trip.SPEED)
    assert outcome.safe
    assert outcome.devices["table"].startswith("retracted ")
    assert rig.finger < 0.04 + 0.00025 * lag


def test_one_that_turns_round_again_and_again_is_held() -> None:
    rig = Rig()
    pushed(rig, lambda: -1.0)
    ways = [1.0]

    def contrary() -> float:
        """Go up, whatever it is told."""
        assert rig.table.gate.actuation.stopped is not None
        ways[0] = 1.0 if rig.table.gate.actuation.stopped.item() == BACKWARDS else -1.0
        return ways[0]

    pushed(rig, contrary)
    outcome = rig.stop("arm", Trip.SPEED)
    assert not outcome.safe
    assert outcome.devices["table"].startswith("goes the wrong way: held -")
    assert rig.height < 0.06


def test_one_that_is_held_nearer_than_it_was_is_driven_back_though_no_force_is_felt() -> None:
    """Nobody touched it, and it stayed 5 mm nearer: a finger that comes next finds it there."""
    rig = Rig()
    slow_table(rig, 0, 20)  # what is heard of it is 20 ms old: 5 mm at 0.25 m/s
    rig.load = 0.0
    rig.obey = lambda goal: setattr(rig, "height", 0.06 - goal)
    outcome = rig.stop("arm", Trip.SPEED)
    assert outcome.devices["table"].startswith("goes the wrong way: held 8.")
    assert outcome.safe
    assert rig.height < 0.022


def test_one_that_stays_nearer_than_it_was_is_not_safe_though_no_force_is_felt() -> None:
    rig = Rig()
    slow_table(rig, 0, 20)
    rig.load = 0.0
    rig.obey = lambda goal: setattr(rig, "height", max(rig.height, min(0.034, 0.06 - goal)))  # it jams there
    outcome = rig.stop("arm", Trip.SPEED)
    assert outcome.devices["table"].startswith("goes the wrong way: held -3.")
    assert not outcome.safe


def test_what_was_found_of_a_surface_in_one_stop_is_over_in_the_next() -> None:
    """The arm stops all, and the table goes the wrong way; enabled again, and stopped by the arm, it obeys."""
    rig = Rig()
    rig.load = 0.0
    rig.obey = lambda goal: setattr(rig, "height", 0.06 - goal)
    assert rig.stop("arm", Trip.SPEED).devices["table"].startswith("goes the wrong way")
    rig.height, rig.load = 0.03, 1.0
    rig.obey = rig.follow
    for one in rig.all:
        one.gate.read(rig.state["tick"].item())
        one.lifecycle.rearm(rig.state["tick"].item())
        one.lifecycle.enable()
    outcome = rig.stop("arm", Trip.SPEED)
    assert outcome.safe
    assert outcome.devices["table"].startswith("retracted ")


def test_one_that_goes_wrong_twice_is_turned_twice_and_then_held() -> None:
    """As long as a third way is left it goes it: reversed at the stop, again when driven back, and obeying at last."""
    rig = Rig()
    turned = []

    def way() -> float:
        """Go up as long as it was not turned round so often."""
        assert rig.table.gate.actuation.stopped is not None
        now = rig.table.gate.actuation.stopped.item()
        if not turned or turned[-1] != now:
            turned.append(now)
        up_when_driven = 1.0 if now == BACKWARDS else -1.0
        return up_when_driven if turned.count(0) <= 2 else 1.0

    pushed(rig, way)
    outcome = rig.stop("arm", Trip.SPEED)
    assert turned.count(BACKWARDS) == 2
    assert turned.count(0) == 3
    assert outcome.devices["table"].startswith(("retracted", "goes the wrong way")), outcome


class Two(Rig):
    """A rig with a second table, both behind wires, that go up where they are told to go down."""

    def __init__(self, late: int) -> None:
        super().__init__()
        one = [model(TABLE, name=name) for name in ("first", "second")]
        self.state = state(*one)
        self.places = [0.03, 0.03]
        self.all = [Supervised(m, self.state, PERIOD, device=Line()) for m in one]
        for place, supervisor in enumerate(self.all):
            assert supervisor.gate.device is not None
            supervisor.gate.device.read = lambda reading, place=place: self.say(reading, place)  # type: ignore[method-assign,misc]
            supervisor.lifecycle.reset()
            supervisor.lifecycle.open()
            supervisor.gate.read(0)
            supervisor.lifecycle.enable()
        assert self.all[0].gate.device is not None
        self.all[0].gate.device.behind = late  # type: ignore[attr-defined]
        self.sequence = SafeSequence([one.gate for one in self.all], self.state, PERIOD, self.move)

    def say(self, reading: Record, place: int) -> bool:
        reading["pose"] = (0.0, 0.0, self.places[place], 1.0, 0.0, 0.0, 0.0)
        reading["wrench"] = (0.0, 0.0, -1e-6 * (self.ticks % 2), 0.0, 0.0, 0.0)
        return True

    def move(self) -> None:
        self.ticks += 1
        self.places = [0.06 - one.sent["pose_target"][2].item() for one in self.all]


def test_a_surface_of_which_nothing_new_is_known_keeps_no_other_from_being_minded() -> None:
    rig = Two(late=60)
    rig.stop("first", Trip.SPEED)
    assert rig.places[1] < 0.0325  # it is seen as soon as it rises, while the first is not yet heard of


@pytest.mark.parametrize(("stamp", "said"), [(-1, "not measured since it was told to retract"), (0, "retracted ")])
def test_what_was_measured_in_the_very_tick_of_the_stop_is_of_the_retreat(stamp: int, said: str) -> None:
    rig = Rig()
    assert rig.table.gate.device is not None
    stuck = rig.state["tick"].item() + stamp
    rig.table.gate.device.measured = lambda state, tick, ticks: ticks.__setitem__(Ellipsis, stuck)  # type: ignore[attr-defined]
    assert rig.stop("arm", Trip.SPEED).devices["table"].startswith(said)


def test_how_far_a_surface_was_driven_is_told_in_millimetres() -> None:
    rig = Rig()
    rig.height, rig.load = 0.03, 0.0
    rig.obey = lambda goal: None
    rig.height = 0.03
    for supervisor, stopped in rig.sequence._ways:
        stopped[...] = 1
        assert rig.sequence._seen_surface(supervisor, 0.0875)[0] == "goes the wrong way: held 57.5 mm further back"
        assert rig.sequence._seen_surface(supervisor, 0.7805)[0] == "goes the wrong way: held 750.5 mm further back"


def park(rig: Rig) -> Outcome:
    return rig.sequence.carry_out(DeviceFaultError("", 0, Trip.NONE, "ends"), lambda: None)


def test_a_surface_that_has_gone_back_and_still_feels_something_is_no_reason_not_to_rest() -> None:
    rig = Rig()
    rig.leaves_after = math.inf  # a finger that follows, or a sensor that is not at zero
    outcome = park(rig)
    assert (outcome.safe, outcome.unsafe) == (False, ())
    stuck = Rig()
    stuck.obey = lambda goal: None
    assert park(stuck).unsafe == ("table",)
    rising = Rig()
    rising.noise = False

    def up(goal: float) -> None:
        rising.height += 1e-4

    rising.obey = up
    assert park(rising).unsafe == ("table",)


def test_what_stands_at_its_end_and_reads_the_same_is_no_reason_not_to_rest() -> None:
    def still(height: float, *, silent: bool = False) -> Outcome:
        rig = Rig()
        rig.noise, rig.load = False, 0.0
        rig.height = rig.table.sent["pose_target"][2] = height
        rig.table.gate.device_monitors.forget()
        rig.table.gate.read(1)
        rig.obey = lambda goal: None
        assert rig.table.gate.device is not None
        if silent:
            rig.table.gate.device.read = lambda reading: False  # type: ignore[method-assign]
        return park(rig)

    assert still(0.0009).unsafe == ()
    assert still(0.0011).unsafe == ("table",)  # it had to move
    assert still(0.0009, silent=True).unsafe == ("table",)


def test_a_drive_that_is_on_and_a_fault_are_reasons_not_to_rest() -> None:
    rig = Rig()
    assert rig.plate.gate.device is not None

    def fails(command: Record) -> None:
        raise DeviceError("its amplifier does not answer")

    rig.plate.gate.device.write = fails  # type: ignore[method-assign]
    outcome = park(rig)
    assert outcome.unsafe == ("plate",)
    assert rig.plate.latch.status is Status.FAULT


@pytest.mark.parametrize("trip", [Trip.NOT_A_NUMBER, Trip.TRACKING])
def test_a_twin_that_lies_and_goes_the_wrong_way_is_driven_back(trip: Trip) -> None:
    """It was held 3 mm nearer than it had been: what it felt was not believed, though it is known where it is."""
    rig = Rig(twin=True)
    rig.twin.place = [0.0, 0.0, rig.height]

    def wrong(goal: float) -> None:
        rig.height = 0.06 - goal
        rig.load = 1.0 if rig.height > 0.025 else 0.0

    rig.obey = wrong
    outcome = rig.stop("table", trip)
    assert outcome.safe
    assert outcome.devices["table"] == "goes the wrong way: held 8.0 mm further back"
    assert rig.height == pytest.approx(0.022, abs=3e-4)


@pytest.mark.parametrize("reversed_drive", [False, True])
@pytest.mark.parametrize("speed", [0.02, 0.01, 0.005])
def test_a_slow_surface_that_still_presses_goes_on_until_it_stands(speed: float, reversed_drive: bool) -> None:
    """The stop was over after half a second: one that was driven back was held 1.5 mm further back, and pressed on."""
    rig = Rig(speed=speed)

    def obey(goal: float) -> None:
        rig.height = 0.06 - goal if reversed_drive else goal
        rig.load = max(0.0, 200.0 * (rig.height - 0.025))

    rig.obey = obey
    outcome = rig.stop("table")
    assert outcome.safe
    assert rig.load == 0.0
    assert len(rig.sent) * PERIOD <= WATCH_TIME
    told = "goes the wrong way: held 8.0 mm further back" if reversed_drive else "retracted 4."
    assert outcome.devices["table"].startswith(told)


def test_a_surface_that_presses_and_stands_is_told_after_half_a_second() -> None:
    """Wherever it stands: it is not waited for as long as for one that goes."""
    rig = Rig()
    rig.obey = lambda goal: setattr(rig, "height", max(goal, 0.015))
    outcome = rig.stop("arm")
    assert outcome.seconds == pytest.approx(SAFE_TIME)
    assert outcome.devices["table"].endswith(" mm, still touched")


def test_a_surface_stands_that_was_told_nothing_and_moved_by_nothing_for_a_twentieth_of_a_second() -> None:
    rig = Rig()
    rig.noise = True
    rig.obey = lambda goal: (setattr(rig, "height", max(goal, 0.0151)), setattr(rig, "load", 0.0))[0]
    assert rig.stop("arm").safe
    told = [height for _, height, _ in rig.sent]
    assert told[-1] == 0.0
    assert told.count(0.0) - 1 == round(STOOD / PERIOD)


def test_a_reading_that_stands_still_is_believed_for_as_long_as_a_surface_needs_to_begin() -> None:
    rig = Rig()
    rig.sequence._begun = {"table": rig.table.gate.device_monitors.values}
    for ticks, believed in ((round(SETTLE / PERIOD) - 1, True), (round(SETTLE / PERIOD), False)):
        rig.sequence._passed = ticks
        assert rig.sequence._believed(rig.table.gate) is believed


def test_a_torque_does_not_count_as_a_push() -> None:
    rig = Rig()
    assert rig.table.gate.device is not None
    say = rig.say_table

    def turned(reading: Record) -> bool:
        say(reading)
        reading["wrench"][3:] = (2.0, 2.0, 2.0)
        return True

    rig.table.gate.device.read = turned  # type: ignore[method-assign]
    outcome = rig.stop("arm")
    assert outcome.safe
    assert outcome.devices["table"].startswith("retracted 5.")


def test_where_a_surface_stood_is_that_of_the_first_stop_until_it_was_enabled() -> None:
    """A surface whose place is not believed in the second one may go no further than 6 mm from there."""
    rig = Rig()
    rig.stop("arm")
    assert rig.table.gate.actuation.way is not None and rig.table.gate.actuation.way[0] == 0.03
    rig.stop("arm")
    assert rig.table.gate.actuation.way[0] == 0.03


def test_a_surface_of_which_nothing_new_was_measured_is_not_taken_to_have_gone_back() -> None:
    """What comes late says that it went down before: that it still feels something is no finger that has followed."""
    rig = Rig()
    slow_table(rig, 0, 0)
    assert rig.table.gate.device is not None
    rig.table.gate.device.behind = 10**4  # type: ignore[attr-defined]
    rig.leaves_after = math.inf
    outcome = rig.stop("arm")
    assert outcome.devices["table"] == "not measured since it was told to retract"
    assert outcome.unsafe == ("table",)


def test_a_surface_that_moves_by_no_more_than_that_stands() -> None:
    free = pose_target(low=(-0.1, -0.1, -0.1), high=(0.1, 0.1, 0.1), speed=0.3)
    rig = Rig(table=(TABLE[0], (free,)))
    sent = rig.table.sent["pose_target"][2].item()
    rig.state["tick"] = 100
    for height, stands in ((STANDS, True), (-STANDS, True), (STANDS + 1e-9, False)):
        rig.sequence._moved = {"table": (0.0, sent, 0)}
        rig.table.reading["pose"][2] = height
        assert rig.sequence._arrived(rig.table.gate) is stands


def test_one_that_was_held_because_it_went_the_wrong_way_is_held_in_the_next_stop_too() -> None:
    """Until it was enabled: each stop would bring it nearer by as much as it takes to notice that."""
    rig = Rig()
    rig.obey = lambda goal: (setattr(rig, "height", 0.06 - goal), setattr(rig, "load", 0.0))[0]
    rig.stop("arm")
    held = rig.height
    assert held > 0.031
    rig.stop("arm")
    assert rig.height == held


def test_one_that_is_held_stands_nearer_by_more_than_it_may_or_at_all_if_it_is_not_believed() -> None:
    rig = Rig()
    for gone, nearer in ((0.001, False), (0.0, False), (-NEARER, False), (-NEARER - 1e-9, True)):
        assert rig.sequence._nearer(rig.table.gate, gone) is nearer
    rig.table.gate.fault(Trip.NOT_A_NUMBER, 0)
    for gone, nearer in ((0.001, False), (0.0, False), (-1e-9, True)):
        assert rig.sequence._nearer(rig.table.gate, gone) is nearer


def test_a_retreat_that_reverses_is_not_accepted() -> None:
    rig = Rig()
    heights = iter((*np.linspace(0.03, 0.024, 24), *np.linspace(0.024, 0.026, 8)))
    rig.leaves_after = math.inf
    rig.obey = lambda goal: setattr(rig, "height", next(heights, 0.026))
    outcome = park(rig)
    assert outcome.devices["table"] == "goes the wrong way: held 4.0 mm further back"
    assert outcome.unsafe == ("table",)


def test_one_that_is_driven_back_turns_round_when_it_has_come_nearer_by_more_than_it_may() -> None:
    rig = Rig()
    rig.stop("arm")
    ((_, stopped),) = rig.sequence._ways
    for height, turned in ((2.0 * WRONG_WAY, False), (2.0 * WRONG_WAY + 1e-9, True)):
        stopped[...], rig.sequence._furthest["table"] = BACKWARDS, WRONG_WAY
        rig.table.reading["pose"][2] = height
        rig.sequence._mind_direction({"table": height})
        assert stopped.item() == (0 if turned else BACKWARDS)


def test_one_that_is_told_to_retract_is_held_when_it_has_come_nearer_by_more_than_it_may() -> None:
    rig = Rig()
    rig.stop("arm")
    ((_, stopped),) = rig.sequence._ways
    for height, held in ((2.0 * WRONG_WAY, False), (2.0 * WRONG_WAY + 1e-9, True)):
        stopped[...], rig.sequence._furthest["table"] = 0, WRONG_WAY
        rig.table.reading["pose"][2] = height
        rig.sequence._mind_direction({"table": height})
        assert stopped.item() == (HELD if held else 0)


@pytest.mark.parametrize(("gone", "free"), [(CLEAR, True), (CLEAR - 1e-9, False)])
def test_one_that_is_driven_back_is_held_as_soon_as_it_is_clear_of_the_finger(gone: float, free: bool) -> None:
    rig = Rig()
    rig.stop("arm")
    ((_, stopped),) = rig.sequence._ways
    rig.table.reading["pose"][2], rig.table.reading["wrench"][:] = 0.0, 0.0
    stopped[...], rig.sequence._furthest["table"] = BACKWARDS, 0.0
    rig.sequence._mind_direction({"table": gone})
    assert stopped.item() == (HELD if free else BACKWARDS)


def test_a_place_that_was_measured_in_the_tick_of_the_command_counts() -> None:
    rig = Rig()
    rig.stop("arm")
    before = rig.table.reading["pose"][2].item() + 0.02
    measured = rig.table.gate.acquisition.measured_at(Role.TRACKED_POSE)
    rig.sequence._ways[0][1][...] = 0
    for since, back in ((measured, True), (measured + 1, False)):
        rig.sequence._since = since
        assert rig.sequence._back(rig.table.gate, before) is back


def test_a_surface_is_at_its_end_within_a_millimetre_of_it() -> None:
    rig = Rig()
    end = _end(rig.table.gate)
    for height, there in ((end + AT_END, True), (end + AT_END + 1e-9, False)):
        assert rig.sequence._stands(rig.table.gate, {"table": height}) is there


def test_how_far_one_has_retracted_is_told_in_millimetres() -> None:
    rig = Rig()
    rig.table.reading["pose"][2], rig.table.reading["wrench"][:] = 0.01, 0.0
    assert rig.sequence._seen_surface(rig.table.gate, 0.01 + 0.02493) == ("retracted 24.9 mm", False)


def test_one_of_which_nothing_is_heard_is_led_by_what_touches_it_after_thirty_milliseconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig()
    assert rig.table.gate.device is not None
    rig.table.gate.device.read = lambda reading: False  # type: ignore[method-assign]
    led: list[int] = []
    monkeypatch.setattr(rig.sequence._blind["table"], "mind", lambda *_: led.append(rig.sequence._passed))
    rig.stop("arm")
    assert led[0] == round(UNHEARD / PERIOD) == 30
    assert led == list(range(30, 30 + len(led)))


def test_one_that_rises_by_a_little_at_the_end_of_its_travel_has_not_retracted_by_less_than_nothing() -> None:
    rig = Rig()
    rig.height = rig.table.sent["pose_target"][2] = 0.0002
    rig.table.gate.device_monitors.forget()
    rig.table.gate.read(1)

    def yields(goal: float) -> None:  # as soon as the finger lets go of it
        rig.height, rig.load = (0.0002, 1.0) if rig.ticks < 20 else (0.0009, 0.0)

    rig.obey = yields
    outcome = rig.stop("arm")
    assert outcome.safe
    assert outcome.devices["table"] == "retracted 0.0 mm"
