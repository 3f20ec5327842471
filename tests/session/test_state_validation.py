"""What a stored State may hold: every number that is used as an index or a choice is in its declared range."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.plugin import Field
from itouch.session.session import Session
from itouch.session.state_validation import validate_state

HUGE = float(1 << 62)


@pytest.fixture(scope="module")
def session() -> Iterator[Session]:
    built = itouch.build(SCENES / "four_materials.xml", seed=3)
    built.run(1.0)
    yield built
    built.close()


def test_a_state_that_has_run_is_plausible(session: Session) -> None:
    validate_state(session.model, session.state)


@pytest.mark.parametrize(
    ("field", "index", "value"),
    [
        ("tick", None, -1), ("ready", None, 2), ("arm.status", None, 4), ("arm.status", None, -1),
        ("arm.ramp", None, 1.5), ("arm.ramp", None, -math.inf), ("arm.sent.wrench", 2, math.nan),
        ("table.sent.pose_target", 0, math.inf), ("table.surface.places", None, np.iinfo(np.int64).max),
        ("table.touch_off.stage", None, 9), ("table.touch_off.point", None, 3), ("table.touch_off.point", None, 900),
        ("finger.object", None, 99), ("finger.contact.object", None, -2), ("finger.near_object", None, 1 << 40),
        ("finger.memory", 5, math.nan), ("finger.memory", 5, 1e18), ("finger.memory", 6, 99.0), ("finger.memory", 12, -2.0),
        ("peltier.heat.samples", None, -5), ("peltier.heat.dose", None, -1e9), ("peltier.heat.share", None, 7.0),
        ("peltier.twin.memory", 23, 1e6), ("peltier.twin.memory", 23, math.nan), ("peltier.twin.memory", 23, -1.0),
        ("heat.object", None, 99), ("heat.skin_count", None, np.iinfo(np.int64).max),
        ("flux-control.object", None, 99), ("flux-control.preview_index", None, -7),
        ("flux-control.slots", 0, 1e18), ("flux-control.slots", 0, math.nan), ("flux-control.slots", 1, 1e6),
    ],
)  # fmt: skip
def test_what_would_be_used_as_an_index_is_refused(
    session: Session, field: str, index: int | None, value: float
) -> None:
    forged = session.state.copy()
    if index is None:
        forged[field] = value
    else:
        forged[field][index] = value
    with pytest.raises(ValueError, match=field.replace(".", r"\.")) as caught:
        validate_state(session.model, forged)
    assert "out of range" in str(caught.value)


def test_what_is_free_may_be_anything(session: Session) -> None:
    free = session.state.copy()
    free["peltier.twin.memory"][0] = math.nan
    free["finger.memory"][1] = -HUGE
    free["heat.desired"] = math.inf
    validate_state(session.model, free)


def test_a_field_has_a_range_for_all_or_for_each() -> None:
    Field("slot", "f8", 3, low=(0.0, -math.inf, -1.0), high=4.0)
    with pytest.raises(ValueError, match=r"state field 'slot': low has 2 numbers for size 3"):
        Field("slot", "f8", 3, low=(0.0, 1.0))


@pytest.fixture(scope="module")
def wired() -> Iterator[Session]:
    """A session on hardware behind wires, which nobody has opened."""
    built = itouch.build(SCENES / "four_materials_wire.xml")
    built.state["tick"] = 1000
    yield built
    built.close()


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("arm.left", 1 << 61, "later"), ("table.left", 2500, "later"), ("table.gone", 1e5, "later"),
        ("table.gone", math.nan, "out of range"), ("table.gone", -math.inf, "out of range"),
        ("table.measured", 1001, "later"), ("table.goings", -1, "out of range"),
    ],
)  # fmt: skip
def test_what_a_wire_has_brought_or_taken_is_not_of_the_future(
    wired: Session, field: str, value: float, says: str
) -> None:
    """The coupling is eased by when commands left, and a surface is held against where they sent it (K6)."""
    validate_state(wired.model, wired.state)
    forged = wired.state.copy()
    forged[field][...] = value
    with pytest.raises(ValueError, match=field.replace(".", r"\.")) as caught:
        validate_state(wired.model, forged)
    assert says in str(caught.value)
    if forged[field].size > 1 and "gone" not in field:  # each of them counts
        forged[field][...] = 0
        forged[field][-1] = value
        with pytest.raises(ValueError, match=field.replace(".", r"\.")):
            validate_state(wired.model, forged)
    on_its_way = wired.state.copy()
    on_its_way["table.left"] = on_its_way["table.gone"][:, 0] = 1020
    validate_state(wired.model, on_its_way)


@pytest.mark.parametrize("field", ["tick", "peltier.missed"])
def test_a_session_that_has_lasted_for_ages_is_none(session: Session, field: str) -> None:
    """Times are floats: beyond, one tick is no time, and neither a dose nor a time in contact would grow."""
    forged = session.state.copy()
    forged[field] = 1 << 45
    with pytest.raises(ValueError, match="none can have"):
        validate_state(session.model, forged)


@pytest.mark.parametrize(("device", "sent"), [("arm", "wrench"), ("peltier", "current")])
def test_a_closed_twin_is_off(session: Session, device: str, sent: str) -> None:
    """Nobody looks at one that is closed: what it was sent would act for ever."""
    forged = session.state.copy()
    forged[f"{device}.status"], forged[f"{device}.sent.{sent}"][0] = 0, 0.5
    with pytest.raises(ValueError, match=rf"{device}\.sent\.{sent} is not off"):
        validate_state(session.model, forged)
    forged[f"{device}.sent.{sent}"] = 0.0
    validate_state(session.model, forged)
