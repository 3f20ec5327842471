"""Heat that spreads sideways in a plate partly covered by a finger, as modes beside those of the depth.

The plate is a disc of its area with the finger in the middle.  The field that the finger causes is uniform over the
plate, plus fields ``J0(z r / R) / |J0(z)|`` with ``J1(z) = 0``, which carry no net heat and fade as heat flows along
the plate and through the legs.  Through the plate's depth only the slow part of such a field varies from place to
place: what decays in milliseconds is under the finger as if the plate were covered whole.  Some of the fields are kept;
the remainder is one field that fades faster than they do (`rendering.spread` measures the error).
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

#: Number of fields that are kept, and wave number of the remainder as a multiple of the first one not kept.
FIELDS, BLUR = 6, 2.0
#: Number of covered shares of the plate, from none to all, for which `table` has entries.
PARTS = 513
#: Number of angles in the mean that gives a Bessel function, and of Newton steps for its zeros.
_ANGLES, _STEPS = 256, 8


class Sideways(NamedTuple):
    """A plate's area [m2], conductance of the legs under it [W/m2K], and its covered share; None if that may change."""

    area: float
    legs: float
    cover: float | None = None


def bessel(order: int, places: Array) -> Array:
    """Return the Bessel function of an order at places from 0 to 100, shape (n,), by its integral over angles.

    Places and values are dimensionless [1].
    """
    angles = (np.arange(_ANGLES) + 0.5) * math.pi / _ANGLES
    found: Array = np.cos(order * angles - np.asarray(places)[:, None] * np.sin(angles)).mean(axis=1)
    return found


@lru_cache(maxsize=1)
def _zeros() -> Array:
    """Return the first zeros of J1 above 0, shape (FIELDS + 1,)."""
    found = np.asarray((np.arange(1.0, FIELDS + 2.0) + 0.25) * math.pi, np.float64)
    for _ in range(_STEPS):
        value = bessel(1, found)
        found = np.asarray(found - value / (bessel(0, found) - value / found))
    return found


def fading(layers: Sequence[Layer], sideways: Sideways) -> Array:
    """Return the rates [1/s] at which the fields fade, shape (FIELDS + 1,); the last one is the remainder's."""
    capacity = sum((layer.thickness or 0.0) * layer.heat_capacity for layer in layers)
    along = sum((layer.thickness or 0.0) * layer.conductivity for layer in layers)
    zeros = _zeros() * np.append(np.ones(FIELDS), BLUR)
    found: Array = (along * zeros**2 * math.pi / sideways.area + sideways.legs) / capacity
    return found


def shares(covers: Array, depths: int) -> tuple[Array, Array]:
    """Return the weights of a contact on each mode and of each mode in the contact, for covered shares of the plate.

    Parameters
    ----------
    covers
        Covered shares, 0 to 1, shape (k,).
    depths
        Number of modes of the depth, the slowest first; those of the fields follow.

    Returns
    -------
    into, out
        Factors on the mean flux of the contact, and on the mode's contribution to its mean temperature, shape
        (k, depths + FIELDS + 1) each.  Their products sum to 1: at first the plate acts as if it were covered whole.
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
    """Return `shares` for covered shares from 0 to 1, shape (PARTS, 2, depths + FIELDS + 1)."""
    found: Array = np.stack(shares(np.linspace(0.0, 1.0, PARTS), depths), axis=1)
    found.setflags(write=False)
    return found
