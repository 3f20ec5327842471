"""The legend of the picture, without a screen: its title fits."""

from __future__ import annotations

import importlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyglet
import pytest

pyglet.options.shadow_window = False  # as where pictures are drawn without a window
legend: Any = importlib.import_module("itouch_tools.viewer.legend")


@pytest.mark.parametrize("title", ["skin", "temperature of surfaces", "what is felt " * 9])
def test_the_title_of_the_scale_is_as_large_as_fits_into_its_panel(title: str) -> None:
    size, said = 14.0, dict[str, float]()
    text: Any = SimpleNamespace(
        width=lambda letter: 0.6 * letter, put=lambda words, *place, size, **more: said.update({words: size})
    )
    ends = SimpleNamespace(ends=(283.15, 313.15), colour=lambda kelvin: (0.5, 0.5, 0.5))
    legend.draw(
        SimpleNamespace(draw=lambda *parts: None), text, (20.0, 30.0), np.eye(4), size, title=title,
        marks={"finger": 306.15}, skin=(0.3, 0.7, 0.9), ends=ends, metre=2000.0,
    )  # fmt: skip
    wide, room = 0.6 * said[title] * len(title), (legend.WIDE - 2.0) * size
    assert wide <= room * (1.0 + 1e-9)
    assert said[title] == pytest.approx(0.9 * size) if len(title) < 30 else wide == pytest.approx(room)
