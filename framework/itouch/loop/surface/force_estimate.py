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
    AVERAGED_AT,
    BORNE,
    DEEP,
    FILTERED,
    HEARD,
    HEARD_AT,
    LOUD,
    READ,
    READ_BEFORE,
    UNSURE,
    VARIANCE,
)
from itouch.plugin.carried_surfaces import ABOUT, SURELY

Floats = NDArray[np.float64]

#: Noise [N rms] up to which a sensor is quiet: it seldom reads what counts as a touch (0.03 N) without one.
QUIET = 0.0065
#: Over what time noise is measured [s] by a reading in every tick; for how long at least before a sensor can be loud,
#: and for how long until no more than QUIET makes it so.  The least noise that is taken to be there [N rms]; and how
#: many times greater than it was so far a deviation may count [1]: a knock is no noise.
MEASURES, FIRST, AT_LEAST, LEAST, KNOCK = 0.5, 0.02, 0.2, 0.002, 3.0
#: How long each reading counts for there [s] behind a wire, where they are fewer: as one of a loop of 1 kHz.
LATE_COUNTS = 1e-3
#: By how much the force on the pad changes in a second that the motion of finger and surface does not explain
#: [N/s^0.5]: an arm reads in steps, and no pad is as stiff as it is said to be.
WANDERS = 0.3
#: A reading that differs from the average by more than so many times the noise is a knock, and is believed at once [1].
STRUCK = 5.5
#: The average is within so many of its standard deviations [1]; that of a surface that seems away must exceed `SURELY`
#: of them to be a force.
SURE = 3.5
#: A surface that is this much deeper in the finger than a tick ago [m] is not: where it is, was learned anew.
JUMPED = 5e-4


@linked
def _measure_noise(memory: Floats, reading: float, counts: float) -> None:
    """Follow the variance of a sensor's noise [N2], by how much each reading [N] differs from the line through others.

    Slow changes, as an axis's friction or a sensor's drift, do not enter.  ``counts``: the time [s] that one reading
    counts for.
    """
    bend = reading - 2.0 * memory[READ] + memory[READ_BEFORE]
    variance = memory[VARIANCE]
    found = min(bend * bend / 6.0, KNOCK * KNOCK * max(variance, LEAST * LEAST))
    memory[HEARD] += counts
    memory[VARIANCE] += counts / min(MEASURES, memory[HEARD]) * (found - variance)


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
        _measure_noise(memory, reading, c[PERIOD])
    memory[READ_BEFORE], memory[READ], memory[DEEP] = memory[READ], reading, depth
    if _is_loud(memory):
        _average(c, memory, reading, c[PERIOD], deeper, depth)
    else:
        believe(memory, reading)


@linked
def estimate_late(c: Floats, memory: Floats, load: float, presses: float, depth: float, measured: float) -> None:
    """Write what `estimate` does, where readings come through a wire: late, and not in every tick.

    Parameters
    ----------
    c, memory
        As in `estimate`, shape (CONSTANTS,) and (MEMORY,).
    depth
        As in `estimate` [m].
    load
        The newest reading of the force sensor [N], negative where a finger presses; of it only the noise is taken.
    presses
        What the modality said a tick ago of the force on the surface [N]: the reading that was the newest then, moved
        on to that tick.
    measured
        The tick in which ``load`` was measured.
    """
    ticks, new = memory[HEARD_AT] - memory[AVERAGED_AT], measured > memory[HEARD_AT]
    memory[AVERAGED_AT] = memory[HEARD_AT]
    if new:
        if depth < -CLEAR_OF:
            _measure_noise(memory, -load, LATE_COUNTS)
        memory[HEARD_AT], memory[READ_BEFORE], memory[READ] = measured, memory[READ], -load
    deeper = depth - memory[DEEP]
    memory[DEEP] = depth
    if not _is_loud(memory):
        believe(memory, presses)
    elif ticks > 0.0 or memory[LOUD] <= 0.0:  # it is of a reading that has not been averaged yet
        _average(c, memory, presses, max(1.0, ticks) * c[PERIOD], deeper, depth)
    else:
        memory[FILTERED] = _moved_on(c, memory, deeper)
        memory[BORNE] = _borne(memory[FILTERED], depth, memory[UNSURE] / SURE)


@linked
def _is_loud(memory: Floats) -> bool:
    """Tell whether the sensor's noise must be averaged out: the shorter it was measured, the greater it must be."""
    heard = memory[HEARD]
    return bool(heard >= FIRST and memory[VARIANCE] * min(1.0, heard / AT_LEAST) > QUIET * QUIET)


@linked
def believe(memory: Floats, reading: float) -> None:
    """Take a reading [N] for the force, as of a quiet sensor; ``memory`` (MEMORY,) of the surface."""
    memory[LOUD] = memory[UNSURE] = 0.0
    memory[FILTERED], memory[BORNE] = reading, max(0.0, reading)


@linked
def _average(c: Floats, memory: Floats, reading: float, since: float, deeper: float, depth: float) -> None:
    """Correct the average by a reading [N] that comes ``since`` [s] after the one before.

    ``deeper``: how much deeper the finger is in the surface than a tick ago; ``depth``: how deep it is [m].
    """
    variance = memory[VARIANCE]
    ratio = WANDERS * WANDERS * since / variance
    gain = 0.5 * (math.sqrt(ratio * ratio + 4.0 * ratio) - ratio)
    memory[LOUD], deviation = math.sqrt(variance), math.sqrt(variance * gain / (2.0 - gain))
    memory[UNSURE] = SURE * deviation
    before = _moved_on(c, memory, deeper)
    off = reading - before
    memory[FILTERED] = reading if abs(off) > STRUCK * memory[LOUD] else before + gain * off
    memory[BORNE] = _borne(memory[FILTERED], depth, deviation)


@linked
def _moved_on(c: Floats, memory: Floats, deeper: float) -> float:
    """Return the average [N], moved on by how much deeper [m] the finger is in the surface than a tick ago."""
    before = memory[FILTERED]
    if before > memory[UNSURE] and abs(deeper) < JUMPED:  # it surely touches
        return float(max(0.0, before + c[PAD_STIFFNESS] * deeper))
    return float(before)


@linked
def _borne(found: float, depth: float, deviation: float) -> float:
    """Return what the average ``found`` says of the force on the surface [N]; ``deviation``: its standard one [N].

    The farther the surface seems away, the more the average must exceed its noise to count; in full it counts from
    twice that.
    """
    away = min(1.0, max(0.0, (-depth - ABOUT) / (CLEAR_OF - ABOUT)))
    return max(0.0, min(found, 2.0 * (found - away * SURELY * deviation)))


@linked
def believed(memory: Floats, load: float) -> float:
    """Return the force on a surface along its device's third axis [N]: of a loud sensor its estimate, else its reading.

    ``memory`` (MEMORY,) of the surface; ``load``: the reading [N], negative where a finger presses, as is the result.
    """
    return float(-memory[BORNE] if memory[LOUD] > 0.0 else load)
