"""A driver whose current takes its time: the twin has it, and the controller counts on it, on its way and to come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from itouch.plugin import Field, Record, TwinInputs
from itouch_thermal.display.display_twin import DisplayTwin
from itouch_thermal.display.params import DisplayParams, Mismatch
from itouch_thermal.display.plant import CURRENT
from itouch_thermal.flux import observer as at
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
    laws, asked = [law_of(PARAMS), law_of(replace(PARAMS, slew=0.0))], []
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
