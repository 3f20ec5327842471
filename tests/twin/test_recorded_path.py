"""A hand that follows a recording: it rests at its ends, and passes each position as it was recorded."""

from __future__ import annotations

import numpy as np
import pytest

from itouch.twin.hand import RecordedPath
from itouch.world.recorded_motion import RecordedMotion

PLACES = np.array([(0.01, 0.02, 0.03), (0.02, 0.01, 0.05), (0.04, 0.01, 0.02)])


@pytest.mark.parametrize(
    ("time", "place", "speed"),
    [(-1.0, PLACES[0], 0.0), (0.25, PLACES[:2].mean(0), (PLACES[1] - PLACES[0]) / 0.5),
     (0.75, PLACES[1:].mean(0), (PLACES[2] - PLACES[1]) / 0.5), (7.0, PLACES[2], 0.0)],
)  # fmt: skip
def test_a_recorded_path_rests_at_its_first_and_last_place(time: float, place: np.ndarray, speed: np.ndarray) -> None:
    path = RecordedPath(RecordedMotion(PLACES, 0.5))
    assert path.start == tuple(PLACES[0]) and path.duration == 1.0
    path.lay(time)
    ((begin, lasts, *ends),) = path.pieces
    here, there = np.array(ends[:3]), np.array(ends[3:])
    assert begin + lasts / 2.0 == pytest.approx(time)  # half-way in a piece a hand is half-way between its ends
    assert (here + there) / 2.0 == pytest.approx(place)
    assert 1.875 * (there - here) / lasts == pytest.approx(speed)
