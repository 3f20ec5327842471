"""Noise on the display's current before a touch: it masks the controller's own, which differs with the temperature.

It is for studies in which nothing but the touch may reveal the material.  It is white and a function of the tick alone,
so that it is the same in every condition; the plate is too slow to follow it.
"""

from __future__ import annotations

from itouch.plugin.kernels import kernel


@kernel
def masked(current: float, amplitude: float, most: float, tick: int) -> float:
    """Return a current [A] with uniform noise of an amplitude [A] added; their sum stays within ``most`` [A]."""
    if amplitude <= 0.0:
        return current
    current = min(most - amplitude, max(amplitude - most, current))
    word = (tick * 1103515245 + 12345) & 0x7FFFFFFF
    word = ((word ^ (word >> 15)) * 0x2C1B3C6D) & 0x7FFFFFFF
    word = ((word ^ (word >> 12)) * 0x297A2D39) & 0x7FFFFFFF
    return current + amplitude * ((word ^ (word >> 15)) / 1073741824.0 - 1.0)
