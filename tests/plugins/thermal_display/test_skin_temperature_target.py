"""In a calibration the plate is to be felt without cooling the finger: it aims for the skin's temperature as it is read."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch_thermal.flux import approach


@pytest.mark.parametrize(
    ("skin", "valid", "measured"),
    [([305.0], [1.0], 305.0), ([305.0], [], 305.0), ([305.0], [0.0], math.nan), ([305.0], [0.4], math.nan),
     ([], [], math.nan), ([], [1.0], math.nan)],
)  # fmt: skip
def test_a_skin_that_no_sensor_sees_is_not_counted(
    skin: list[float], valid: list[float], measured: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a sensor that does not say whether it sees the skin all is believed."""
    heard, aimed = list[float](), list[tuple[Any, ...]]()
    monkeypatch.setattr(approach, "neutral", lambda *words: heard.append(words[5]) or 304.0)
    monkeypatch.setattr(approach, "pressed", lambda scene, heat: 0.0)
    monkeypatch.setattr(approach, "aim_at", lambda *words: aimed.append(words))
    scene = SimpleNamespace(skin=np.array(skin), skin_valid=np.array(valid))
    own = SimpleNamespace(
        approached=np.array([3]), calm=0, looked=0, covered=0, start_temperature="start", plate_limited="limited"
    )
    figures: Any = SimpleNamespace(resting=0, rest=0, heat=0, on_plate=0, update=0, lead=0, low=288.0, high=314.0)
    python = getattr(approach.aim_for_skin, "py_func", approach.aim_for_skin)
    python(scene, own, SimpleNamespace(cover=0), figures)
    assert heard == pytest.approx([measured], nan_ok=True)
    assert (aimed, own.approached.tolist()) == ([("start", "limited", 304.0, 288.0, 314.0)], [-1])
