"""A modality's update in Python, as a subclass may call it in every tick, runs calls that are bound once."""

from __future__ import annotations

import gc
from typing import Any

import pytest
from shipped import SCENES

import itouch
from itouch.plugin import Bound, Field, Record
from itouch.plugin.bound import bound_once
from itouch.plugin.discovery import Catalog
from itouch.plugin.kernels import kernel
from itouch.session import Session
from itouch.world import Model


@kernel
def _grown(x: Any, period: float) -> int:
    """Grow ``x`` (1,) [1], which is float64."""
    x[0] += period
    return 0


class _Counted:
    def __init__(self) -> None:
        self.bound = 0
        self.offers = True

    def bound_update(self, model: object, state: Record, period: float) -> Bound | None:
        self.bound += 1
        return Bound(_grown, state["x"], period) if self.offers else None


def test_calls_are_bound_once_for_each_state_model_and_period() -> None:
    one, other = _Counted(), _Counted()
    states = [Record.of([Field("x", "f8", 1)]) for _ in range(2)]
    model, model_2 = object(), object()
    for _ in range(3):
        for state in states:
            for call in bound_once(one.bound_update, model, state, 0.25):
                call()
    assert (one.bound, [state["x"].item() for state in states]) == (2, [0.75, 0.75])
    bound_once(one.bound_update, model, states[0], 0.5)[0]()
    bound_once(one.bound_update, model_2, states[0], 0.25)
    bound_once(other.bound_update, model, states[0], 0.25)
    assert (one.bound, other.bound, states[0]["x"].item()) == (4, 1, 1.25)


def test_a_method_that_offers_nothing_is_asked_again() -> None:
    one, state = _Counted(), Record.of([Field("x", "f8", 1)])
    one.offers = False
    assert bound_once(one.bound_update, None, state, 0.1) == bound_once(one.bound_update, None, state, 0.1) == ()
    assert one.bound == 2


def test_what_is_bound_goes_with_its_state() -> None:
    from itouch.plugin import bound

    def kept() -> int:
        return sum(owner is one for _, owner, _ in bound._once.values())

    state = Record.of([Field("x", "f8", 1)])
    one = _Counted()
    bound_once(one.bound_update, None, state, 0.1)
    assert kept() == 1
    del state
    gc.collect()
    assert kept() == 0


@pytest.mark.parametrize("kind", ["Heat", "Encountered"])
def test_an_update_that_goes_through_python_binds_once_and_does_the_same(kind: str) -> None:
    def run(through_python: bool) -> tuple[bytes, int]:
        model, times = Model.of(itouch.load(SCENES / "four_materials_hurried.xml"), Catalog()), 0
        (one,) = (each.instance for each in model.modalities if type(each.instance).__name__ == kind)
        original: Any = one.bound_update

        def counted(*given: Any) -> Any:
            nonlocal times
            times += 1
            return original(*given)

        if through_python:
            update: Any = one.update
            one.update = lambda *given: update(*given)  # as a subclass would that calls super().update
        one.bound_update = counted
        session = Session(model)
        times = 0
        session.run(7.6)  # into the first touch
        assert session.state["finger.object"].item() >= 0
        found = session.state.tobytes()
        session.close()
        return found, times

    compiled, in_python = run(through_python=False), run(through_python=True)
    assert compiled[0] == in_python[0]
    assert compiled[1] == 0 and in_python[1] <= 1
