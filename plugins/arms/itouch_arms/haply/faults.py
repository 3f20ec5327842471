"""What can be made to go wrong with the virtual service."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Faults:
    """What shall go wrong; the counts go down as it does.

    Attributes
    ----------
    mute, late
        Answers that never come; delay of the next answer [s].
    garbage, odd, nan, far
        Answers that are no JSON, have a position of another type, of numbers that are none, or out of reach.
    extra
        Messages that nobody asked for, before the next answers.
    bare, halved
        Answers that say nothing of the position, or leave part of it out.
    hang_up
        Whether the next message is answered by closing the connection in the midst of the answer.
    unplugged
        Whether the arm is missing from the list.
    unpowered, uncalibrated
        What the arm's status says.
    """

    mute: int = 0
    late: float = 0.0
    garbage: int = 0
    odd: int = 0
    nan: int = 0
    far: int = 0
    extra: int = 0
    bare: int = 0
    halved: int = 0
    hang_up: bool = False
    unplugged: bool = False
    unpowered: bool = False
    uncalibrated: bool = False

    def take(self, name: str) -> bool:
        """Tell whether this goes wrong now, and count it."""
        left: int = getattr(self, name)
        if left:
            setattr(self, name, left - 1)
        return bool(left)
