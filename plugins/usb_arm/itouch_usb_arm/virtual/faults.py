"""Faults to inject into the virtual arm: lost, late and damaged answers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Faults:
    """The faults that shall occur; each count goes down by one when its fault occurs.

    Attributes
    ----------
    drop, bad, stray, wrong
        Number of answers that lose a byte, have a byte that is invalid in a frame, follow stray bytes, or have a wrong
        but valid letter in a number.
    refuse
        Number of transfers that stall their endpoint.
    mute
        Number of answers that never come.
    late
        Delay of the next answer [s].
    unplug_after
        Bytes of answers until the plug is pulled; None: it is not.
    boot_echo
        Byte of the upload whose echo is wrong; None: no byte.
    unhomed
        Whether homing never completes.
    deaf
        Whether the boot loader does not answer, as if the arm had no power.
    """

    drop: int = 0
    bad: int = 0
    stray: int = 0
    wrong: int = 0
    refuse: int = 0
    mute: int = 0
    late: float = 0.0
    unplug_after: int | None = None
    boot_echo: int | None = None
    unhomed: bool = False
    deaf: bool = False
