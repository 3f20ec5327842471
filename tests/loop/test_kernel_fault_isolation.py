"""Compiled functions of plugins that raise: the session stops as for Python's, and whose fault it was is said by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_plugin_fault_isolation import Hum, Rod, RodTwin, engine

import itouch
from itouch import joining
from itouch.plugin import Bound, Contact, ContactArrays, Device, Field, Modality, Record, TwinInputs
from itouch.plugin.kernels import kernel
from itouch.safety import Trip


@kernel
def _last(count: Any, most: int) -> int:
    count[0] += 1
    if count[0] > most:
        raise ValueError("no such tone")
    return 0


@kernel
def _hear(event: Any, count: Any, most: int) -> int:
    if event.kind[0] >= 0:
        count[0] += 1
        if event.tick[0] > most:
            raise ValueError("no such tone")
    return 0


@kernel
def _follow(place: Any, finger: Any, count: Any, most: int) -> int:
    count[0] += 1
    if count[0] > most:
        raise ValueError("no such tone")
    for i in range(3):
        place[i] = finger[i]
    return 0


@kernel
def _measure(pose: Any, place: Any, count: Any, most: int) -> int:
    count[0] += 1
    if count[0] > most:
        raise ValueError("no such tone")
    for i in range(7):
        pose[i] = place[i]
    return 0


def updating(most: int) -> tuple[type[Modality], None]:
    class Quick(Hum):
        def bound_update(self, model: Any, state: Record, period: float) -> Bound:
            return Bound(_last, state["hum.count"], most)

        def update(self, model: Any, state: Record, period: float) -> None:
            self.bound_update(model, state, period)()

    return Quick, None


def hearing(most: int) -> tuple[type[Modality], None]:
    class Quick(Hum):
        subscribes_to = frozenset({Contact.NEAR, Contact.BEGIN, Contact.MOVE, Contact.END})

        def bound_update(self, model: Any, state: Record, period: float) -> Bound:
            return Bound(_last, state["hum.count"], 1 << 40)

        def update(self, model: Any, state: Record, period: float) -> None:
            self.bound_update(model, state, period)()

        def bound_contact(self, model: Any, state: Record, event: ContactArrays) -> Bound:
            return Bound(_hear, event, state["hum.count"], most)

    return Quick, None


class QuickTwin(RodTwin):
    """A rod whose step and reading are compiled."""

    steps = looks = 1 << 40

    def fields(self) -> tuple[Field, ...]:
        return (*super().fields(), Field("steps", "i8", low=0), Field("looks", "i8", low=0))

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        super().reset(state, rng)
        state["steps"] = state["looks"] = 0

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound:
        return Bound(_follow, state["place"], touch.finger_pose, state["steps"], self.steps)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        self.bound_step(state, command, touch, period)()

    def bound_read(self, state: Record, reading: Record) -> Bound:
        return Bound(_measure, reading["pose"], state["place"], state["looks"], self.looks)

    def read(self, state: Record, reading: Record) -> None:
        self.bound_read(state, reading)()


def stepping(most: int) -> tuple[None, type[Device]]:
    return None, type("Bent", (Rod,), {"Twin": type("Steps", (QuickTwin,), {"steps": most})})


def reading(most: int) -> tuple[None, type[Device]]:
    return None, type("Bent", (Rod,), {"Twin": type("Looks", (QuickTwin,), {"looks": most})})


KINDS = {
    "update": (updating, Trip.MODALITY_ERROR, "has lost its modality 'hum', which failed in update"),
    "contact": (hearing, Trip.MODALITY_ERROR, "has lost its modality 'hum', which failed in on_contact"),
    "step": (stepping, Trip.DEVICE_ERROR, "failed in the step of its twin"),
    "read": (reading, Trip.DEVICE_ERROR, "failed in read"),
}


@pytest.mark.parametrize("joins", [True, False], ids=["joined", "alone"])
# parts are timed in tick 128, to which 127 or 128 leads
@pytest.mark.parametrize("most", [127, 128, pytest.param(130, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", KINDS)
def test_a_kernel_that_raises_makes_safe_and_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, most: int, joins: bool
) -> None:
    if not joins:
        for module in ("joining", "loop.plan", "loop.events"):
            monkeypatch.setattr(f"itouch.{module}.can_join", lambda: False)
    made, trip, cause = KINDS[kind]
    session = engine(tmp_path, *made(most))
    whole = [len(piece) for piece in session.plan.pieces] == [len(session.plan.steps)]
    assert whole == (joins and joining.can_join())  # else it is tried in one form only
    with pytest.raises(itouch.DeviceFaultError) as caught:
        session.run()
    assert (caught.value.device, caught.value.trip) == ("arm", trip)
    assert f"{cause}: ValueError: no such tone (test_kernel_fault_isolation.py, line " in caught.value.cause
    assert isinstance(caught.value.__cause__, ValueError | itouch.ItouchError)
    assert session.status("arm").name == "FAULT"
    assert not session.state["arm.sent.wrench"].any()
    (told,) = session.report()["faults"]
    assert (told["trip"], told["safe"]["reached"]) == (trip.label, True)
    if kind == "read":  # a device in FAULT that still can't be read does not fail again
        session.run(0.05)
        assert len(session.report()["faults"]) == 1
    session.close()
