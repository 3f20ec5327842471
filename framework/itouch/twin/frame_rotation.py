"""Turns directions into and out of a frame in an array (origin, then rotation matrix row by row); compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import linked
from itouch.plugin.carried_surfaces import STEEPEST

Floats = NDArray[np.float64]

#: Width of a frame: origin, then rotation matrix.
FRAME = 12


@linked
def turned_out(frames: Floats, at: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Turn a direction out of the frame that begins at index ``at`` of ``frames`` (n,); in any unit."""
    r = at + 3
    return (
        frames[r] * x + frames[r + 1] * y + frames[r + 2] * z,
        frames[r + 3] * x + frames[r + 4] * y + frames[r + 5] * z,
        frames[r + 6] * x + frames[r + 7] * y + frames[r + 8] * z,
    )


@linked
def turned_in(frames: Floats, at: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Turn a direction into the frame that begins at index ``at`` of ``frames`` (n,); in any unit."""
    r = at + 3
    return (
        frames[r] * x + frames[r + 3] * y + frames[r + 6] * z,
        frames[r + 1] * x + frames[r + 4] * y + frames[r + 7] * z,
        frames[r + 2] * x + frames[r + 5] * y + frames[r + 8] * z,
    )


@linked
def beside(radius: float, cosine: float) -> float:
    """Return how much higher [m] the lowest point of a touching finger is than the plate directly below that point.

    A ball with ``radius`` [m] touches a plate that is mounted at an angle, with this ``cosine`` [1], beside its lowest
    point.
    """
    return float(radius * (1.0 / max(STEEPEST, cosine) - 1.0))
