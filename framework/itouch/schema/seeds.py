"""Which numbers are valid seeds."""

from __future__ import annotations

import operator
from typing import SupportsIndex


def checked_seed(seed: SupportsIndex) -> int:
    """Return a seed as a whole number from 0 to 2^63 - 1.

    Raises
    ------
    ValueError
        If it is anything else: truncating a fraction would give another run than the one asked for.
    """
    try:
        if isinstance(seed, bool):
            raise TypeError
        number = operator.index(seed)
    except TypeError:
        raise ValueError(f"seed {seed!r} is not a whole number: give one from 0 to 2^63 - 1") from None
    if not 0 <= number < 1 << 63:
        raise ValueError(f"seed {number} is out of range: 0 to 2^63 - 1")
    return number
