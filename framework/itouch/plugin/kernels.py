"""Compiled functions of a plugin, kept on disk together with a fingerprint of all that they are made of."""

from typing import Any

from itouch.compiling import kernel, nogil_kernel

__all__ = ["copied", "encoded", "kernel", "nogil_kernel"]

#: Adding and subtracting it rounds a number to an integer, and leaves NaN what it is.
_TO_INTEGER = 1.5 * 2.0**52


@kernel
def copied(source: Any, target: Any) -> int:
    """Copy the numbers of an array, shape (n,), into another; return 0."""
    for i in range(source.shape[0]):
        target[i] = source[i]
    return 0


@kernel
def encoded(pose: Any, step: float, turns: bool, shown: Any, switch: Any) -> int:
    """Show a pose as encoders see it; return 0.

    Parameters
    ----------
    pose
        Position [m] and quaternion w x y z, shape (7,).
    step
        Resolution [m], 0: none.
    turns
        Whether the turning is sensed, too.
    shown, switch
        What is read of it, shape (7,), and a switch, which is held, shape (1,) or (0,).
    """
    for i in range(3):
        shown[i] = (pose[i] / step + _TO_INTEGER - _TO_INTEGER) * step if step > 0.0 else pose[i]
    for i in range(3, 7):
        shown[i] = pose[i] if turns else 1.0 if i == 3 else 0.0
    for i in range(switch.shape[0]):
        switch[i] = 1.0
    return 0
