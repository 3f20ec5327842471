"""The plate of a carried surface: where its top is, and how high it may go without pressing harder than it may.

The modality that carries the plate decides where it goes; what is here holds for all such modalities.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from itouch.blocks import places
from itouch.compiling import kernel, linked
from itouch.loop.render import (
    FORCE_LIMIT,
    HAS_LOAD,
    HIP,
    OFFSET,
    PAD_STIFFNESS,
    PERIOD,
    PLATE_LIMIT,
    PLATE_YIELD,
    RADIUS,
    TABLE,
    TRACKING,
)
from itouch.loop.surface.surface_memory import ACCELERATION, CLIMB, LEVEL, OFF, RENDERS, RISES, SETTLED, SINK
from itouch.plugin.carried_surfaces import AHEAD, LEFT, ROOM, TOUCH, YIELD_RATE, YIELD_RETURN
from itouch.twin.frame_rotation import beside, turned_in, turned_out
from itouch.world.state_fields import rising_fields

Floats = NDArray[np.float64]

#: Places of `itouch.world.state_fields.rising_fields`.
READ_AT, READ_TOP, BY_READINGS, BETWEEN = (
    places(rising_fields())[f"rising.{name}"] for name in ("read_at", "read_top", "by_readings", "between")
)
#: By how much two ways of computing one height may differ [m].
ROUNDING = 1e-12
#: Time constant [s] with which it is learned that a plate is felt sooner or later than its height says.
SETTLE = 0.02
#: Time constant with which the plate's own speed, and the finger's acceleration, are smoothed [s].
SMOOTHLY = 0.003
#: First gain of the g-h filter on the finger's height at a period of AT [s], where it forgets in about 5 ms (Benedict
#: and Bordner 1962); and the difference from which on it begins anew [m].  It forgets in the same time at every period:
#: the steps in which an arm reads last as long at each, and a plate that followed them would press in their rhythm.
G, AT, LOST = 0.3, 1e-3, 2e-3
#: How fast the force of a plate that safety takes away decreases [N/s]: the arm's has to follow it.
LETS_GO = 25.0
#: How far below the finger a plate that measures no force is surely no longer felt, however wrong its height [m].
CLEAR_OF = 1.5e-3


@linked
def _smooth(c: Floats, memory: Floats, lowest: float) -> None:
    """Smooth height, speed and acceleration of the finger's lowest point (at ``lowest`` [m]).

    An arm reads in steps, which the plate must not follow.
    """
    ahead = memory[LEVEL] + memory[SINK] * c[PERIOD]
    off = lowest - ahead
    if abs(off) > LOST:
        memory[LEVEL], memory[SINK], memory[ACCELERATION] = lowest, 0.0, 0.0
        return
    g = G * ((1.0 - (1.0 - G) ** (c[PERIOD] / AT)) / (1.0 - (1.0 - G)))  # exactly G at AT
    memory[LEVEL] = ahead + g * off
    faster = g * g / (2.0 - g) * off / c[PERIOD]
    memory[SINK] += faster
    memory[ACCELERATION] += c[PERIOD] / (SMOOTHLY + c[PERIOD]) * (faster / c[PERIOD] - memory[ACCELERATION])


@linked
def foresee(c: Floats, table: Floats, figures: Floats, memory: Floats, load: float, risen: float) -> None:
    """Follow the finger's lowest point, and how much deeper it seems to be in the plate than the force explains.

    ``c`` (CONSTANTS,), ``figures`` (FIGURES,), ``memory`` (MEMORY,) of the surface; ``table`` (7,): the device's own
    reading of its pose [m; quaternion], whatever a modality says; ``load``: the force on it [N]; ``risen``: how much
    higher it is than this reading [m].
    """
    _smooth(c, memory, figures[HIP + 2] - c[RADIUS])
    pressed = max(0.0, -load)
    if pressed > TOUCH:
        off = top(c, table) + risen - memory[LEVEL] - pressed / c[PAD_STIFFNESS]
        memory[OFF] += c[PERIOD] / SETTLE * (off - memory[OFF])
    elif pressed < LEFT:
        memory[OFF] = 0.0


@linked
def _yield(c: Floats, figures: Floats, pressed: float) -> float:
    """Return how far the plate yields [m]: more while it presses harder than it may, less again afterwards."""
    limit, given = c[PLATE_LIMIT], figures[PLATE_YIELD]
    if pressed > limit:
        given += YIELD_RATE * (pressed - limit) * c[PERIOD]
    elif pressed < 0.9 * limit:
        given = max(0.0, given - YIELD_RETURN * c[PERIOD])
    figures[PLATE_YIELD] = given
    return float(given)


@linked
def move(c: Floats, memory: Floats, before: float, now: float) -> None:
    """Follow how fast the plate goes up or down: as fast as the virtual surface that it renders.

    Where it does not render there may be no such surface, as beyond a rim: then its own speed is taken.  It is smoothed
    because a limit that jumped at a change of hands would be felt.

    ``c`` (CONSTANTS,), ``memory`` (MEMORY,) of the surface; ``before`` and ``now``: its height a tick ago, and now [m].
    """
    speed = memory[CLIMB] if memory[RENDERS] > 0.0 else (now - before) / c[PERIOD]
    memory[RISES] += c[PERIOD] / (SMOOTHLY + c[PERIOD]) * (speed - memory[RISES])


@linked
def rises(kept: Floats, measured: int, top: float, moved: float, period: float) -> float:
    """Return how fast a surface rises [m/s] whose readings come late, and not in every tick.

    In the tick of a new reading its height is corrected: that is no motion.  There it rises as fast as it did by its
    last two readings, or as it was said to do before.

    ``kept`` (4,): the fields of `itouch.world.state_fields.rising_fields`; ``measured``: the tick in which the newest
    reading was measured; ``top``: the height read [m]; ``moved``: how much higher it is than a tick ago, by all that is
    known [m]; ``period`` of a tick [s].
    """
    if measured > kept[READ_AT]:
        ticks = measured - kept[READ_AT]
        kept[BY_READINGS] = (top - kept[READ_TOP]) / (ticks * period) if kept[READ_AT] > 0.0 else 0.0
        if ticks <= 1.0:
            kept[BETWEEN] = kept[BY_READINGS]
        kept[READ_AT], kept[READ_TOP] = measured, top
    else:
        kept[BETWEEN] = moved / period
    return float(max(kept[BY_READINGS], kept[BETWEEN]))


@linked
def _bearable(c: Floats, memory: Floats) -> float:
    """Return the greatest height [m] to which the plate may go without pressing harder than it may.

    A finger that comes down takes the plate with it: the table is told ahead of time where the finger will be.
    """
    soon = memory[LEVEL] + min(0.0, memory[SINK] - min(0.0, memory[RISES])) * AHEAD
    most = min(c[PLATE_LIMIT], c[FORCE_LIMIT] - ROOM)
    return float(soon + memory[OFF] + max(0.0, most) / c[PAD_STIFFNESS])


@linked
def top(c: Floats, pose: Floats) -> float:
    """Return the height of the plate's top [m] in the world for a pose (7,) of its device.

    It is the height of the lowest point of a finger that touches the plate: on a plate mounted at an angle, that is a
    little above the point of the plate below the finger.
    """
    _, _, z = turned_out(c, TABLE, pose[0] + c[OFFSET], pose[1] + c[OFFSET + 1], pose[2] + c[OFFSET + 2])
    return float(z + c[TABLE + 2] + beside(c[RADIUS], c[TABLE + 11]))


@kernel
def withdrawal_floor(c: Floats, memory: Floats, goal: Floats, sent: Floats, pressed: float) -> float:
    """Return how low [m] a plate that safety takes away may go in this tick, along its device's third axis.

    It leaves the finger slowly, however the finger moves, and never comes up; -inf: it is clear of the finger.

    ``c`` (CONSTANTS,), ``memory`` (MEMORY,) of the surface; ``goal`` and ``sent`` (7,): its device's command, and the
    pose sent last [m; quaternion]; ``pressed``: the force on it now [N].
    """
    last = top(c, sent)
    if pressed < LEFT and last - memory[LEVEL] < (0.0 if c[HAS_LOAD] > 0.0 else -CLEAR_OF):
        return -np.inf
    most = last + (min(0.0, memory[SINK]) - LETS_GO / c[PAD_STIFFNESS]) * c[PERIOD]
    return float(goal[2] + min(0.0, most - top(c, goal)) / c[TABLE + 11])


@linked
def stray(figures: Floats, sent: Floats, table: Floats) -> None:
    """Write how far the device of a surface is from where it was sent [m].

    ``figures`` (FIGURES,); ``sent`` and ``table`` (7,): the pose sent last, and the one read [m; quaternion].
    """
    square = 0.0
    for i in range(3):
        square += (sent[i] - table[i]) ** 2
    figures[TRACKING] = math.sqrt(square)


@linked
def spare(c: Floats, figures: Floats, memory: Floats, goal: Floats, pressed: float, yields: float) -> None:
    """Lower the goal (7,) of a surface to where it presses no harder than it may (K4), whichever modality carries it.

    ``c`` (CONSTANTS,), ``figures`` (FIGURES,), ``memory`` (MEMORY,) of the surface; ``goal`` (7,) [m; quaternion];
    ``pressed``: the force on it now [N]; ``yields``: how far the modality's command gives way already [m], below 0: not
    said.
    """
    if c[HAS_LOAD] > 0.0:
        wanted = top(c, goal)
        most = _bearable(c, memory)
        if yields < 0.0:
            allowed = min(wanted, most) - _yield(c, figures, pressed)
        elif memory[SETTLED] > 0.0:
            allowed = min(wanted - max(0.0, _yield(c, figures, pressed) - yields), most)
        else:
            figures[PLATE_YIELD] = 0.0  # what it yielded is contained in its depth in the finger
            allowed = min(wanted, most)
        if wanted - allowed > ROUNDING:
            x, y, z = turned_in(c, TABLE, 0.0, 0.0, allowed - wanted)
            goal[0], goal[1], goal[2] = goal[0] + x, goal[1] + y, goal[2] + z
