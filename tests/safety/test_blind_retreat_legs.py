"""Each leg of a surface whose place is not believed, by itself: what it was told, when it is judged, what is next.

Nothing acts here: the test says in each leg how far each finger went, and what force was felt, to the limits exactly.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from small_devices import ARM, PERIOD, TABLE, Fake, model, state

from itouch.plugin import pose_target
from itouch.safety import Gate, TrackedFinger, Trip
from itouch.safety.actuation import BACKWARDS, HELD
from itouch.safety.blind_retreat import BLIND, FIRM, FITS, FOLLOWS, HARDER, KNOWN, LEG, SHORTEST, BlindRetreat

#: Where a surface stands when all stop [m]: sums of whole legs from here are exact in binary numbers.
STOOD = 0.0
#: In ticks: what a leg takes without a wire until it is over, and how long it is watched then.
OVER, WATCHED = 25, 15


class Leg(NamedTuple):
    """What happens in a leg: how far each finger goes, in parts of the leg, and what is felt [N]; at its end and then.

    Positive: the way that the surface was told to go.  ``None``: as at the begin of the leg.
    """

    fingers: Sequence[tuple[float, float]] = ()
    force: tuple[float, float] | None = None


#: A finger that is pushed by a surface that goes the other way than it is told; one that goes with it; one that stays.
PUSHED, WITH, STAYS = Leg([(-1.0, -1.0)]), Leg([(1.0, 1.0)]), Leg([(0.0, 0.0)])


class Legs:
    """A blind retreat, tick by tick; each command is carried out in the next tick."""

    def __init__(
        self, *legs: Leg, fingers: int = 1, stood: float = STOOD, low: float = -math.inf, high: float = math.inf, stopped: int = 0,
        takes: dict[str, Any] | None = None, feels: bool = True, leaves: int | None = None, age: int = 0,
    ) -> None:  # fmt: skip
        kind = type("Kind", (Fake,), takes or {})
        kind.exchange_time_for = classmethod(lambda cls, params: (takes or {}).get("exchange", 0.0))  # type: ignore[attr-defined]
        reads, _ = TABLE
        target = pose_target(low=(-0.1, -0.1, max(low, -1.0)), high=(0.1, 0.1, min(high, 1.0)), speed=0.3)
        endless = math.isinf(low) and math.isinf(high)
        free = dataclasses.replace(target, low=(), high=()) if endless else target
        channels = (reads if feels else reads[:1]), (free,)
        arms = [model(ARM, name=f"arm{index}") for index in range(fingers)]
        one = model(channels, name="table", cls=kind)
        self.state = state(*arms, one, wire=leaves is not None)
        self.table = Gate(one, self.state, PERIOD, device=kind(None))
        self.arms = [Gate(arm, self.state, PERIOD, device=Fake()) for arm in arms]
        for gate in (*self.arms, self.table):
            gate.reset()
        self.legs, self.age, self.leaves = legs, age, leaves
        self.base = [0.0] * fingers
        self.felt = 0.0
        self.leg, self.begun, self.asked = -1, 0, 0.0
        self.over = OVER + 1
        self.table.sent["pose_target"][2] = stood
        self.stopped = np.array([stopped], np.int8)
        self.way = np.array([stood, math.nan, math.nan])
        tracked = [TrackedFinger(arm, lambda index=index: self.height(index)) for index, arm in enumerate(self.arms)]
        self.retreat = BlindRetreat(self.table, self.state["tick"], PERIOD, tracked)
        #: In which tick each goal was given [m], from the first on.
        self.goals: list[tuple[int, float]] = []

    @property
    def tick(self) -> int:
        return int(self.state["tick"].item())

    def part(self) -> int:
        """Tell how far the leg is: 0 until it is over, 1 while it is watched, 2 then."""
        passed = self.tick - self.begun
        return 0 if passed < self.over else 1 if passed < self.over + WATCHED else 2

    def now(self) -> Leg:
        return self.legs[min(self.leg, len(self.legs) - 1)] if self.leg >= 0 and self.legs else Leg()

    def height(self, index: int) -> float:
        moved = self.now().fingers
        part = self.part()
        return self.base[index] + (moved[index][part - 1] * self.asked if part and moved else 0.0)

    def force(self) -> float:
        felt, part = self.now().force, self.part()
        return felt[part - 1] if part and felt is not None else self.felt

    def step(self) -> None:
        assert self.tick < 2000, "it never ends"
        self.state["tick"][...] = self.tick + 1
        for arm in self.arms:
            self.state[f"{arm.model.name}.measured"][0] = self.tick - self.age
        if "wrench" in self.table.reading:
            self.table.reading["wrench"][2] = -self.force()
        sent = self.table.sent["pose_target"][2].item()
        before = self.way.tolist()
        self.retreat.mind(self.stopped, self.way)
        after = self.way.tolist()
        if str(after) != str(before):
            self.base, self.felt = [self.height(index) for index in range(len(self.base))], self.force()
            goal = after[2] if self.stopped.item() == BACKWARDS else after[1]
            self.leg, self.begun, self.asked = self.leg + 1, self.tick, goal - sent
            self.goals.append((self.tick, goal))
        if self.goals and self.stopped.item() != HELD:
            self.table.sent["pose_target"][2] = self.goals[-1][1]

    def run(self) -> list[float]:
        """Go on until it is held; return the goals [mm]."""
        while self.stopped.item() != HELD:
            self.step()
        return [round(goal * 1e3, 6) + 0.0 for _, goal in self.goals]

    def said(self) -> str:
        return self.retreat.said(self.way)


DOWN = [-2.0, -4.0, -6.0]


def test_without_a_witness_it_goes_down_by_three_legs_and_is_held() -> None:
    for legs in (Legs(fingers=0, feels=False), Legs(STAYS), Legs(WITH)):
        assert legs.said() == ""
        assert legs.run() == DOWN
        assert legs.said() == "; it was told to go back by 6.0 mm"


@pytest.mark.parametrize(
    ("takes", "acts"),
    [
        ({}, 25), ({"exchange": 0.001}, 27), ({"exchange": 0.02}, 65), ({"period": 0.01}, 45),
        ({"period": 0.01, "delay": 0.005}, 55), ({"period": 0.01, "delay": 0.005, "exchange": 0.02}, 65),
    ],
)  # fmt: skip
def test_a_leg_is_judged_after_two_exchanges_and_the_time_that_what_is_touched_takes(
    takes: dict[str, Any], acts: int
) -> None:
    legs = Legs(STAYS, takes=takes)
    legs.run()
    begins = [tick for tick, _ in legs.goals]
    assert begins == [1 + n * (1 + acts + WATCHED) for n in range(3)]
    assert legs.tick == begins[-1] + 1 + acts + WATCHED


def test_a_leg_whose_command_is_known_to_leave_late_is_over_an_exchange_after_that() -> None:
    legs = Legs(STAYS, takes={"exchange": 0.02}, leaves=0)
    left = 100
    legs.state["table.goings"] = 1
    while legs.stopped.item() != HELD:
        legs.step()
        if legs.goals and legs.tick - legs.goals[-1][0] == left:  # noticed in the next tick
            legs.state["table.gone"].reshape(-1, 4)[0, 3] = legs.goals[-1][1]
    begins = [tick for tick, _ in legs.goals]
    assert begins == [1 + n * (left + 1 + 45 + WATCHED) for n in range(3)]


def test_a_leg_whose_command_leaves_early_still_takes_two_exchanges() -> None:
    legs = Legs(STAYS, takes={"exchange": 0.02}, leaves=0)
    while legs.stopped.item() != HELD:
        legs.step()
        if legs.goals:
            legs.state["table.gone"].reshape(-1, 4)[0, 3] = legs.goals[-1][1]
            legs.state["table.goings"] = 1
    assert [tick for tick, _ in legs.goals] == [1 + n * (1 + 65 + WATCHED) for n in range(3)]


@pytest.mark.parametrize("age", [0, 7])
def test_a_leg_is_judged_by_what_was_measured_after_it(age: int) -> None:
    """Of a finger that is only known later by so much, a leg is judged by as much later."""
    legs = Legs(STAYS, age=age)
    legs.run()
    assert [tick for tick, _ in legs.goals] == [1 + n * (1 + OVER + WATCHED + age) for n in range(3)]


def test_what_is_known_of_a_finger_may_be_just_so_old() -> None:
    ticks = round(KNOWN / PERIOD)
    for age, waited in ((ticks, ticks), (ticks + 1, 0)):
        legs = Legs(PUSHED, age=age)
        legs.over += waited
        goals = legs.run()
        assert (goals[:3] == [-2.0, -4.0, 0.0]) is bool(waited)


def test_a_tracker_is_no_witness_after_a_fault_of_its_sensors_and_is_one_after_any_other() -> None:
    for trip, known in ((Trip.SENSOR_FROZEN, False), (Trip.SPEED, True)):
        legs = Legs(PUSHED)
        legs.arms[0].fault(trip, 0)
        assert (legs.run()[:3] == [-2.0, -4.0, 0.0]) is known


def test_a_finger_that_is_pushed_twice_in_a_row_calls_it_back_to_where_it_stood_and_on() -> None:
    """It comes down with the surface, which is driven on that way as far as it may, and is held there."""
    legs = Legs(PUSHED, PUSHED, PUSHED, STAYS)
    while len(legs.goals) < 3:
        legs.step()
    assert legs.stopped.item() == BACKWARDS
    assert legs.said() == "; it pushed as it was told to go back, and was sent to where it stood"
    assert legs.run() == [-2.0, -4.0, 0.0, 2.0, 4.0, 6.0]
    assert legs.said() == "; it pushed as it was told to go back, and was sent 6.0 mm the other way"


@pytest.mark.parametrize(
    "first", [[PUSHED, STAYS, PUSHED], [STAYS, PUSHED, STAYS], [WITH, WITH, PUSHED], [PUSHED, WITH, PUSHED]]
)
def test_a_finger_that_is_pushed_once_calls_nothing_back(first: list[Leg]) -> None:
    assert Legs(*first).run() == DOWN


def test_a_push_in_the_third_leg_counts_with_that_in_the_second() -> None:
    assert Legs(STAYS, PUSHED, PUSHED, PUSHED, STAYS).run() == [*DOWN, 0.0, 2.0, 4.0, 6.0]


def test_a_finger_that_does_not_come_down_with_it_sends_it_down_for_good() -> None:
    for third in (Leg([(1e-9, 1e-9)]), WITH, Leg([(-1.0, -0.4)])):
        legs = Legs(PUSHED, PUSHED, third, PUSHED)
        assert legs.run() == [-2.0, -4.0, 0.0, -6.0]
        assert legs.said() == "; it was told to go back by 6.0 mm"


def test_down_for_good_is_not_judged_and_ends_where_it_was_sent() -> None:
    legs = Legs(PUSHED, PUSHED, WITH, PUSHED)
    legs.run()
    assert legs.tick == legs.goals[-1][0] + 1


@pytest.mark.parametrize("third", [STAYS, Leg([(math.nan, 0.5)]), Leg([(0.5, math.nan)])])
def test_of_a_finger_of_which_nothing_is_known_any_more_nothing_follows(third: Leg) -> None:
    """All three heights are the same, or one is not known: it is held where it stood."""
    legs = Legs(PUSHED, PUSHED, third)
    assert legs.run() == [-2.0, -4.0, 0.0]
    assert legs.said() == "; it pushed as it was told to go back, and was sent to where it stood"


@pytest.mark.parametrize("part", [(0.5, 0.0), (0.0, 0.5), (0.5, 0.5)])
def test_a_finger_that_was_somewhere_else_once_is_known(part: tuple[float, float]) -> None:
    assert Legs(PUSHED, PUSHED, Leg([part]), STAYS).run() == [-2.0, -4.0, 0.0, -6.0]


def test_one_of_two_fingers_is_enough_whichever_it_is() -> None:
    still = (0.0, 0.0)
    for first in (0, 1):

        def two(way: float, first: int = first) -> Leg:
            return Leg([(way, way), still] if first == 0 else [still, (way, way)])

        assert Legs(two(-1.0), two(-1.0), two(-1.0), two(0.0), fingers=2).run() == [-2.0, -4.0, 0.0, 2.0, 4.0, 6.0]
        assert Legs(two(-1.0), two(-1.0), two(1.0), fingers=2).run() == [-2.0, -4.0, 0.0, -6.0]


def test_a_finger_that_rises_on_the_other_way_sends_it_down_for_good() -> None:
    """At half of a leg, but not a little less."""
    for part, goals in ((FOLLOWS, [2.0, -6.0]), (FOLLOWS - 1e-9, [2.0, 4.0, 6.0])):
        legs = Legs(PUSHED, PUSHED, PUSHED, Leg([(0.0, part)]))
        assert legs.run() == [-2.0, -4.0, 0.0, *goals]


def test_a_surface_that_is_found_on_its_way_back_goes_on_by_legs() -> None:
    legs = Legs(STAYS, stopped=BACKWARDS)
    assert legs.run() == [2.0, 4.0, 6.0]
    assert Legs(WITH, stopped=BACKWARDS).run() == [2.0, -6.0]


def test_a_surface_that_is_held_stays_held() -> None:
    legs = Legs(PUSHED, stopped=HELD)
    for _ in range(200):
        legs.step()
    assert legs.goals == []
    assert legs.said() == "; it was told to go back by 0.0 mm"


def harder(*felt: float, finger: float = 0.0, after: float | None = None) -> list[Leg]:
    """Return legs at whose ends so much is felt, and a while later as much or ``after``."""
    return [Leg([(finger, finger)], (force, force if after is None else after)) for force in felt]


def test_a_force_that_grows_twice_in_a_row_stops_it() -> None:
    assert Legs(*harder(1.0, 2.0, 3.0)).run() == [-2.0, -4.0]
    assert Legs(*harder(1.0, 2.0, 3.0), stopped=BACKWARDS).run() == [2.0, 4.0]
    assert Legs(*harder(1.0, 2.0, 3.0), fingers=0).run() == [-2.0, -4.0]
    assert Legs(PUSHED, PUSHED, PUSHED, *harder(1.0, 2.0, 3.0)).run() == [-2.0, -4.0, 0.0, 2.0, 4.0]


def test_a_force_that_grows_once_and_once_again_later_or_by_no_more_than_noise_does_not() -> None:
    assert Legs(*harder(1.0, 1.0, 2.0)).run() == DOWN
    assert Legs(*harder(HARDER, 2.0 * HARDER, 3.0 * HARDER)).run() == DOWN
    assert Legs(*harder(HARDER, HARDER + 2.0, HARDER + 4.0)).run() == DOWN  # the last two legs: then there is none


def test_a_force_that_has_grown_at_one_of_the_two_moments_only_has_not() -> None:
    for middle, after in ((0.0, 3.0), (3.0, 0.0)):
        assert Legs(*[Leg([(0.0, 0.0)], (middle, after))] * 3).run() == DOWN


def test_a_force_that_grows_on_a_finger_that_comes_down_with_it_does_not_stop_it() -> None:
    """That sensor lies.  On the way up it is what pushes."""
    assert Legs(*harder(1.0, 2.0, 3.0, finger=FOLLOWS)).run() == DOWN
    assert Legs(*harder(1.0, 2.0, 3.0, finger=FOLLOWS - 1e-9)).run() == [-2.0, -4.0]


def test_what_is_felt_is_the_whole_force_whatever_its_direction() -> None:
    legs = Legs(STAYS)
    legs.table.reading["wrench"][...] = (0.0, 3.0, 0.0, 9.0, 9.0, 9.0)
    legs.felt = 4.0
    legs.step()
    assert legs.retreat._before.force == pytest.approx(5.0)


def test_a_stiff_hand_that_is_pressed_harder_is_pushed_by_a_part_of_a_leg() -> None:
    """A fifth of it, and just so much; without a force that has grown, or by less, it is not."""
    back = Leg([(-1.0, -1.0)], (2.0, 2.0))
    for part, felt, pushed in (
        (FIRM, (1.0, 2.0), True), (FIRM - 1e-9, (1.0, 2.0), False), (FIRM, (0.0, 0.0), False),
        (FITS[0], (0.0, 0.0), True), (FITS[0] - 1e-9, (0.0, 0.0), False),
    ):  # fmt: skip
        legs = Legs(*[Leg([(-part, -part)], (force, force)) for force in felt], back, STAYS)
        assert (0.0 in legs.run()) is pushed


def test_a_stiff_hand_that_is_pressed_softer_comes_down_by_a_part_of_the_way_back() -> None:
    """Softer at both moments by more than noise: else it is sent down for good."""
    firm = FIRM + 1e-9
    for part, felt, (middle, after), other in (
        (firm, 2.0, (1.0, 1.0), True), (FIRM - 1e-9, 2.0, (1.0, 1.0), False), (firm, 2.0, (1.75, 1.0), False),
        (firm, 2.0, (1.0, 1.75), False), (firm, 2.0, (2.5, 2.5), False), (firm, HARDER, (0.0, 0.0), False),
    ):  # fmt: skip
        legs = Legs(*harder(felt, felt, finger=-1.0), Leg([(-part, -part)], (middle, after)), STAYS)
        assert legs.run() == [-2.0, -4.0, 0.0, *([2.0, 4.0, 6.0] if other else [-6.0])]


@pytest.mark.parametrize(("low", "goals"), [(-SHORTEST, [-1.0]), (-SHORTEST + 1e-9, []), (-0.0031, [-2.0, -3.1])])
def test_the_last_leg_leads_to_the_end_of_its_travel_if_that_is_far_enough(low: float, goals: list[float]) -> None:
    assert Legs(STAYS, low=low).run() == goals


def test_the_other_way_ends_at_the_end_of_its_travel_too() -> None:
    assert Legs(STAYS, high=0.003, stopped=BACKWARDS).run() == [2.0, 3.0]
    assert Legs(STAYS, high=SHORTEST, stopped=BACKWARDS).run() == [1.0]
    assert Legs(STAYS, high=SHORTEST - 1e-9, stopped=BACKWARDS).run() == []


def test_a_nanometre_from_its_goal_a_surface_is_there() -> None:
    for short, there in ((1e-9, True), (1.1e-9, False)):
        legs = Legs(STAYS, stood=LEG, low=0.0)
        legs.step()
        assert legs.goals[-1][1] == 0.0
        for _ in range(1 + OVER + WATCHED):
            legs.table.sent["pose_target"][2] = short
            legs.step()
        assert (legs.stopped.item() == HELD) is there


def test_a_command_has_left_that_leads_within_a_nanometre_of_the_goal() -> None:
    for short, left in ((1e-9, True), (1.1e-9, False)):
        legs = Legs(STAYS, stood=LEG, low=0.0, leaves=0)
        legs.state["table.goings"] = 1
        legs.state["table.gone"].reshape(-1, 4)[0, 3] = short
        for _ in range(2 + OVER + WATCHED):
            legs.step()
        assert (legs.stopped.item() == HELD) is left


def test_what_was_found_is_dropped_when_its_place_is_believed_again() -> None:
    legs = Legs(PUSHED, PUSHED, STAYS)
    while len(legs.goals) < 3:
        legs.step()
    legs.retreat.drop(legs.stopped, legs.way)
    assert legs.stopped.item() == 0
    assert np.isnan(legs.way[1:]).all() and legs.way[0] == STOOD
    assert legs.said() == ""
    legs.legs, legs.leg, legs.goals = (PUSHED, STAYS), -1, []
    while not legs.goals:
        legs.step()
    assert legs.goals[0][1] == pytest.approx(-LEG)  # down again, from where it is


def test_pushes_of_the_stop_before_do_not_count() -> None:
    legs = Legs(PUSHED, PUSHED, PUSHED)
    while len(legs.goals) < 2:
        legs.step()
    legs.retreat.drop(legs.stopped, legs.way)
    legs.table.sent["pose_target"][2], legs.goals, legs.leg = STOOD, [], -1
    legs.legs = (PUSHED, STAYS, STAYS)
    assert legs.run() == DOWN


def test_no_way_leads_further_than_it_may() -> None:
    """Whatever is said of finger and force, it is never sent further than 6 mm from where it stood."""
    parts = (-1.0, 0.0, 1.0)
    for number in range(3**5):
        picks = [parts[number // 3**n % 3] for n in range(5)]
        legs = Legs(*[Leg([(part, part)]) for part in picks])
        assert max(abs(goal) for goal in legs.run()) <= BLIND * 1e3


def test_it_is_under_way_until_it_is_held() -> None:
    legs = Legs(STAYS)
    while legs.stopped.item() != HELD:
        legs.step()
        assert legs.retreat.under_way(legs.stopped) is (legs.stopped.item() != HELD)


def test_one_whose_wire_takes_no_command_any_more_is_waited_for_half_a_second() -> None:
    legs = Legs(STAYS, leaves=0)
    legs.state["table.goings"] = 1
    legs.step()
    asked = legs.tick + 1
    legs.state["table.gone"].reshape(-1, 4)[0, 3] = 1.0
    while legs.retreat.under_way(legs.stopped):
        legs.step()
    assert legs.tick == asked + 501
    assert legs.stopped.item() == 0 and len(legs.goals) == 1
