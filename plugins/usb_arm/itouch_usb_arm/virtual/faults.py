"""Faults of the virtual arm that can be injected: lost, late and damaged answers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Faults:
    """What shall go wrong; the counts go down as it does.

    Attributes
    ----------
    drop, bad, stray, wrong
        Answers that lose a byte, have one that no frame has, come after a stray byte, or have a wrong letter in a
        number.
    refuse
        Transfers that stall their endpoint.
    mute
        Answers that never come.
    late
        Delay of the next answer [s].
    unplug_after
        Bytes of answers until the plug is pulled; None: it stays.
    boot_echo
        Byte of the upload whose echo is wrong; None: none.
    unhomed
        Whether homing never ends.
    deaf
        Whether the boot loader does not answer: the arm has no power.
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
