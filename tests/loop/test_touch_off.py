"""A touch-off at the end of the travel."""

from __future__ import annotations

from pathlib import Path

import pytest

import itouch


def test_a_plate_that_can_drop_no_further_between_points_is_felt_at_all_of_them(scenes: Path) -> None:
    """The finger is met so low that less than the usual drop is left; waiting for the rest would never end."""
    path = scenes / "rigs" / "twin.xml"
    written = '<mount pos="0 0 -8 mm" mount-error="2 -1.5 3 mm"/>'
    assert written in path.read_text()
    path.write_text(path.read_text().replace(written, '<mount pos="0 0 40 mm" mount-error="0 0 3 mm"/>'))
    with itouch.build(scenes / "four_materials.xml", seed=1) as session:
        session.run(until=lambda: bool(session.state["ready"]) or session.ticks >= 6000)
        assert session.state["ready"].item() == 1
        assert session.state["table.touch_off.target"].item() == 0.0
        assert session.state["table.calibration"][2] == pytest.approx(-3e-3, abs=2e-4)
