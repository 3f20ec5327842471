"""A compiled function with the arguments that it is always called with: what joins a step to those beside it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


class Bound:
    """A call whose arguments stay the same: views of State, constants, numbers.

    Called from Python it is an ordinary call; the loop can also run several of them, one after the other, as one.

    Parameters
    ----------
    function
        Compiled by ``itouch.plugin.kernels.kernel``; returns 0, or another number if Python is wanted.
    arguments
        Contiguous arrays (a scalar of State is one of one number), named tuples of arrays, and numbers.  What changes
        must stand in an array.
    """

    __slots__ = ("arguments", "function")

    def __init__(self, function: Callable[..., int], *arguments: Any) -> None:
        self.function = function
        self.arguments = tuple(
            value.reshape(1) if isinstance(value, np.ndarray) and value.ndim == 0 else value for value in arguments
        )

    def __call__(self) -> int:
        """Call the function from Python, alone."""
        return self.function(*self.arguments)

    def rehearse(self) -> None:
        """Call the function on copies, so that it is compiled before the first tick."""
        self.function(*(value.copy() if isinstance(value, np.ndarray) else value for value in self.arguments))
