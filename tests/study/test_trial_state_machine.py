"""A trial as a state machine: phases, rules and times, without an engine."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch_tools.study.machine import Machine, Phase, Rules, Sensed

TICK = 0.01


class Body:
    """Steps a machine: a finger that touches from ``at`` to ``until`` seconds after the signal."""

    def __init__(self, rules: Rules, *, at: float = 0.1, until: float = 1.0, skin: float | None = 306.0) -> None:
        self.machine, self.at, self.until, self.skin = Machine(rules), at, until, skin
        self.ready, self.object, self.now = True, rules.object, 100.0

    def step(self) -> Phase:
        self.now += TICK
        machine = self.machine
        gone = machine.since(Phase.GO) + TICK if Phase.GO in machine.times else -1.0
        touches = machine.phase in (Phase.GO, Phase.CONTACT) and self.at <= gone < self.until
        return machine.step(Sensed(self.now, self.skin, self.ready, self.object if touches else -1))

    def until_phase(self, *wanted: Phase, seconds: float = 300.0) -> Phase:
        for _ in range(round(seconds / TICK)):
            if self.step() in wanted:
                return self.machine.phase
        raise AssertionError(f"still in {self.machine.phase}")


def test_a_trial_goes_through_its_phases() -> None:
    body = Body(Rules(2, baseline=306.0, approach=3.0, pause=2.0))
    assert body.machine.phase is Phase.SKIN
    for phase in (Phase.APPROACH, Phase.GO, Phase.CONTACT, Phase.JUDGE):
        assert body.until_phase(phase) is phase
    times = body.machine.times
    assert times[Phase.GO] - times[Phase.APPROACH] == pytest.approx(3.0, abs=2 * TICK)
    assert times[Phase.JUDGE] - times[Phase.CONTACT] == pytest.approx(0.9, abs=3 * TICK)
    body.machine.judged("")
    assert body.machine.phase is Phase.ANSWER
    for _ in range(70):
        body.step()
    assert body.machine.since() == pytest.approx(0.7)
    body.machine.answered()
    assert body.until_phase(Phase.END) is Phase.END
    assert body.machine.since(Phase.PAUSE) == pytest.approx(2.0, abs=2 * TICK)
    assert not body.machine.void


def test_it_waits_for_the_skin_and_not_for_ever() -> None:
    body = Body(Rules(0, baseline=306.0, skin_return=0.5, skin_wait=20.0), skin=304.0)
    for _ in range(1000):
        assert body.step() is Phase.SKIN
    body.skin = 305.6
    assert body.step() is Phase.APPROACH
    assert body.machine.back == [True]
    late = Body(Rules(0, baseline=306.0, skin_wait=20.0), skin=304.0)
    late.until_phase(Phase.APPROACH)
    assert late.machine.back == [False]
    assert late.now == pytest.approx(120.0, abs=0.05)
    for skin in (None, math.nan):  # nothing measures it now
        assert Body(Rules(0, baseline=306.0), skin=skin).until_phase(Phase.APPROACH)


def test_an_equalised_signal_does_not_wait_for_the_plate_and_another_does() -> None:
    for ready in (False, True):
        body = Body(Rules(0, approach=4.0, equal=True))
        body.ready = ready
        body.until_phase(Phase.GO)
        assert body.now - 100.0 == pytest.approx(4.0, abs=3 * TICK)
    body = Body(Rules(0, approach=1.0, equal=False, ready_wait=9.0))
    body.ready = False
    for _ in range(500):
        body.step()
    assert body.machine.phase is Phase.APPROACH
    body.ready = True
    assert body.step() is Phase.GO
    never = Body(Rules(0, approach=1.0, equal=False, ready_wait=9.0))
    never.ready = False
    never.until_phase(Phase.PAUSE)
    assert never.machine.void == "the plate was not ready in time"


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"at": 1e9}, "nothing was touched"),
        ({"object": 1}, "something else was touched"),
    ],
)
def test_a_broken_rule_makes_it_void(change: dict[str, float], why: str) -> None:
    body = Body(Rules(0, reach=5.0))
    for name, value in change.items():
        setattr(body, name, value)
    body.until_phase(Phase.PAUSE)
    assert body.machine.void == why
    body.until_phase(Phase.END)


def test_another_material_in_contact_is_void() -> None:
    body = Body(Rules(0))
    body.until_phase(Phase.CONTACT)
    body.object = 1
    assert body.step() is Phase.JUDGE
    body.machine.judged("")
    assert (body.machine.phase, body.machine.void) == (Phase.PAUSE, "the material changed in contact")


def test_who_touches_before_the_signal_or_never_answers() -> None:
    machine = Machine(Rules(0, approach=5.0))
    machine.step(Sensed(1.0))
    assert machine.step(Sensed(1.1, object=0)) is Phase.PAUSE
    assert machine.void == "touched before the signal"
    body = Body(Rules(0, answer_wait=3.0))
    body.until_phase(Phase.JUDGE)
    body.machine.judged("")
    body.until_phase(Phase.PAUSE)
    assert body.machine.void == "no answer in time"


def test_what_is_asked_out_of_turn_is_refused() -> None:
    machine = Machine(Rules(0))
    with pytest.raises(ValueError, match="judged when it has ended"):
        machine.judged("")
    with pytest.raises(ValueError, match="taken when it is asked for"):
        machine.answered()


@given(
    intervals=st.integers(1, 3), voids=st.lists(st.booleans(), min_size=3, max_size=3),
    at=st.floats(0.02, 2.0), lasts=st.floats(0.05, 3.0), pause=st.floats(0.0, 2.0),
)  # fmt: skip
def test_every_trial_ends_and_times_never_run_back(
    intervals: int, voids: list[bool], at: float, lasts: float, pause: float
) -> None:
    body = Body(Rules(0, intervals, baseline=306.0, approach=0.5, reach=4.0, pause=pause), at=at, until=at + lasts)
    judged, seen = 0, [0.0]
    while body.machine.phase is not Phase.END:
        body.until_phase(Phase.JUDGE, Phase.ANSWER, Phase.END, Phase.PAUSE)
        seen.append(body.machine.times[body.machine.phase])
        if body.machine.phase is Phase.JUDGE:
            body.machine.judged("broken" if voids[judged] else "")
            judged += 1
        elif body.machine.phase is Phase.ANSWER:
            body.machine.answered()
    assert seen == sorted(seen)
    first = next((index for index in range(intervals) if voids[index]), None)
    assert judged == (intervals if first is None else first + 1)
    assert bool(body.machine.void) == (first is not None)
