"""What the curves of a report are made of: samples at equal distances, however long the recording is."""

from __future__ import annotations

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch_tools.report import curves


def test_a_long_recording_is_sampled_less_often_and_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    signals = len(curves.Sampler(session.model, 1)._signals)
    monkeypatch.setattr(curves, "_MOST_KEPT", 5 * signals)
    sampler = curves.Sampler(session.model, 14)
    for tick in range(14):
        session.state["tick"] = tick
        sampler.add(session.state)
    found = sampler.curves([(3e-3, 8e-3)])
    assert found.whole.times == pytest.approx(1e-3 * np.arange(0, 14, 3))
    assert found.whole.values.shape == (signals, 5)
