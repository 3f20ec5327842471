"""Arrays that compiled code only reads: one form of it is enough, whether Python may write to them or not."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from itouch.contact.array_views import lent


def test_what_is_lent_is_compiled_once_for_arrays_of_both_kinds() -> None:
    @njit
    def first(array: Any) -> float:
        return float(array[0])

    @njit
    def entry(array: Any) -> float:
        return first(lent(array))

    numbers, fixed = np.array([2.0, 3.0]), np.array([5.0, 7.0])
    fixed.flags.writeable = False
    assert (entry(numbers), entry(fixed)) == (2.0, 5.0)
    assert (len(entry.signatures), len(first.signatures)) == (2, 1)
