"""Ticks that a late loop leaves out, in which a wire goes on by itself: what had flowed meanwhile counts."""

from __future__ import annotations

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch_thermal.flux.model_over_wire import take
from itouch_thermal.flux.predictive import leave_out


@pytest.fixture(scope="module")
def host() -> itouch.Session:
    """A session on hardware behind wires, which nobody has opened."""
    return itouch.build(SCENES / "four_materials_wire.xml")


#: Ticks before a gap, and how long it is; the current that stands at first, and when it has left [ticks].
BEFORE, GAP, STANDS, SINCE = 40, 60, 0.4, 30


@pytest.mark.parametrize(
    "leaves",
    [
        {},  # nothing: the whole process has slept
        {BEFORE + 25: -1.0 - 0.01 * (BEFORE - 3)},  # what was sent three ticks before
        {BEFORE: -1.0 - 0.01 * BEFORE, BEFORE + 50: 0.0},  # the newest at once, and what is safe when no more came
        {SINCE + GAP: -1.0 - 0.01 * BEFORE},  # a tick that is numbered as that of one before the gap
    ],
    ids=["nothing", "what was sent", "what is safe", "the same number"],
)
def test_the_law_goes_on_in_a_gap_under_the_currents_that_had_left(
    host: itouch.Session, leaves: dict[int, float]
) -> None:
    """Ticks that were left out are as ticks without a reading: the wire goes on by itself, and tells the last only."""
    model = next(one.model for one in host.model.modalities if one.name == "flux-control")
    names, found = model.names, []
    for slept in (False, True):
        state = host.state.copy()
        state[names.acting] = state[names.before] = state[names.out] = state[names.sent] = STANDS
        state[names.departed], state[names.left], state[names.sent_log] = SINCE, SINCE, STANDS
        for tick in range(SINCE + 1, BEFORE + GAP + 4):
            asleep = BEFORE < tick <= BEFORE + GAP
            now = tick if not slept or tick <= BEFORE else tick - GAP  # by the loop's count
            if tick - 1 in leaves:  # told a tick later
                state[names.out], state[names.left] = leaves[tick - 1], now - 1
            if slept and asleep:
                if tick == BEFORE + 1:
                    leave_out(model, state, GAP)
                continue
            if slept and tick == BEFORE + GAP + 1 and leaves:
                state[names.left] = max(leaves) - GAP
            state["tick"] = now
            take(model, model.law, state, True, now, 1.0, 0.0)
            state[names.sent] = -1.0 - 0.01 * min(tick, BEFORE)  # the command of this tick; asleep, none is new
        found.append({name: state[f"{model.law.prefix}{name}"].copy() for name in ("x", "theta", "memory", "cover")})
    for name, value in found[0].items():
        np.testing.assert_array_equal(value, found[1][name], err_msg=name)
