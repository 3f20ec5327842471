"""A driver whose current takes its time: the twin has it, and the controller counts on it, on its way and to come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from itouch.plugin import Field, Record, TwinInputs
from itouch_thermal.display.display_twin import DisplayTwin
from itouch_thermal.display.params import DisplayParams, Mismatch
from itouch_thermal.display.peltier import pumped_heat
from itouch_thermal.display.plant import CURRENT
from itouch_thermal.flux import observer as at
from itouch_thermal.flux import planner, slew
from itouch_thermal.flux.current_command import FutureCurrent
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.heat import FINGER

PERIOD, SLEW = 1e-3, 100.0
PARAMS = DisplayParams(delay=12e-3, slew=SLEW)
#: Currents that are asked for [A], and for how many periods.
ASKED = ((2.0, 30), (-3.0, 12), (1.0, 7), (0.5, 60))


def ramped(asked: np.ndarray, most: float) -> np.ndarray:
    """Return what flows if the current changes by ``most`` [A] a period."""
    found, now = np.empty_like(asked), 0.0
    for i, wanted in enumerate(asked):
        now += max(-most, min(most, wanted - now))
        found[i] = now
    return found


def law_of(params: DisplayParams) -> tuple[ModelLaw, Record]:
    law = ModelLaw(params, FINGER, 310.15, 306.15, 2e-3, 296.15, PERIOD, band=(288.15, 313.15), ceiling=6.4)
    state = Record.of(law.fields())
    law.reset(state)
    return law, state


@pytest.mark.parametrize("off", [0.0, -0.5])
def test_the_twins_current_changes_no_faster(off: float) -> None:
    twin = DisplayTwin(replace(PARAMS, delay=0.0, current_bits=32, mismatch=Mismatch(slew=off)))
    state, command = Record.of(twin.fields()), Record.of([Field("current", "f8", 1)])
    twin.reset(state, np.random.default_rng(0))
    asked, found = np.concatenate([np.full(count, amps) for amps, count in ASKED]), []
    for amps in asked:
        command["current"] = amps
        twin.step(state, command, TwinInputs(), PERIOD)
        found.append(state["memory"][CURRENT])
    assert found == pytest.approx(list(ramped(asked, (1.0 + off) * SLEW * PERIOD)), abs=1e-6)


def test_who_knows_the_slew_knows_the_plate_as_who_is_told_every_step_of_the_ramp() -> None:
    """On the bare plate and in a touch, for what has flowed and for what is still on its way."""
    asked = np.concatenate([np.full(count, amps) for amps, count in ASKED])
    laws = [law_of(PARAMS), law_of(replace(PARAMS, slew=0.0))]
    for law, state in laws:
        law.begin(state, 0.0)
        state["wanted"] = 500.0
    for pair in zip(asked, ramped(asked, SLEW * PERIOD), strict=True):
        for (law, state), amps in zip(laws, pair, strict=True):
            law.track(state, float(amps), np.nan, np.nan, np.nan)
        (known, ramp) = (state["x"][0] for _, state in laws)
        assert known == pytest.approx(ramp, abs=1e-9)
    column = laws[0][0].fine.tissue.shape[1] + laws[0][0].fine.plate.shape[1]
    assert abs(laws[0][1]["x"][0, column + at.X_FACE] - 296.15) > 0.1


@pytest.mark.parametrize("touching", [False, True])
def test_what_is_still_to_come_comes_at_that_rate(touching: bool) -> None:
    """A step that is on its way is the ramp that it becomes: what is asked for next is the same."""
    step = np.array([2.0] * 12)
    laws, asked = [law_of(PARAMS), law_of(PARAMS)], []
    for (law, state), coming in zip(laws, (step, ramped(step, SLEW * PERIOD)), strict=True):
        if touching:
            law.begin(state, 0.0)
            state["wanted"] = 500.0
        for amps in coming:
            law.track(state, float(amps), np.nan, np.nan, np.nan)
        asked.append(law.follow(state) if touching else law.approach(state, 290.0)[:2])
    assert asked[0] == pytest.approx(asked[1], rel=1e-9)
    law, state = law_of(replace(PARAMS, slew=0.0))
    if touching:
        law.begin(state, 0.0)
        state["wanted"] = 500.0
    for amps in step:
        law.track(state, float(amps), np.nan, np.nan, np.nan)
    other = law.follow(state) if touching else law.approach(state, 290.0)[:2]
    assert abs(other[0] - asked[0][0]) > 1e-3


#: A display behind a wire: a command leaves every so many periods.
HOLD = 8


@pytest.mark.parametrize("touching", [False, True])
def test_no_more_is_asked_for_than_flows_before_the_next_command_leaves(touching: bool) -> None:
    """Whatever is wanted: more would flow when nobody wants it any more, and the loop would swing."""
    law, state = law_of(PARAMS)
    wanted = np.random.default_rng(1)
    if touching:
        law.begin(state, 0.0)
    sent, far = np.zeros(12), 0
    for turn in range(120):
        if turn % 3 == 0:
            state["wanted"], target = wanted.uniform(-9000.0, 9000.0), wanted.uniform(285.0, 310.0)
        coming = FutureCurrent(hold=HOLD)
        asked = law.follow(state, every=HOLD, coming=coming)[0] if touching else law.approach(state, target, coming)[0]
        flows = ramped(sent, SLEW * PERIOD)[-1]
        assert abs(asked - flows) <= HOLD * SLEW * PERIOD + 1e-9
        far += abs(asked - flows) > 0.9 * HOLD * SLEW * PERIOD
        for _ in range(HOLD):
            law.track(state, asked, np.nan, np.nan, np.nan)
        sent = np.concatenate((sent, np.full(HOLD, asked)))
    assert far > 10, "the driver was never hurried, so nothing was shown"


@pytest.mark.parametrize("change", [-0.4, -0.1, 0.0, 0.02, 0.3, 0.4])
def test_the_mean_of_the_ramp_is_the_current_that_is_needed(change: float) -> None:
    asked = slew.reached(1.0 + change, 1.0, 0.8)
    flowing = 1.0 + np.clip(0.8 * (np.arange(8000) + 0.5) / 8000, 0.0, abs(asked - 1.0)) * np.sign(change)
    assert flowing.mean() == pytest.approx(1.0 + change, abs=1e-6)
    assert slew.reached(1.0 + 20.0 * change, 1.0, 0.8) == pytest.approx(1.0 + 0.8 * np.sign(change) if change else 1.0)
    assert slew.reached(1.0 + change, 1.0, 0.0) == 1.0 + change


@pytest.mark.parametrize("current", [-6.0, -2.0, 0.0, 2.0])
def test_the_flux_may_change_as_fast_as_the_current_lets_it(current: float) -> None:
    """By what the module pumps a little later, with the share that is used; while it heats at least as at rest."""
    law, state = law_of(replace(PARAMS, resistance=6.0))
    rate = slew.rate(law.constants, state["theta"], current, 296.15)
    step = 1e-4 * slew.USED * SLEW
    pumped = [
        pumped_heat(PARAMS.seebeck, 6.0, PARAMS.conductance, some, 296.15, 296.15) / PARAMS.area
        for some in (current, current + step, 0.0, step)
    ]
    here, rest = (pumped[1] - pumped[0]) / 1e-4, (pumped[3] - pumped[2]) / 1e-4
    assert rate == pytest.approx(min(here, rest), rel=1e-2)


@pytest.mark.parametrize("current", [2.6, 6.0])
def test_a_slow_driver_is_never_planned_with_as_one_that_is_not(current: float) -> None:
    """At the current with which the module pumps most the flux does not change; a rate of 0 would mean any."""
    law, state = law_of(replace(PARAMS, resistance=6.0))
    rates = [slew.rate(law.constants, state["theta"], some, 296.15) for some in (0.0, current)]
    assert 0.0 < rates[1] < 0.2 * rates[0]


@pytest.mark.parametrize("heat", [3.0, -30.0, 300.0, 3000.0])
def test_heat_that_is_taken_away_is_not_taken_too_far(heat: float) -> None:
    """The flux changes no faster than the driver lets it, and yet the plate does not pass its target."""
    step, within, most = 1e-4, 12e-3, 6e5
    left, flux, passed = heat, 0.0, 0.0
    for _ in range(round((2.2 * (abs(heat) / most) ** 0.5 + 8.0 * within) / step)):
        asked = slew.braked(left, within, most)
        flux += max(-most * step, min(most * step, asked - flux))
        left -= flux * step
        passed = max(passed, -left * np.sign(heat))
    assert passed < 0.02 * abs(heat)
    assert abs(left) < 2e-3 * abs(heat), "the way took much longer than the driver needs"


def test_a_plan_goes_only_as_far_as_its_flux_can_come_back() -> None:
    """Back at rest by the time the heat is moved, or within half the plan."""
    heat, most = 300.0, 1e4
    flux, moved = slew.way(heat, 0.12, most), 0.0
    while flux > 0.0:
        flux, moved = flux - most * 1e-5, moved + flux * 1e-5
    assert moved == pytest.approx(heat, rel=1e-3)
    assert slew.way(-heat, 0.12, most) == slew.way(heat, 0.12, most)
    assert slew.way(1e-3, 0.12, most) == pytest.approx(0.06 * most)


@pytest.mark.parametrize("lag", [0.2, 0.3, 0.5, 1.0, 2.0])
def test_a_plate_that_was_disturbed_is_known_again_when_learning_goes_on(lag: float) -> None:
    """However slow its sensor is: its reading is behind the plate by that lag."""
    law, state = law_of(replace(PARAMS, plate_lag=lag))
    _, plant = law_of(replace(PARAMS, plate_lag=lag))
    n, column = law.fine.tissue.shape[1], law.fine.tissue.shape[1] + law.fine.plate.shape[1]
    plant["x"][0, n:column] += law.fine.flat
    plant["x"][0, [column + at.X_FACE, column + at.X_BACK]] += 1.0
    flux, tick = 5e3, 0
    while tick == 0 or state["memory"][at.M_QUIET] > 0.0:
        law.track(plant, 0.0, np.nan, np.nan, np.nan)
        film = plant["x"][0, column + at.X_FILM] if tick % 20 == 0 else np.nan
        law.track(state, 0.0, flux, film, np.nan)
        flux, tick = state["x"][0, column + at.X_SEEN], tick + 1
    assert state["x"][0, column + at.X_FACE] == pytest.approx(plant["x"][0, column + at.X_FACE], abs=0.1)


def test_no_knot_of_a_plan_is_further_from_the_one_before_than_the_driver_gets() -> None:
    work = np.zeros(planner.HATS * (planner.HATS + 1))
    work[: planner.HATS**2] = np.eye(planner.HATS).ravel()
    work[planner.HATS**2 :] = 1e6
    knots, limits = np.zeros(planner.HATS), planner.Slew(100.0, 5.0, 2e4, 0.0, 1e9)
    planner._solve_slewing(work, knots, 1e9, limits)
    assert knots == pytest.approx(105.0 + 2e4 * np.array(planner.KNOTS))
