"""What a virtual rig that is driven through its wires tells of itself."""

from __future__ import annotations

import pytest
from shipped import SCENES

import itouch
from itouch.plugin import Role
from itouch_tools.cli.real_rig import _Surface


def test_how_far_a_surface_goes_while_its_reading_gets_old_is_told_in_ms_and_mm() -> None:
    session = itouch.build(SCENES / "four_materials.xml")
    surface, state, period = _Surface(session, "table"), session.state, session.model.period
    sent = state[session.model.devices["table"].field(Role.SURFACE_POSE, "sent")]
    state["tick"], state["table.measured"] = 5, 3
    sent[0] += 0.3 * period
    state["ready"] = 0
    surface.see(5)  # not counted: nothing is felt yet
    state["ready"] = 1
    sent[2] += 0.2 * period
    surface.see(5)
    told = surface.told()
    assert told["age_ms"]["max"] == pytest.approx(2e3 * period)
    assert told["speed_times_age_mm"]["max"] == pytest.approx(1e3 * 0.2 * 2.0 * period)
