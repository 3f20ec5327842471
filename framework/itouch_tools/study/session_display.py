"""What participant and operator are shown during a session, as values: what to do now, time left, force, trial."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Shown:
    """What participant and operator are shown of a session; nothing in it depends on the condition.

    ``cue`` is what to do now (a phase's name, ``lift``, ``hold``, ``break`` or ``done``), ``left`` the time [s] left
    for it, if known, ``force`` and ``window`` [N] those of the touch, if the study asks for a force, ``trial`` the
    number of the trial out of ``trials``, and ``void`` how many were void.
    """

    cue: str
    question: str = ""
    choices: tuple[str, ...] = ()
    left: float | None = None
    force: float | None = None
    window: tuple[float, float] | None = None
    trial: int = 0
    trials: int = 0
    void: int = 0
    message: str = ""


Show = Callable[[Shown], None]
