"""Compiled functions for plugins, cached on disk by a fingerprint of all that they are made of.

What they work on stands in flat arrays, whose parts are named: `places` says where each field of State begins in the
flat array of fields that follow one another, and `Block` where each part of a block of constants does.
"""

import math
from typing import Any

import numpy as np

from itouch.blocks import Block, places
from itouch.compiling import fused, inlined, kernel, linked, nogil_kernel

__all__ = ["Block", "copied", "encoded", "fused", "gaussian", "inlined", "kernel", "linked", "nogil_kernel", "places"]

#: Adding and then subtracting it rounds a number to an integer, and leaves NaN unchanged.
_TO_INTEGER = 1.5 * 2.0**52


@kernel
def copied(source: Any, target: Any) -> int:
    """Copy the numbers of ``source`` (n,) into ``target`` (n,), of the same unit; return 0."""
    for i in range(source.shape[0]):
        target[i] = source[i]
    return 0


@kernel
def encoded(pose: Any, step: float, turns: bool, shown: Any, switch: Any) -> int:
    """Write a pose as encoders read it; return 0.

    Parameters
    ----------
    pose
        Position [m] and quaternion w x y z, shape (7,).
    step
        Resolution [m]; 0: infinitely fine.
    turns
        Whether the orientation is sensed too.
    shown, switch
        Written: the pose that is read, shape (7,), and 1 for a switch that is held, shape (1,), or (0,) without one.
    """
    for i in range(3):
        shown[i] = (pose[i] / step + _TO_INTEGER - _TO_INTEGER) * step if step > 0.0 else pose[i]
    for i in range(3, 7):
        shown[i] = pose[i] if turns else 1.0 if i == 3 else 0.0
    for i in range(switch.shape[0]):
        switch[i] = 1.0
    return 0


@linked
def _uniform(words: Any) -> float:
    """Draw a number from 0 to 1, 1 excluded, advancing a one-word generator: SplitMix64 (Steele, Lea, Flood 2014)."""
    words[0] += np.uint64(0x9E3779B97F4A7C15)
    word = words[0]
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return float((word ^ (word >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53


@kernel
def gaussian(words: Any) -> float:
    """Draw from the standard normal distribution, advancing a one-word generator in State, shape (1,), dtype u8.

    The numbers are the same as those of `itouch.plugin.gaussian`.
    """
    radius = math.sqrt(-2.0 * math.log(_uniform(words) + 2.0**-54))
    return radius * math.cos(2.0 * math.pi * _uniform(words))
