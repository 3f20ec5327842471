"""How hard a finger presses on a surface behind a wire, from a force that is late and how it has moved since."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from kernels_in_python import python_of

from itouch.plugin.carried_surfaces import ABOUT, LEFT, TOUCH
from itouch_encountered import over_wire
from itouch_encountered.surface_fields import (
    BEHIND,
    GOES,
    GONE_BY,
    HOISTS,
    HOLD,
    LAG,
    LIFTS,
    PAST,
    PRESSES,
    RISE,
    SINCE,
    UPRIGHT,
    WAY,
)

STIFFNESS, RADIUS, TICK, AGE = 1000.0, 0.008, 200, 7
LIGHT, FIRM = 0.5 * (LEFT + TOUCH), 1.0


def pressed(force: float, before: float, now: float, age: int = AGE, *, load: bool = True) -> float:
    """Return what is told of a force read [N] while the finger was so deep in the surface, as it is so deep now [m]."""
    own = np.zeros(GONE_BY + 3 * PAST)
    own[GONE_BY + 3 * ((TICK - age) % PAST) + 2] = -before
    own[SINCE] = 0.5e-3  # it has risen since, and the finger with it
    c = SimpleNamespace(has_load=load, stiffness=STIFFNESS, radius=RADIUS)
    w: Any = SimpleNamespace(load=(0.0, 0.0, -force), tick=(TICK,), hip=(0.0, 0.0, RADIUS + own[SINCE] - now))
    return float(python_of(over_wire._pressed)(c, own, w, 0.0, age))


@pytest.mark.parametrize(
    ("force", "before", "now", "told"),
    [
        (FIRM, 1e-3, 1e-3, FIRM),  # as it was
        (FIRM, 1e-3, 1.5e-3, FIRM + 0.5),  # half a millimetre deeper
        (FIRM, 1e-3, -1e-3, 0.0),  # it has left: nothing pulls
        (LIGHT, 0.0, 0.0, LIGHT),  # a light touch of a surface that is there
        (LIGHT, 0.1e-3, 0.3e-3, LIGHT + 0.2),
        (LIGHT, -2.0 * ABOUT, 0.3e-3, 0.3),  # it was not there: what was read was no touch, and now there is one
        (0.5 * LEFT, 0.0, 0.2e-3, 0.2),
        (0.5 * LEFT, 0.1e-3, 0.3e-3, 0.2),  # it was in it and felt nothing: it begins deeper
    ],
)
def test_a_force_that_was_read_is_corrected_by_the_way_since(
    force: float, before: float, now: float, told: float
) -> None:
    assert pressed(force, before, now) == pytest.approx(told, abs=1e-9)


@pytest.mark.parametrize(("age", "load"), [(PAST, True), (-1, True), (AGE, False)])
def test_what_is_too_old_to_be_corrected_stands_as_it_was_read(age: int, load: bool) -> None:
    assert pressed(FIRM, 1e-3, 5e-3, age, load=load) == FIRM
    assert not math.isnan(pressed(0.0, 0.0, 0.0, age, load=load))


@pytest.mark.parametrize("slopes", [(0.2, 0.0), (0.0, -0.3), (0.1, 0.4)])
def test_the_surface_is_foreseen_by_how_the_finger_goes_along_its_slope(
    slopes: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A command that is sent now acts when the wire and the device's lag are over."""
    for name in ("_follow", "_follow_lift", "_watch_wire", "_learn"):
        monkeypatch.setattr(over_wire, name, lambda *words: None)
    for name, value in (
        ("_height", 0.0), ("_commanded", math.nan), ("_since", 0.0), ("_pressed", 0.0), ("_highest", math.nan),
        ("top", 0.0),
    ):  # fmt: skip
        monkeypatch.setattr(over_wire, name, lambda *words, value=value: value)
    own = np.zeros(GONE_BY + 3 * PAST)
    own[WAY], own[LAG], period = 0.02, 0.009, 1e-3
    for axis, speed, hastens in ((0, 0.10, 2.0), (1, -0.05, 4.0)):
        own[GOES + 3 * axis + 1], own[GOES + 3 * axis + 2] = speed, hastens
    own[LIFTS], own[HOISTS] = 0.03, -1.0
    w: Any = SimpleNamespace(
        tick=(TICK,), measured=(TICK - AGE,), hip=(0.0, 0.0, 0.0), pose=np.zeros(7), frame=np.zeros(12), lifts=(0.0,),
        slope_x=(slopes[0],), slope_y=(slopes[1],),
    )  # fmt: skip
    assert python_of(over_wire.look_over_wire)(SimpleNamespace(period=period, radius=RADIUS), w, own) == 0
    ahead = 0.02 + 0.009 + period
    goes = [0.10 * ahead + 2.0 * ahead**2 / 2.0, -0.05 * ahead + 4.0 * ahead**2 / 2.0]
    lifts = 0.03 * ahead - ahead**2 / 2.0
    assert own[RISE] == pytest.approx(float(np.dot(slopes, goes)) + lifts, rel=1e-12)


@pytest.mark.parametrize("lag", [0.0, 0.004])
def test_the_surface_has_gone_on_since_it_was_read_as_its_commands_have(
    lag: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One command leaves in each tick, and each sends the surface further up: it follows by the device's lag."""
    for name in ("_follow", "_follow_lift", "_watch_wire", "_learn"):
        monkeypatch.setattr(over_wire, name, lambda *words: None)
    for name in ("_height", "_commanded", "_since", "_pressed", "_highest", "top"):
        monkeypatch.setattr(over_wire, name, python_of(getattr(over_wire, name)))
    rise, size, period = 1e-4, 2 * AGE, 1e-3
    gone = np.zeros((size, 4))
    for tick in range(TICK - size, TICK):
        gone[tick % size] = tick, 0.0, 0.0, rise * tick
    own, frame = np.zeros(GONE_BY + 3 * PAST), np.zeros(12)
    own[LAG], own[HOLD], frame[UPRIGHT] = lag, period, 1.0
    w: Any = SimpleNamespace(
        tick=(TICK,), measured=(TICK - AGE,), hip=(0.0, 0.0, 0.0), pose=np.zeros(7), frame=frame, lifts=(0.0,),
        slope_x=(0.0,), slope_y=(0.0,), gone=gone, goings=(TICK,), load=np.zeros(6),
    )  # fmt: skip
    c = SimpleNamespace(period=period, radius=RADIUS, has_load=False, stiffness=STIFFNESS, x=0.0, y=0.0, z=0.0)
    assert python_of(over_wire.look_over_wire)(c, w, own) == 0
    assert own[SINCE] == pytest.approx(AGE * rise, rel=1e-9)
    assert own[BEHIND] == pytest.approx(rise * (TICK - 1) - AGE * rise, rel=1e-9)  # what was read is at the origin


@pytest.mark.parametrize("higher", [0.0, 4e-3])
def test_a_finger_presses_on_the_face_wherever_on_the_device_that_is(
    higher: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plate that lies on the table is higher than the table's pose; the finger has come to it since it was read."""
    for name in ("_follow", "_follow_lift", "_watch_wire", "_learn"):
        monkeypatch.setattr(over_wire, name, lambda *words: None)
    for name, value in (("_commanded", math.nan), ("_since", 0.0), ("_highest", math.nan)):
        monkeypatch.setattr(over_wire, name, lambda *words, value=value: value)
    for name in ("_height", "_pressed", "top"):
        monkeypatch.setattr(over_wire, name, python_of(getattr(over_wire, name)))
    own, frame, deep = np.zeros(GONE_BY + 3 * PAST), np.zeros(12), 0.2e-3
    own[GONE_BY + 3 * ((TICK - AGE) % PAST) + 2], frame[UPRIGHT] = higher + 0.3e-3, 1.0
    w: Any = SimpleNamespace(
        tick=(TICK,), measured=(TICK - AGE,), hip=(0.0, 0.0, RADIUS + higher - deep), pose=np.zeros(7), frame=frame,
        lifts=(0.0,), slope_x=(0.0,), slope_y=(0.0,), load=np.zeros(6), loud=(0.0,),
    )  # fmt: skip
    c = SimpleNamespace(period=1e-3, radius=RADIUS, has_load=True, stiffness=STIFFNESS, x=0.0, y=0.0, z=higher)
    assert python_of(over_wire.look_over_wire)(c, w, own) == 0
    assert own[PRESSES] == pytest.approx(STIFFNESS * deep)


@pytest.mark.parametrize(("since", "highest"), [(TICK, 1e-4), (TICK - 8, 3e-4), (TICK - 12, 5e-4), (TICK - 20, 5e-4)])
def test_a_surface_may_be_as_high_as_the_highest_of_the_commands_that_have_acted(
    since: int, highest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The one counts, too, that acted when it was read."""
    monkeypatch.setattr(over_wire, "_height", python_of(over_wire._height))
    gone, frame = np.zeros((8, 4)), np.zeros(12)
    for i, (tick, height) in enumerate(((TICK - 15, 5e-4), (TICK - 10, 3e-4), (TICK - 5, 1e-4))):
        gone[i] = tick, 0.0, 0.0, height
    frame[UPRIGHT] = 1.0
    found = [python_of(over_wire._highest)(SimpleNamespace(gone=gone, goings=(n,), frame=frame), since) for n in (3, 0)]
    assert found[0] == pytest.approx(highest)
    assert math.isnan(found[1])
