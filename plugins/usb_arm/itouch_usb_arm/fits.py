"""Calibrating the arm's force with a scale."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Fit, Fitted, line_through

#: A scale beyond these is a mistake in reading the scale.
_LOW, _HIGH = 100.0, 20000.0


def force_scale(params: Any, samples: NDArray[np.float64]) -> Fitted:
    """Return the scale at which the arm gives what is asked: the one in use times asked over given."""
    asked, given = samples.T
    slope, _, residual = line_through(asked, given)
    if slope <= 0.0:
        raise ValueError("the scale shows less when the arm is asked for more: check the signs")
    scale = params.force_scale / slope
    if not _LOW <= scale <= _HIGH:
        raise ValueError(
            f"a force scale of {scale:.0f} counts/(N m) is beyond {_LOW:.0f} to {_HIGH:.0f}: check the units"
        )
    return Fitted({"force_scale": scale}, residual, "N")


FORCE_SCALE_FIT = Fit(
    "force-scale",
    "put a scale under the grip, ask the arm for some forces along one direction, and write down what it shows",
    ("asked [N]", "given [N]"),
    180.0,
    force_scale,
)
