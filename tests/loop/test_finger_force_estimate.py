"""The force on a finger of which only the table's sensor tells: the plate's along its normal, and what the arm gives."""

from __future__ import annotations

import math

import pytest
from shipped import SCENES

import itouch
from itouch.loop import render
from itouch.loop.rigid_transforms import Frame


@pytest.mark.parametrize(
    ("plate", "arm", "total"),
    [
        (-1.5, (0.0, 0.0, 0.0), 1.5),
        (0.4, (0.0, 0.0, 0.0), 0.0),  # a plate does not pull
        (0.0, (0.3, -0.4, 1.2), 1.3),
        (-1.0, (0.3, 0.4, 1.2), math.sqrt(0.25 + 2.2**2)),
        (-1.0, (0.6, 0.0, -1.8), 1.0),
    ],
)
def test_plate_and_arm_together(plate: float, arm: tuple[float, float, float], total: float) -> None:
    session = itouch.build(SCENES / "four_materials_wire.xml")
    (rig,) = session._rigs
    upright = Frame(0.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    rig._placed.update({render.TABLE: upright, render.ARM: upright})
    session.state["table.wrench"][2], session.state["arm.sent.wrench"][:3] = plate, arm
    rig.measure()
    assert session.state["finger.total_force"] == pytest.approx(total)
    session.close()
