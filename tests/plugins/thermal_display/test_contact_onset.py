"""When the finger came to the plate, as the force on it tells over a wire of its own: late, seldom, at odd times."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from shipped import SCENES

import itouch
from itouch.plugin import Record
from itouch_thermal.flux import contact_events, flux_tick, joined, predictive
from itouch_thermal.flux.approach import TOUCHED
from itouch_thermal.flux.flux_model import FluxModel
from itouch_thermal.flux.law import PRIOR_ONSET

#: When the finger came, and how fast its force grows [N a tick], up to how much [N].
CAME, GROWS, FULL = 300, 0.02, 0.9


@pytest.fixture(scope="module")
def host() -> itouch.Session:
    """A session on hardware behind wires, which nobody has opened."""
    return itouch.build(SCENES / "four_materials_wire.xml")


def force(tick: int) -> float:
    return min(FULL, max(0.0, GROWS * (tick - CAME)))


def came(model: FluxModel, state: Record) -> tuple[int, float]:
    """Return how many ticks ago the finger came, and the standard deviation of that [s]."""
    scene, own, _, figures, course, *_ = joined.tick_of(model, state).prepare.arguments
    return flux_tick.since(scene, own, figures, course)


def leave(model: FluxModel, state: Record) -> None:
    """Let the finger leave the plate."""
    scene, own, _, figures, course, models, memory, _ = joined.tick_of(model, state).prepare.arguments
    contact_events.take_off(scene, own, course, figures, models, memory)


def readings(old: int, every: int, phase: int) -> Iterator[tuple[int, int]]:
    """Yield ticks, each with when the newest reading in it was measured, which is this old when it comes."""
    measured = 0
    for tick in range(200, 500):
        if (tick + phase) % every == 0:
            measured = tick - old
        yield tick, measured


@given(
    old=st.integers(0, 12), every=st.integers(1, 20), phase=st.integers(0, 19), begins=st.integers(-10, 35)
)  # fmt: skip
@example(old=4, every=3, phase=0, begins=5)
@example(old=0, every=1, phase=0, begins=30)
def test_a_force_that_comes_late_and_seldom_tells_when_the_finger_came(
    host: itouch.Session, old: int, every: int, phase: int, begins: int
) -> None:
    """It is right to half the time between two readings, also where the virtual contact begins before or after."""
    model = next(one.model for one in host.model.modalities if one.name == "flux-control")
    state = host.state.copy()
    field, at = model.force_at
    state[model.names.came_doubt] = 0.0
    for tick, measured in readings(old, every, phase):
        state["tick"], state[field][at] = tick, measured
        state[model.force_from][2] = force(measured)
        predictive.feel(model, state)
        if force(measured) > TOUCHED and tick >= CAME + begins:
            ago, doubt = came(model, state)
            assert abs((tick - ago) - CAME) <= 0.5 * every + 2.0
            assert 0.0 < doubt <= PRIOR_ONSET
            return
    raise AssertionError("the finger was never felt")


def test_a_slide_to_another_object_keeps_the_onset_at_the_end_of_the_touch_before(host: itouch.Session) -> None:
    """It has been there for seconds, but what the plate has done to it since is known."""
    model = next(one.model for one in host.model.modalities if one.name == "flux-control")
    names, state = model.names, host.state.copy()
    field, at = model.force_at
    state[model.force_from][2], state[names.tracked] = FULL, 5000
    state[names.on_plate], state[names.came], state[names.came_doubt] = 1, 3000, 1e-3
    state["tick"] = state[field][at] = 5000
    leave(model, state)
    state["tick"] = state[field][at] = 5001
    predictive.feel(model, state)
    assert came(model, state)[0] == 1
    state[model.force_from][2], state["tick"], state[field][at] = 0.0, 5100, 5100
    predictive.feel(model, state)
    state[model.force_from][2], state["tick"], state[field][at] = FULL, 5200, 5200
    predictive.feel(model, state)
    assert came(model, state)[0] > 1  # it had left meanwhile
