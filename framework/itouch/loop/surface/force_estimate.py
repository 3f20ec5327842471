"""The force on a carried surface by a sensor whose noise is known: it is measured in the air, and averaged out.

A sensor that is quiet is believed as it reads.  The reading of a loud one is averaged over as many ticks as its noise
needs (the filter is the steady state of a Kalman filter, for a force that changes at random); the average moves on with
what finger and surface do meanwhile, as the pad's stiffness turns it into force, so that it is not late.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import linked
from itouch.loop.render import PAD_STIFFNESS, PERIOD
from itouch.loop.surface.plate import CLEAR_OF
from itouch.loop.surface.surface_memory import (
    BORNE,
    DEEP,
    FILTERED,
    HEARD,
    LOUD,
    READ,
    READ_BEFORE,
    UNSURE,
    VARIANCE,
)
from itouch.plugin.carried_surfaces import ABOUT

Floats = NDArray[np.float64]

#: Noise [N rms] up to which a sensor is quiet: it seldom reads what counts as a touch (0.03 N) without one.
QUIET = 0.0065
#: Over what time noise is measured [s], and for how long at least before a sensor can be loud; the least noise that is
#: taken to be there [N rms]; and how many times greater than it was so far a deviation may count [1]: a knock is no
#: noise.
MEASURES, AT_LEAST, LEAST, KNOCK = 0.5, 0.2, 0.002, 3.0
#: By how much the force on the pad changes in a second that the motion of finger and surface does not explain
#: [N/s^0.5]: an arm reads in steps, and no pad is as stiff as it is said to be.
WANDERS = 0.3
#: A reading that differs from the average by more than so many times the noise is a knock, and is believed at once [1].
STRUCK = 5.5
#: The average is within so many of its standard deviations [1]; and that of a surface that seems away must exceed so
#: many, in each of a million ticks, to be a force.
SURE, SURELY = 3.5, 5.0
#: A surface that is this much deeper in the finger than a tick ago [m] is not: where it is, was learned anew.
JUMPED = 5e-4


@linked
def _measure_noise(c: Floats, memory: Floats, reading: float) -> None:
    """Follow the variance of a sensor's noise [N2], by how much each reading [N] differs from the line through others.

    Slow changes, as an axis's friction or a sensor's drift, do not enter.
    """
    bend = reading - 2.0 * memory[READ] + memory[READ_BEFORE]
    variance = memory[VARIANCE]
    found = min(bend * bend / 6.0, KNOCK * KNOCK * max(variance, LEAST * LEAST))
    memory[HEARD] += c[PERIOD]
    memory[VARIANCE] += c[PERIOD] / min(MEASURES, memory[HEARD]) * (found - variance)


@linked
def estimate(c: Floats, memory: Floats, load: float, depth: float) -> None:
    """Write with what force [N] a finger presses on a surface, and how far [N] it may be from that.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    memory
        That of the carried surface, shape (MEMORY,).
    load
        The reading of its force sensor in this tick [N]; a finger that presses makes it negative.
    depth
        How far the finger seems to be in the surface [m].
    """
    reading, deeper = -load, depth - memory[DEEP]
    if depth < -CLEAR_OF:
        _measure_noise(c, memory, reading)
    memory[READ_BEFORE], memory[READ], memory[DEEP] = memory[READ], reading, depth
    variance = memory[VARIANCE]
    if memory[HEARD] < AT_LEAST or not variance > QUIET * QUIET:
        memory[LOUD] = memory[UNSURE] = 0.0
        memory[FILTERED], memory[BORNE] = reading, max(0.0, reading)
        return
    ratio = WANDERS * WANDERS * c[PERIOD] / variance
    gain = 0.5 * (math.sqrt(ratio * ratio + 4.0 * ratio) - ratio)
    memory[LOUD], deviation = math.sqrt(variance), math.sqrt(variance * gain / (2.0 - gain))
    memory[UNSURE] = SURE * deviation
    before = memory[FILTERED]
    if before > memory[UNSURE] and abs(deeper) < JUMPED:  # it surely touches
        before = max(0.0, before + c[PAD_STIFFNESS] * deeper)
    off = reading - before
    found = reading if abs(off) > STRUCK * memory[LOUD] else before + gain * off
    # The farther it seems away, the more the average must exceed its noise to count; in full it counts from twice that.
    away = min(1.0, max(0.0, (-depth - ABOUT) / (CLEAR_OF - ABOUT)))
    memory[FILTERED] = found
    memory[BORNE] = max(0.0, min(found, 2.0 * (found - away * SURELY * deviation)))


@linked
def believed(memory: Floats, load: float) -> float:
    """Return the force on a surface along its device's third axis [N]: of a loud sensor its estimate, else its reading.

    ``memory`` (MEMORY,) of the surface; ``load``: the reading [N], negative where a finger presses, as is the result.
    """
    return float(-memory[BORNE] if memory[LOUD] > 0.0 else load)
