"""Heat that spreads sideways in the plate under a finger which covers a part of it, as modes beside those of the depth.

The plate is a disc of its area with a finger in the middle.  A field that the finger makes is even over the plate,
plus fields ``J0(z r / R) / |J0(z)|`` with ``J1(z) = 0``, which carry no heat on the whole and fade as heat flows along
the plate and through the legs.  Through the plate's depth only the slow part of such a field differs from place to
place: what is over in milliseconds is under the finger as if the plate were covered whole.  Some of the fields are
kept; what is left is one field that fades faster than they (`rendering.spread` is the measure).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contact_heat.layers import Layer

Array = NDArray[np.float64]

#: How many fields are kept, and the wave number of what is left as a multiple of the first that is not.
FIELDS, BLUR = 6, 2.0
#: For how many covered parts of the plate the shares are tabulated, from none to the whole plate.
PARTS = 513
#: Angles of the mean that is a Bessel function, and steps of Newton's method for its zeros.
_ANGLES, _STEPS = 256, 8


class Sideways(NamedTuple):
    """A plate's area [m2], conductance of the legs under it [W/m2K], and the covered part: None, if that changes."""

    area: float
    legs: float
    cover: float | None = None


def bessel(order: int, places: Array) -> Array:
    """Return the Bessel function of an order at places from 0 to 100, shape (n,), by its integral over angles.

    Places and values have no unit [1].
    """
    angles = (np.arange(_ANGLES) + 0.5) * math.pi / _ANGLES
    found: Array = np.cos(order * angles - np.asarray(places)[:, None] * np.sin(angles)).mean(axis=1)
    return found


@lru_cache(maxsize=1)
def _zeros() -> Array:
    """Return the first places above 0 where J1 is 0, shape (FIELDS + 1,)."""
    found = np.asarray((np.arange(1.0, FIELDS + 2.0) + 0.25) * math.pi, np.float64)
    for _ in range(_STEPS):
        value = bessel(1, found)
        found = np.asarray(found - value / (bessel(0, found) - value / found))
    return found


def fading(layers: Sequence[Layer], sideways: Sideways) -> Array:
    """Return the rates [1/s] with which the fields fade, shape (FIELDS + 1,), the last that of what is left."""
    capacity = sum((layer.thickness or 0.0) * layer.heat_capacity for layer in layers)
    along = sum((layer.thickness or 0.0) * layer.conductivity for layer in layers)
    zeros = _zeros() * np.append(np.ones(FIELDS), BLUR)
    found: Array = (along * zeros**2 * math.pi / sideways.area + sideways.legs) / capacity
    return found


def shares(covers: Array, depths: int) -> tuple[Array, Array]:
    """Return what a contact gives to each mode and how each shows in it, for covered parts of the plate.

    Parameters
    ----------
    covers
        Covered parts, 0 to 1, shape (k,).
    depths
        How many modes the depth has, the slowest first; those of the fields follow.

    Returns
    -------
    into, out
        Factors on the mean flux of the contact, and on what the mode adds to its mean temperature, shape
        (k, depths + FIELDS + 1) each.  Together they make 1: at first the plate is as if it were covered whole.
    """
    zeros = _zeros()[:FIELDS]
    into, out = np.ones((2, len(covers), depths + FIELDS + 1))
    for row, cover in enumerate(np.asarray(covers).tolist()):
        places = np.maximum(zeros * math.sqrt(cover), 1e-9)
        shown = 2.0 * bessel(1, places) / places / np.abs(bessel(0, zeros))
        into[row, 0], into[row, depths:-1], out[row, depths:-1] = cover, cover * shown, shown
        into[row, -1] = max(0.0, 1.0 - cover - float(cover * shown @ shown))
    return into, out


@lru_cache(maxsize=8)
def table(depths: int) -> Array:
    """Return `shares` for covered parts from 0 to 1, shape (PARTS, 2, depths + FIELDS + 1)."""
    found: Array = np.stack(shares(np.linspace(0.0, 1.0, PARTS), depths), axis=1)
    found.setflags(write=False)
    return found
