"""A surface whose place is not believed: withdrawn by what touches it, whichever way its drive goes.

The laws: one that obeys is never called back by a finger, however that moves; one that is wired backwards lets go of a
finger that it pushes; whatever happens, none goes further than it may without anybody knowing which way that is.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import campaign
import pytest
from numpy.typing import NDArray
from small_devices import ARM, LIMITS, PERIOD, TABLE, Fake, Supervised, model, state

from itouch.monitors.default_limits import PLATE_FORCE_ABSOLUTE
from itouch.plugin import Record
from itouch.plugin.timestamps import Timestamped
from itouch.safety import DeviceFaultError, Outcome, SafeSequence, TrackedFinger, Trip
from itouch.safety.actuation import BACKWARDS, HELD
from itouch.safety.blind_retreat import BLIND, HARDER, LEG, along
from itouch.safety.sequence import RETREAT, SAFE_TIME, WATCH_TIME

#: Where a plate stands when all stop [m], how stiff a finger's pad is [N/m].
STOOD, PAD = 0.03, 1000.0
Motion = Callable[[float], float]


class Wire(Fake, Timestamped):
    """A device whose readings were measured so many ticks before they come."""

    behind = 0
    every = 1

    @classmethod
    def exchange_time_for(cls, params: Any) -> float:
        return cls.every * PERIOD

    def measured(self, state: Record, tick: int, ticks: NDArray[Any]) -> None:
        ticks[...] = tick - self.behind


class World:
    """A plate under a finger, behind wires: what the table says of its place is no number from the stop on.

    The finger hangs on a hand of some stiffness, whose place is a motion, over a stiff pad; nothing has a mass.
    """

    def __init__(
        self, hand: Motion, *, way: float = 1.0, wire: int = 5, phase: int = 0, stiffness: float = 300.0,
        tracked: bool = True, feels: bool = False, behind: int = 2, takes: dict[str, float] | None = None,
        speed: float = 0.25, leaves: int | None = None,
    ) -> None:  # fmt: skip
        kind = type("Kind", (Wire,), takes or {"every": wire})
        limits = replace(LIMITS, speed=speed)
        models = [model(ARM, name="arm", cls=Wire), model(TABLE, name="table", cls=kind, limits=limits)]
        self.state = state(*models, wire=leaves is not None)
        self.leaves, self.sent_since = leaves, [STOOD] * ((leaves or 0) + 1)
        self.all = [Supervised(one, self.state, PERIOD, device=one.cls(None)) for one in models]
        self.arm, self.table = self.all
        self.hand, self.way, self.wire, self.stiffness, self.feels = hand, way, wire, stiffness, feels
        self.ticks, self.phase, self.lies, self.heard = 0, phase, True, True
        self.top, self.obeyed = STOOD, STOOD
        self.finger, self.force = 0.0, 0.0
        self.tops: list[float] = []
        self.forces: list[float] = []
        self.ways: set[int] = set()
        self.touch()
        self.said = [self.finger] * (behind + 1)
        assert isinstance(self.arm.gate.device, Wire) and isinstance(self.table.gate.device, Wire)
        self.arm.gate.device.behind = behind
        self.arm.gate.device.says, self.table.gate.device.says = self.say_arm, self.say_table
        self.lies = False
        for one in self.all:
            one.lifecycle.reset()
            one.lifecycle.open()
            one.gate.read(0)
            one.lifecycle.enable()
        self.lies = True
        fingers = (
            {"table": [TrackedFinger(self.arm.gate, lambda: self.arm.reading["pose"][2].item())]} if tracked else {}
        )
        self.sequence = SafeSequence([one.gate for one in self.all], self.state, PERIOD, self.move, fingers)

    def touch(self) -> None:
        """Let the finger find its place between hand and plate."""
        hand = self.hand(self.ticks * PERIOD)
        self.finger, self.force = hand, 0.0
        if hand < self.top:
            self.finger = (self.stiffness * hand + PAD * self.top) / (self.stiffness + PAD)
            self.force = self.stiffness * (self.finger - hand)

    def say_arm(self, reading: Record) -> bool:
        reading["pose"] = (0.0, 0.0, self.said[0], 1.0, 0.0, 0.0, 0.0)
        return True

    def say_table(self, reading: Record) -> bool:
        if not self.heard or (self.ticks and (self.ticks + self.phase) % self.wire):
            return False
        reading["pose"] = (0.0, 0.0, math.nan if self.lies else self.top, 1.0, 0.0, 0.0, 0.0)
        felt = self.force if self.feels or not self.lies else math.nan
        reading["wrench"] = (
            0.0,
            0.0,
            -felt - 1e-6 * (self.ticks % 2),
            0.01 * self.ticks,
            0.0,
            0.0,
        )  # a torque is no push
        return True

    def move(self) -> None:
        self.ticks += 1
        if self.leaves is not None:  # a wire that tells so many ticks later that a command has left
            self.sent_since = [*self.sent_since[1:], self.table.sent["pose_target"][2].item()]
            self.state["table.gone"].reshape(-1, 4)[0] = (self.ticks - self.leaves, 0.0, 0.0, self.sent_since[0])
            self.state["table.goings"] = 1
        if not (self.ticks + self.phase) % self.wire:
            sent = self.table.sent["pose_target"][2].item()
            self.top += self.way * (sent - self.obeyed)
            self.obeyed = sent
        self.touch()
        self.said = [*self.said[1:], self.finger]
        self.tops.append(self.top)
        self.forces.append(self.force)
        self.ways.add(self.stopped)

    def stop(self, trip: Trip = Trip.NOT_A_NUMBER, device: str = "table") -> Outcome:
        return self.sequence.carry_out(DeviceFaultError(device, 0, trip, "has failed"), lambda: None)

    @property
    def stopped(self) -> int:
        assert self.table.gate.actuation.stopped is not None
        return int(self.table.gate.actuation.stopped.item())


def still(depth: float = 0.003) -> Motion:
    """Return a hand that stands so far [m] below the plate's top."""
    return lambda time: STOOD - depth


def moving(rng: random.Random, trembles: float) -> Motion:
    """Return a hand that lifts, presses and taps as it likes, in steps of minimum jerk, and trembles by so much [m]."""
    steps = [
        (rng.uniform(-0.1, 0.5), rng.uniform(0.02, 0.4), rng.choice((1, 1, 1, -1)) * rng.uniform(0.0005, 0.03))
        for _ in range(rng.randint(0, 6))
    ]
    tremors = [(rng.uniform(0.0, trembles), rng.uniform(3.0, 25.0), rng.uniform(0.0, 6.3)) for _ in range(2)]
    depth = rng.uniform(-0.004, 0.006)

    def motion(time: float) -> float:
        height = STOOD - depth
        for begin, lasts, size in steps:
            part = min(1.0, max(0.0, (time - begin) / lasts))
            height += size * part**3 * (10.0 - 15.0 * part + 6.0 * part * part)
        return height + sum(size * math.sin(6.283 * rate * time + phase) for size, rate, phase in tremors)

    return motion


WIRES = (1, 7, 20, 23)


@pytest.mark.parametrize("wire", WIRES)
def test_a_surface_that_obeys_goes_down_however_a_finger_moves(wire: int) -> None:
    """It never comes nearer than it was when all stopped, and is called back there by a hand that shakes, or by chance.

    Of hands that do not shake, one in 300 may move twice in a row, leg by leg, as one that is pushed.
    """
    back = called = calm = 0
    for number in range(500 if campaign.FULL else 25):
        rng = random.Random(f"{wire} {number}")
        shakes = rng.random() < 0.3
        world = World(
            moving(rng, 1.2e-3 if shakes else 3e-4), wire=wire, phase=rng.randrange(wire),
            stiffness=rng.uniform(100.0, 2000.0), feels=rng.random() < 0.5, behind=rng.randint(0, 20),
        )  # fmt: skip
        world.stop()
        assert max(world.tops) <= STOOD, number
        up = any(after > before for before, after in zip(world.tops, world.tops[1:], strict=False))
        back, called, calm = back + up, called + (up and not shakes), calm + (not shakes)
        assert world.top <= STOOD - RETREAT, number
        assert world.stopped == HELD
    campaign.tell(
        f"{back} of {number + 1} hands called a surface back that obeys, {called} of {calm} that do not shake"
    )
    assert called <= calm / 300


@pytest.mark.parametrize("wire", WIRES)
def test_one_that_is_wired_backwards_lets_go_of_the_finger_that_it_pushes(wire: int) -> None:
    for number in range(200 if campaign.FULL else 10):
        rng = random.Random(f"back {wire} {number}")
        trembles = rng.uniform(0.0, 1e-4), rng.uniform(3.0, 12.0), rng.uniform(0.0, 6.3)
        depth, stiffness = rng.uniform(0.001, 0.006), rng.uniform(100.0, 500.0)

        def hand(time: float, depth: float = depth, tremor: tuple[float, float, float] = trembles) -> float:
            size, rate, phase = tremor
            return STOOD - depth + size * math.sin(6.283 * rate * time + phase)

        world = World(
            hand, way=-1.0, wire=wire, phase=rng.randrange(wire), stiffness=stiffness, feels=rng.random() < 0.5,
            behind=rng.randint(0, 20),
        )  # fmt: skip
        outcome = world.stop()
        assert world.top <= STOOD - RETREAT, number
        assert {0, BACKWARDS} <= world.ways <= {0, BACKWARDS, HELD}
        assert max(world.tops) <= STOOD + 2.5 * LEG, number
        assert max(world.forces) < PLATE_FORCE_ABSOLUTE
        assert world.stopped == HELD
        sent = (world.table.sent["pose_target"][2].item() - STOOD) * 1e3
        told = f"; it pushed as it was told to go back, and was sent {sent:.1f} mm the other way"
        assert not outcome.safe and outcome.devices["table"].endswith(told)
        assert abs(world.obeyed - STOOD) <= BLIND + 1e-9  # where it would go if its drive were mended then


def test_a_finger_that_is_lifted_quickly_and_then_held_calls_nothing_back() -> None:
    """The finger alone was once taken for a witness: one that is lifted as all stop is a surface's that comes up."""
    for begins in range(0, 300, 4):
        for lasts in (0.02, 0.05, 0.1, 0.2):
            for size in (0.002, 0.004, 0.01, 0.03):

                def lifted(
                    time: float, begin: float = begins * 1e-3, lasts: float = lasts, size: float = size
                ) -> float:
                    part = min(1.0, max(0.0, (time - begin) / lasts))
                    return STOOD - 0.002 + size * part**3 * (10.0 - 15.0 * part + 6.0 * part * part)

                if not campaign.FULL and (begins // 4 + round(lasts * 100) + round(size * 1e3)) % 40:
                    continue
                world = World(lifted, wire=5, phase=begins % 5)
                world.stop()
                assert all(after <= before for before, after in zip(world.tops, world.tops[1:], strict=False))
                assert world.top == pytest.approx(STOOD - BLIND, abs=3e-4)


class Mimic(World):
    """A finger that goes as one would that is pushed by a surface that is wired backwards, wherever the real one is."""

    def touch(self) -> None:
        if hasattr(self, "table"):
            self.hand = lambda time: max(2.0 * STOOD - self.obeyed, self.top)
        super().touch()


def test_a_finger_that_does_all_that_one_does_that_is_pushed_calls_a_surface_no_nearer_than_a_leg() -> None:
    world = Mimic(still(0.0))
    world.stop()
    assert max(world.tops) <= STOOD + LEG + 1e-9
    assert max(world.forces) < 2.0
    assert world.top < STOOD + LEG  # it is told to go down when it is seen to push
    assert world.stopped == HELD


@pytest.mark.parametrize(("feels", "way"), [(False, -1.0), (True, -1.0), (True, 1.0)])
def test_without_a_tracked_finger_nothing_turns_it_but_a_force_that_grows_stops_it(feels: bool, way: float) -> None:
    world = World(still(), way=way, tracked=False, feels=feels)
    outcome = world.stop()
    gone = abs(world.top - STOOD)
    assert gone == pytest.approx(0.0045 if feels and way < 0.0 else BLIND, abs=3e-4)
    assert max(world.forces) < PLATE_FORCE_ABSOLUTE
    assert "; it was told to go back by " in outcome.devices["table"]


def test_a_finger_that_nothing_moves_is_pressed_no_harder_than_its_pad_by_the_legs() -> None:
    """A hand like a wall: nothing is seen of it; a force that grows stops the surface, else the end of its legs."""
    for feels, most in ((True, 0.0045), (False, BLIND)):
        world = World(still(0.001), way=-1.0, stiffness=1e9, feels=feels)
        world.stop()
        assert world.top - STOOD == pytest.approx(most, abs=3e-4)
        assert max(world.forces) < PLATE_FORCE_ABSOLUTE


@pytest.mark.parametrize("wire", [5, 20])
@pytest.mark.parametrize("stiffness", [1500.0, 2500.0])
def test_a_stiff_hand_moves_by_a_part_of_each_leg_and_its_force_tells_which_way(stiffness: float, wire: int) -> None:
    """Pressed harder as the surface comes, and softer as it is called back: else it would be told to come for good."""
    world = World(still(), way=-1.0, wire=wire, stiffness=stiffness, feels=True)
    world.stop()
    assert BACKWARDS in world.ways
    assert world.forces[-1] < world.forces[0]
    assert world.top < STOOD
    assert max(world.forces) < PLATE_FORCE_ABSOLUTE


def test_a_tracker_that_is_not_believed_or_has_fallen_silent_is_no_witness() -> None:
    for silent in (False, True):
        world = World(still(), way=-1.0, behind=2)
        assert isinstance(world.arm.gate.device, Wire)
        if silent:
            world.arm.gate.device.says = lambda reading: False
            world.state["tick"][...] = 500
            outcome = world.stop()
        else:
            world.arm.gate.fault(Trip.SENSOR_FROZEN, 0)
            outcome = world.stop()
        assert "; it was told to go back by 6.0 mm" in outcome.devices["table"]


@pytest.mark.parametrize("how", ["trips", "is silent", "freezes"])
@pytest.mark.parametrize(("wire", "lost"), [(5, 155), (5, 180), (20, 250), (20, 280)])
def test_one_that_has_pushed_is_held_where_it_stood_if_its_witness_is_lost_on_the_way_there(
    wire: int, lost: int, how: str
) -> None:
    """It was sent down for good then, which is up: 6 mm nearer, though it had been seen twice to push."""
    world = World(still(), way=-1.0, wire=wire)
    move = world.sequence._move

    def moves() -> None:
        move()
        if world.ticks == lost and how == "trips":
            world.arm.gate.fault(Trip.SENSOR_FROZEN, lost)
        elif world.ticks == lost and how == "is silent" or world.stopped == BACKWARDS and how == "freezes":
            assert isinstance(world.arm.gate.device, Wire)
            world.arm.gate.device.says = lambda reading: how == "freezes"

    world.sequence._move = moves
    outcome = world.stop()
    assert world.top == pytest.approx(STOOD, abs=5e-4)
    assert world.stopped == HELD
    assert outcome.devices["table"].endswith("; it pushed as it was told to go back, and was sent to where it stood")


def test_what_is_known_of_a_finger_may_be_a_tenth_of_a_second_old() -> None:
    for behind, known in ((99, True), (100, False)):  # and the tick that it came in
        world = World(still(), way=-1.0, wire=1, behind=behind)
        world.stop()
        assert (BACKWARDS in world.ways) is known


def test_the_time_that_a_device_takes_by_itself_counts_for_a_leg() -> None:
    """Its exchanges take no time; it measures every 10 ms, and what it is told acts 10 ms later."""
    world = World(still(), way=-1.0, wire=20, takes={"every": 0, "period": 0.01, "delay": 0.01})
    world.stop()
    assert world.top <= STOOD - RETREAT


def test_one_that_answers_again_is_believed_and_goes_on_as_any_other() -> None:
    """For 60 ms nothing is heard: it goes back as far as one may that nobody knows of, and waits there."""
    world = World(still())
    world.lies, world.heard = False, False
    low = []
    move = world.move

    def moves() -> None:
        move()
        low.append(world.top)
        world.heard = world.ticks > 60

    world.sequence._move = moves
    outcome = world.stop(Trip.SILENT)
    assert min(low[:60]) == pytest.approx(STOOD - 0.0075, abs=6e-4)
    assert outcome.devices["table"].startswith("retracted ")
    assert world.stopped == 0
    assert world.table.gate.actuation.way is not None and math.isnan(world.table.gate.actuation.way[1].item())


def test_one_that_answers_again_in_the_middle_of_a_leg_goes_further_than_that_leg() -> None:
    """At 0.04 m/s it has gone by 1.2 mm when it is doubted: there are legs left."""
    world = World(still(), speed=0.04)
    world.lies, world.heard, world.feels = False, False, True
    move = world.move

    def moves() -> None:
        move()
        world.heard = world.ticks > 60

    world.sequence._move = moves
    outcome = world.stop(Trip.SILENT)
    assert outcome.devices["table"].startswith("retracted ")
    assert world.table.gate.actuation.way is not None and all(
        math.isnan(end) for end in world.table.gate.actuation.way[1:]
    )


def test_forces_that_grow_by_no_more_than_noise_may_do_not_stop_it() -> None:
    """Exactly so much in each leg."""
    world = World(still(), tracked=False)
    goals: set[float] = set()

    def say(reading: Record) -> bool:
        goal = world.table.gate.actuation.way[1].item() if world.table.gate.actuation.way is not None else math.nan
        goals.update({goal} if not math.isnan(goal) else ())
        reading["pose"], reading["wrench"] = math.nan, (0.0, 0.0, -HARDER * len(goals), 0.0, 0.0, 0.0)
        return True

    assert isinstance(world.table.gate.device, Wire)
    world.table.gate.device.says = say
    world.stop()
    assert len(goals) == 3
    assert world.top == pytest.approx(STOOD - BLIND, abs=3e-4)


def found_backwards(tells: float) -> World:
    """Return a world whose table was seen to go the wrong way, and does not tell its place any more after so long."""
    world = World(still(), way=-1.0, wire=1)
    world.lies, world.feels = False, True
    move = world.move

    def moves() -> None:
        move()
        world.lies = world.ticks * PERIOD > tells

    world.sequence._move = moves
    return world


def test_one_that_was_found_to_go_the_wrong_way_is_driven_back_by_legs_when_its_place_is_not_believed_any_more() -> (
    None
):
    world = found_backwards(0.08)
    outcome = world.stop(Trip.SPEED, "arm")
    assert outcome.also == {"table": "not-a-number"}
    assert world.top == pytest.approx(STOOD - BLIND, abs=3e-4)
    assert world.stopped == HELD


def test_one_that_was_held_because_it_went_the_wrong_way_stays_where_it_is() -> None:
    world = found_backwards(0.03)
    world.stop(Trip.SPEED, "arm")
    held = world.top
    assert STOOD < held < STOOD + RETREAT
    assert set(world.tops[40:]) == {held}
    assert world.stopped == HELD


def test_one_on_its_way_back_that_pushes_is_told_to_go_down_or_stopped() -> None:
    """Its drive obeys again as it is driven back: the finger that it pushes now sends it down."""
    for stiffness, feels in ((300.0, False), (1e9, True)):
        world = found_backwards(0.065)
        world.stiffness = stiffness
        move = world.sequence._move

        def moves(world: World = world, move: Callable[[], None] = move, feels: bool = feels) -> None:
            if world.ticks == 66:
                world.way = 1.0
            world.feels = feels or not world.lies
            move()

        world.sequence._move = moves
        world.stop(Trip.SPEED, "arm")
        assert max(world.forces) < PLATE_FORCE_ABSOLUTE
        assert max(world.tops) < STOOD + 3 * LEG
        assert world.stopped == HELD


def test_near_the_end_of_its_travel_there_is_no_leg_left() -> None:
    world = World(still())
    world.table.sent["pose_target"][2] = world.top = world.obeyed = 0.0009
    world.stop()
    assert world.top == pytest.approx(0.0, abs=9e-4)
    assert world.stopped == HELD


def test_near_the_end_of_its_travel_legs_lead_to_that_end() -> None:
    """Wired backwards 4 mm over its end, it pushes in the leg that is left, too, and lets go."""
    world = World(lambda time: 0.0, way=-1.0)
    world.table.sent["pose_target"][2] = world.top = world.obeyed = 0.004
    world.touch()
    world.said = [world.finger] * 3
    world.arm.gate.device_monitors.forget()
    world.arm.gate.read(0)
    world.stop()
    assert world.top < 0.004 - RETREAT


def test_what_is_held_blindly_goes_no_further_in_the_next_stop_until_it_was_enabled() -> None:
    world = World(still())
    world.stop()
    low = world.top
    world.stop(Trip.SPEED, "arm")
    assert world.top == low
    world.lies = False
    for one in world.all:
        one.lifecycle.rearm(world.state["tick"].item())
        one.lifecycle.enable()
    assert world.stopped == 0
    world.stop(Trip.SPEED, "arm")
    assert world.top < low - RETREAT


def test_a_finger_fits_that_just_moves_as_it_may() -> None:
    for before, after in ((-1.0, 0.1), (-1.0, -0.4), (-0.6, 0.0), (-1.4, 0.0)):
        assert along(-1.0, before, 0.0, after)
    for before, after in ((-1.0, 0.1001), (-1.0, -0.4001), (-0.5999, 0.0), (-1.4001, 0.0)):
        assert not along(-1.0, before, 0.0, after)


def test_a_finger_fits_that_moves_as_it_is_pushed_and_then_stays() -> None:
    leg = -LEG
    assert along(leg, 0.01, 0.0118, 0.0118)
    assert along(leg, 0.01, 0.0118, 0.0112)  # it swings back
    assert not along(leg, 0.01, 0.0111, 0.0111)  # too little
    assert along(leg, 0.01, 0.0111, 0.0111, 0.2)
    assert not along(leg, 0.01, 0.0130, 0.0130)  # further than it can be pushed
    assert not along(leg, 0.01, 0.0118, 0.0121)  # it goes on by itself
    assert not along(leg, 0.01, 0.0118, 0.0109)  # it is moved by something else
    assert not along(leg, 0.01, 0.0082, 0.0082)  # it has followed
    assert along(-leg, 0.01, 0.0082, 0.0082)
    assert not along(leg, math.nan, 0.0118, 0.0118)


def test_a_leg_is_judged_when_its_last_command_is_known_to_have_left() -> None:
    """A wire that tells late makes each leg later by as much, and no leg another one."""
    known, late = World(still()), World(still(), leaves=60)
    for world in (known, late):
        world.stop()
        assert world.stopped == HELD
        assert world.top <= STOOD - RETREAT
    second = [next(tick for tick, top in enumerate(one.tops) if top < STOOD - 1.5 * LEG) for one in (known, late)]
    assert second[1] >= second[0] + 40
    assert late.ways == known.ways


@pytest.mark.parametrize("speed", [0.1, 0.05, 0.02, 0.01])
@pytest.mark.parametrize("wire", [1, 20, 29])
def test_a_slow_one_has_the_time_that_its_legs_take(wire: int, speed: float) -> None:
    """A stop was over after half a second: a tighter limit of speed left a surface up to 4 mm nearer, and 1.6 N."""
    for way in (1.0, -1.0):
        world = World(still(), way=way, wire=wire, speed=speed)
        world.stop()
        assert world.top == pytest.approx(STOOD - BLIND, abs=3e-4)
        assert world.forces[-1] == 0.0
        assert world.stopped == HELD
        assert world.ticks <= WATCH_TIME / PERIOD


def test_a_wire_that_takes_no_command_any_more_is_not_waited_for() -> None:
    world = World(still(), leaves=10**6)
    world.stop()
    assert world.ticks < 2.0 * SAFE_TIME / PERIOD
    assert world.stopped == HELD
