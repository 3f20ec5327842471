"""Where a finger is, what is looked up below it, how slowly a plate that is taken away leaves it: the kernels' own Python."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from kernels_in_python import python_of

from itouch.loop import probe_steps, render
from itouch.loop.surface import force, ground, plate
from itouch.loop.surface import surface_memory as at
from itouch.plugin import carried_surfaces
from itouch.twin import frame_rotation

ORIGIN, RADIUS, PERIOD = np.array((0.3, -0.2, 0.1)), 0.008, 1e-3


@pytest.fixture(autouse=True)
def python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the kernels call one another as Python."""
    for name in ("turned_in", "turned_out", "beside", "top"):
        monkeypatch.setattr(plate, name, python_of(getattr(plate, name)))
    monkeypatch.setattr(force, "on_plate", python_of(force.on_plate))


@pytest.mark.parametrize(("mounted", "part"), [(0.0, 1.0), (math.radians(60.0), 0.5)])
@pytest.mark.parametrize("pressed", [1.0, 0.0])
def test_a_plate_that_is_taken_away_goes_down_slowly_along_its_own_axis(
    mounted: float, part: float, pressed: float
) -> None:
    c, memory = np.zeros(render.CONSTANTS), np.zeros(at.MEMORY)
    turn = ((1.0, 0.0, 0.0), (0.0, math.cos(mounted), -math.sin(mounted)), (0.0, math.sin(mounted), math.cos(mounted)))
    c[plate.TABLE : plate.TABLE + 3], c[plate.TABLE + 3 : plate.TABLE + 12] = ORIGIN, np.ravel(turn)
    c[plate.PAD_STIFFNESS], c[plate.PERIOD], c[plate.HAS_LOAD], c[plate.RADIUS] = 1000.0, PERIOD, 1.0, RADIUS
    sent, goal = (np.array((0.0, 0.0, z, 1.0, 0.0, 0.0, 0.0)) for z in (0.02, 0.03))
    memory[plate.LEVEL] = plate.top(c, sent) + 1e-3
    lowest = python_of(plate.withdrawal_floor)(c, memory, goal, sent, pressed)
    if pressed == 0.0:
        assert lowest == -math.inf  # clear of the finger, it may go as fast as it can
    else:
        assert lowest == pytest.approx(0.02 - plate.LETS_GO / 1000.0 * PERIOD / part, abs=1e-12)


@pytest.mark.parametrize(("risen", "higher"), [(math.nan, 0.0), (0.0, 0.0), (2e-4, 2e-4)])
@pytest.mark.parametrize(("presses", "load"), [(math.nan, -1.5), (0.0, 0.0), (2.0, -2.0)])
def test_what_a_modality_does_not_say_of_its_surface_is_as_it_was_read(
    risen: float, higher: float, presses: float, load: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[float] = []
    monkeypatch.setattr(probe_steps, "ground", SimpleNamespace(find=lambda *words: 3))
    monkeypatch.setattr(
        probe_steps, "plate", SimpleNamespace(foresee=lambda c, table, figures, kept, *of: told.extend(of))
    )
    own: Any = SimpleNamespace(c=None, figures=None, kept=np.zeros(at.MEMORY))
    objects: Any = SimpleNamespace(world=None, mesh=None, poses=None, twists=None)
    below, read = np.zeros(1, np.int64), np.array((0.0, 0.0, -1.5, 0.0, 0.0, 0.0))
    said = probe_steps.StatedReadings(np.array([presses]), np.array([risen]), np.array([0.01]))
    parts = np.zeros(7), read, said, below, np.zeros(3), np.zeros(3), np.zeros(3)
    assert python_of(probe_steps.look_below)(own, objects, *parts, np.zeros(0, np.int64), False) == 0
    assert (told, below.tolist()) == ([load, higher], [3])


@pytest.mark.parametrize(
    ("distance", "depth"),
    [(3e-3, [-3e-3 - 2e-4]), (-5e-4, [5e-4 - 2e-4]), (math.inf, [-1.0 - 2e-4]), (-math.inf, [1.0 - 2e-4]), (math.nan, [])],
)  # fmt: skip
def test_behind_a_wire_a_surface_is_as_deep_in_the_finger_as_its_modality_says(
    distance: float, depth: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Out of reach it is far away, and not as near as it was last: what it read then would go on being felt."""
    told, believed = list[float](), list[float]()
    estimate = SimpleNamespace(
        estimate_late=lambda c, kept, load, presses, deep, measured: told.append(deep),
        believe=lambda kept, reading: believed.append(reading), believed=lambda kept, load: load,
    )  # fmt: skip
    monkeypatch.setattr(probe_steps, "force_estimate", estimate)
    monkeypatch.setattr(probe_steps, "ground", SimpleNamespace(find=lambda *words: 3))
    monkeypatch.setattr(probe_steps, "plate", SimpleNamespace(foresee=lambda *words: None))
    c, figures = np.zeros(render.CONSTANTS), np.zeros(render.FIGURES)
    c[render.PERIOD], figures[render.VELOCITY + 2] = PERIOD, 0.2  # it goes up by 0.2 mm a tick
    own: Any = SimpleNamespace(c=c, figures=figures, kept=np.zeros(at.MEMORY))
    objects: Any = SimpleNamespace(world=None, mesh=None, poses=None, twists=None)
    said = probe_steps.StatedReadings(np.array([0.5]), np.zeros(1), np.array([distance]))
    parts = np.zeros(7), np.zeros(6), said, np.zeros(1, np.int64), np.zeros(3), np.zeros(3), np.zeros(3)
    assert python_of(probe_steps.look_below)(own, objects, *parts, np.zeros(1, np.int64), False) == 0
    assert told == pytest.approx(depth)
    assert believed == ([] if depth else [0.5])  # what it says of the force, where it says nothing of the distance


def test_the_finger_is_where_its_tracker_is_mounted_and_its_speed_is_smoothed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render, "turned_out", python_of(frame_rotation.turned_out))  # type: ignore[attr-defined]
    c, figures = np.zeros(render.CONSTANTS), np.zeros(render.FIGURES)
    quarter = np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    c[render.TRACKER : render.TRACKER + 3], c[render.TRACKER + 3 : render.TRACKER + 12] = ORIGIN, quarter.ravel()
    c[render.PERIOD], c[render.SMOOTH] = PERIOD, 0.25
    places = np.array(((0.01, 0.02, 0.03), (0.011, 0.018, 0.0305)))
    for first, place in zip((True, False), places, strict=True):
        afresh, tick = np.array([int(first)]), np.array([7])
        assert python_of(render.follow)(c, np.r_[place, 1.0, 0.0, 0.0, 0.0], figures, afresh, tick) == 0
        assert afresh[0] == 0
        assert figures[render.HIP : render.HIP + 3] == pytest.approx(ORIGIN + quarter @ place, abs=1e-15)
        speed = np.zeros(3) if first else quarter @ (places[1] - places[0]) / PERIOD * 0.25
        assert figures[render.VELOCITY : render.VELOCITY + 3] == pytest.approx(speed, abs=1e-9)


@pytest.mark.parametrize(
    ("moves", "hit", "normal", "tilted", "slope"),
    [
        (0.02, 4, (0.6, 0.0, 0.8), 1.0, (-0.75, 0.0)),
        (0.02, 4, (0.0, -0.6, 0.8), 1.0, (0.0, 0.75)),
        (0.0, 4, (0.6, 0.0, 0.8), 1.0, (0.1, 0.2)),  # it stays where it is
        (0.02, -1, (0.6, 0.0, 0.8), 1.0, (0.3, 0.4)),  # nothing is there
        (0.02, 4, (0.98, 0.0, 0.199), 1.0, (0.3, 0.4)),  # what no plate follows
        (0.02, 4, (0.6, 0.0, 0.8), 0.5, (0.3, 0.4)),  # what this one, tilted as it is, does not render
    ],
)
def test_the_slope_is_that_of_where_the_finger_will_be_or_else_as_it_was(
    moves: float, hit: int, normal: tuple[float, ...], tilted: float, slope: tuple[float, float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    casts = list[list[float]]()

    def cast(*words: Any) -> tuple[float, int]:
        casts.append(words[3].tolist())
        words[-1][:] = normal
        return 1e-3, hit

    monkeypatch.setattr(ground, "sphere_cast", cast)
    monkeypatch.setattr(ground, "along_plate", python_of(ground.along_plate))
    c, memory, start = np.zeros(render.CONSTANTS), np.zeros(at.MEMORY), np.array(ORIGIN)
    c[render.PERIOD], c[render.PLATE_COSINE], c[render.TABLE + 11] = PERIOD, 0.7, tilted
    memory[at.SLOPE : at.SLOPE + 2], memory[at.GOES : at.GOES + 2] = (0.3, 0.4), (moves, -2.0 * moves)
    down, found = np.array((0.0, 0.0, -1.0)), np.zeros(3)
    told = python_of(ground._slope_ahead)(c, None, None, None, memory, start, down, found, 0.1, 0.2)
    assert told == pytest.approx(slope)
    way = np.array((moves, -2.0 * moves, 0.0)) * carried_surfaces.SLOPE_AHEAD
    assert casts == ([] if moves == 0.0 else [pytest.approx(ORIGIN + way)])
