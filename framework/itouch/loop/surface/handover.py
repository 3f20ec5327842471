"""Handover of a contact between arm and plate, by what a modality says of its surface; what it misses is remembered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import linked
from itouch.loop.render import CLEARANCE, HIP, PLATE_TOP, RADIUS
from itouch.loop.surface.surface_memory import (
    CHANGING,
    CLEAR,
    MISSED,
    MISSED_AT,
    MISSED_DEPTH,
    MISSED_LOAD,
    MISSES,
    PRESENT,
    PRESSED,
    RENDERS,
    SETTLED,
    WITHDRAWN,
)
from itouch.plugin.carried_surfaces import HIGH, LOW

Floats = NDArray[np.float64]

#: For how long at least [s] the force is handed over in small steps after arm or plate has taken over the contact.
LED = 0.3


@linked
def _miss(memory: Floats, what: float, depth: float, pressed: float, touching: bool, time: float) -> None:
    """Leave the contact to the arm, because the surface is not where its height says."""
    if memory[MISSES] == 0.0:
        memory[MISSED_AT], memory[MISSED_DEPTH], memory[MISSED_LOAD] = time, depth, pressed
    memory[MISSES] += 1.0
    memory[MISSED], memory[RENDERS] = what, 0.0
    if touching:
        memory[CHANGING] = LED


@linked
def miss(c: Floats, figures: Floats, memory: Floats, said: float, pressed: float, touching: bool, time: float) -> None:
    """Remember why a surface no longer renders, as its modality says; a withdrawal by safety (T4) overrules it.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    figures, memory
        The probe's part of State, and that of the carried surface.
    said
        LOW, HIGH, or 0: nothing is wrong.
    pressed
        Force with which the finger presses on the table [N].
    touching, time
        Whether there is a virtual contact, and the time of the tick [s].
    """
    if memory[MISSED] == WITHDRAWN:
        return
    why = HIGH if said >= HIGH else LOW if said > 0.0 else 0.0
    if why > 0.0 and memory[MISSED] == 0.0:
        _miss(memory, why, figures[PLATE_TOP] - (figures[HIP + 2] - c[RADIUS]), pressed, touching, time)
    memory[MISSED] = why


@linked
def take_over(
    c: Floats, memory: Floats, renders: bool, present: bool, away: float, coming: float, touching: bool
) -> None:  # fmt: skip
    """Remember who renders a contact, as the surface's modality says.

    ``c`` (CONSTANTS,), ``memory`` (MEMORY,) of the surface; ``away``: its distance from the finger [m]; ``coming``: how
    far it has still to come or to go [m], below 0: not said.  A surface that is missed or withdrawn renders nothing.
    """
    renders = renders and memory[MISSED] == 0.0
    if touching and memory[PRESSED] > 0.0 and renders != (memory[RENDERS] > 0.0):
        memory[CHANGING] = LED
    memory[RENDERS] = 1.0 if renders else 0.0
    memory[PRESENT] = 1.0 if touching and present else 0.0
    if coming < 0.0:
        memory[SETTLED], memory[CLEAR] = 1.0, 1.0 if away >= c[CLEARANCE] else 0.0
    else:
        memory[SETTLED] = 1.0 if renders and coming == 0.0 else 0.0
        memory[CLEAR] = 1.0 if not renders and coming == 0.0 else 0.0
