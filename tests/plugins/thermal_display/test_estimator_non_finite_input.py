"""What is not a number in the estimator of `model` stops the device: no limit on the way makes a current of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from display_scenes import Display

import itouch
from itouch.monitors import DeviceFaultError


@pytest.mark.parametrize("slew", ["", ' slew="30 A/s"'])
@pytest.mark.parametrize("touching", [False, True])
@pytest.mark.parametrize("name", ["x", "theta", "memory"])
def test_a_non_finite_estimate_stops_the_device(scenes: Path, name: str, touching: bool, slew: str) -> None:
    session = itouch.build(Display(hardware=f"<thermal:hardware{slew}/>").write(scenes))
    session.run(
        until=(lambda: bool(session.state["flux-control.on_plate"])) if touching else (lambda: session.ticks > 900)
    )
    kept = session.state["flux-control.memory"][0]
    session.state[f"flux-control.{name}"][...] = np.nan
    session.state["flux-control.memory"][0] = kept  # whether it touches is no number of the estimator
    with pytest.raises(DeviceFaultError, match="commanded with NaN"):
        session.run(0.1)
    assert session.state["peltier.sent.current"][0] == 0.0
