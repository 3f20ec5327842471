"""How far the desired flux is looked ahead when a touch begins: in a shorter tick it comes to its horizon by and by."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch


@pytest.mark.parametrize("rate", [1, 2, 4])
def test_a_touch_is_looked_ahead_as_far_at_every_rate(tmp_path: Path, rate: int) -> None:
    text = (SCENES / "four_materials.xml").read_text(encoding="utf-8")
    assert '<rates servo="1 kHz"/>' in text
    text = text.replace('<rates servo="1 kHz"/>', f'<rates servo="{rate} kHz"/>')
    path = shutil.copytree(SCENES, tmp_path / "scenes") / "scene.xml"
    path.write_text(text, encoding="utf-8")
    session = itouch.build(path)
    state, period = session.state, session.model.period
    session.run(14.0)
    touched, reached = state["finger.contact.object"], state["flux-control.reached"]
    while touched.item() < 0:
        session.tick()
    begun = state["tick"].item()
    first = reached.item()
    future = state["flux-control.future"].copy()
    assert np.isfinite(future).all()
    assert (future != 0.0).all()  # what is not computed yet is as it was last
    while state["tick"].item() < begun + rate * 30:
        session.tick()
    ahead = (reached.item() - (state["tick"].item() - begun)) * period
    assert ahead == pytest.approx(state["flux-control.future"].shape[0] * 1e-3 / rate, abs=5e-3)
    assert first * rate <= 1200  # as large a part of the tick at every rate
    session.run(1.0)
    contact = session.report()["contacts"][-1]
    assert contact["flux_error_rms"] < 0.02
