"""How far a plate is below a finger: the kernel's own Python."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernels_in_python import python_of

from itouch.twin import frame_rotation, mechanics
from itouch.twin import mechanics as at

ORIGIN, RADIUS, PERIOD = np.array((0.3, -0.2, 0.1)), 0.008, 1e-3
#: The middle of the plate's top from its carrier.
OFFSET = np.array((0.004, -0.007, 0.02))
#: Turned by a quarter about the vertical: the device's x is the world's y.
QUARTER = np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))


@pytest.fixture(autouse=True)
def python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the kernels call one another as Python."""
    for name in ("turned_in", "turned_out", "beside"):
        monkeypatch.setattr(mechanics, name, python_of(getattr(frame_rotation, name)))


def constants() -> Any:
    made = np.zeros(at.CONSTANTS)
    made[at.TABLE : at.TABLE + 3], made[at.TABLE + 3 : at.TABLE + 12] = ORIGIN, QUARTER.ravel()
    made[at.OFFSET : at.OFFSET + 3] = OFFSET
    made[at.EXTENT : at.EXTENT + 2], made[at.HEADING] = (0.02, 0.01), 1.0
    made[at.RADIUS], made[at.PERIOD], made[at.PAD_STIFFNESS] = RADIUS, PERIOD, 1000.0
    return made


@pytest.mark.parametrize(
    ("away", "height", "gap"),
    [
        ((0.0, 0.0), 5e-3, 5e-3),
        ((0.019, 0.009), -1e-3, -1e-3),
        ((0.021, 0.0), -1e-3, at.BESIDE),  # beside it nothing is touched, however low the finger is
        ((-0.021, 0.0), -1e-3, at.BESIDE),
        ((0.0, 0.011), -1e-3, at.BESIDE),
        ((0.0, -0.011), -1e-3, at.BESIDE),
        ((0.021, 0.0), 5e-3, 5e-3),
    ],
)
def test_the_gap_between_finger_and_plate_is_where_the_plate_is(
    away: tuple[float, float], height: float, gap: float
) -> None:
    table, figures = np.array((0.05, 0.03, 0.01)), np.zeros(at.FIGURES)
    figures[at.DISTANCE] = gap  # at rest
    middle = table + OFFSET
    finger = ORIGIN + QUARTER @ (middle + (*away, height + RADIUS))
    found = python_of(mechanics.plate_force)(constants(), finger, table, figures)
    assert found == pytest.approx(gap, abs=1e-12) == figures[at.DISTANCE]
    assert figures[at.TOP] == pytest.approx(0.1 + 0.03, abs=1e-12)
    assert figures[at.FORCE] == pytest.approx(max(0.0, -1000.0 * gap), abs=1e-9)


@pytest.mark.parametrize("heading", np.radians([-60.0, 30.0, 45.0, 90.0, 180.0]))
def test_the_edges_of_a_turned_plate_are_turned(heading: float) -> None:
    table = np.array((0.05, 0.03, 0.01))
    made = constants()
    made[at.HEADING : at.HEADING + 2] = np.cos(heading), np.sin(heading)
    turn = np.array(
        ((np.cos(heading), -np.sin(heading), 0.0), (np.sin(heading), np.cos(heading), 0.0), (0.0, 0.0, 1.0))
    )
    for away, beside in (
        ((0.019, 0.009), False),
        ((-0.019, 0.009), False),
        ((0.021, 0.0), True),
        ((0.0, -0.011), True),
    ):
        figures = np.zeros(at.FIGURES)
        finger = ORIGIN + QUARTER @ (table + OFFSET + turn @ (*away, RADIUS - 1e-3))
        gap = python_of(mechanics.plate_force)(made, finger, table, figures)
        assert gap == pytest.approx(at.BESIDE if beside else -1e-3, abs=1e-12), (away, heading)
