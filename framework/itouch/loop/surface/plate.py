"""Where the plate of a carried surface goes.

With s the height at which the finger would rest on the highest virtual surface below it, f the lowest point of the
probe and c the clearance, the plate's top goes to max(s, f - c); x and y follow the finger.  It renders contacts whose
normal is near its own.  From others it withdraws to f - c and touches nothing: they are the arm's alone.  Which of the
two it is may change while the contact lasts.  Then the plate leaves the finger, or comes to it, slowly *against the
finger* while it may be felt, however the finger moves.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.loop.render import (
    CLEARANCE,
    FORCE_LIMIT,
    HAS_LOAD,
    HIP,
    NORMAL,
    OFFSET,
    PAD_STIFFNESS,
    PERIOD,
    PLATE_GAP,
    PLATE_LIMIT,
    PLATE_TOP,
    PLATE_YIELD,
    RADIUS,
    SURFACE_HEIGHT,
    TABLE,
    TABLE_SPEED,
    TRACKING,
)
from itouch.loop.surface.choice import LED, choose, doubt
from itouch.loop.surface.feeling import feel
from itouch.loop.surface.ground import along_plate
from itouch.loop.surface.memory import (
    ABOUT,
    CHANGING,
    CLIMB,
    GIVE,
    HAND_OVER,
    HIGH,
    LAG,
    LEFT,
    LEVEL,
    MISSED,
    OFF,
    PRESENT,
    PRESS,
    PRESSED,
    RENDERS,
    SETTLED,
    SINK,
    TOUCH,
    UPRIGHT,
)
from itouch.twin.frame_rotation import turned_in, turned_out
from itouch.world.presented_surfaces import ROOM

Floats = NDArray[np.float64]

#: How fast a plate leaves a finger or comes to it in a contact, while it may be felt and while it is clear [m/s].
SOFTLY, QUICKLY = 0.015, 0.1
#: How near below the finger a plate may be felt soon [m].
SOON = 1.5e-3
#: A plate that is further behind its command than this is waited for, so that it does not come in a hurry [m].
BEHIND = 2e-4
#: What a command may be ahead of the one sent last and not be held up [m].
SLACK = 3e-5
#: How fast the plate yields above its greatest force [m/s per N], and how fast it comes back [m/s].
YIELD_RATE, YIELD_RETURN = 0.02, 0.005
#: What two ways of reckoning one height may differ by [m].
ROUNDING = 1e-12
#: How far ahead a plate's force is seen, for a table needs time [s].
AHEAD = 0.008
#: Time constant [s] with which it is seen that a plate is felt sooner or later than its height says.
SETTLE = 0.02
#: How fast it is learned how far the table gives way and how late it is [1/s], the most that is made good [m/N], [s],
#: and what is another error than that [m].
LEARNS, MOST_GIVE, MOST_LAG, ASTRAY = 80.0, 1e-4, 0.005, 1e-4
#: Speed up or down [m/s] well below which what a table misses is by the force on it, and well above by its lag.
STILL = 0.01
#: Gains of the filter on the finger's height, a g-h filter that forgets in about 5 ms (Benedict and Bordner 1962);
#: and the difference from which on it begins anew [m].
G, H, LOST = 0.3, 0.3**2 / (2.0 - 0.3), 2e-3


@kernel
def _smooth(c: Floats, memory: Floats, lowest: float) -> None:
    """Follow the finger's lowest point: an arm's reading goes in steps, and no plate should."""
    ahead = memory[LEVEL] + memory[SINK] * c[PERIOD]
    off = lowest - ahead
    if abs(off) > LOST:
        memory[LEVEL], memory[SINK] = lowest, 0.0
        return
    memory[LEVEL] = ahead + G * off
    memory[SINK] += H * off / c[PERIOD]


@kernel
def _yield(c: Floats, figures: Floats, pressed: float) -> float:
    """Give way while the plate presses harder than it may."""
    limit, given = c[PLATE_LIMIT], figures[PLATE_YIELD]
    if pressed > limit:
        given += YIELD_RATE * (pressed - limit) * c[PERIOD]
    elif pressed < 0.9 * limit:
        given = max(0.0, given - YIELD_RETURN * c[PERIOD])
    figures[PLATE_YIELD] = given
    return float(given)


@kernel
def _goes(memory: Floats) -> float:
    """Return how fast the plate goes down by itself [m/s], at most 0, as the surface does that it stands for."""
    return float(min(0.0, memory[CLIMB])) if memory[RENDERS] > 0.0 and memory[SETTLED] > 0.0 else 0.0


@kernel
def _bearable(c: Floats, memory: Floats, here: float, pressed: float) -> float:
    """Return the greatest height [m] to which the plate may go, so that it presses no harder than it may.

    ``here`` is where its top is by what its device reads [m], whatever else is said of it.
    A finger that comes down takes the plate with it: the table is told ahead of time where it will be.
    """
    stiffness = c[PAD_STIFFNESS]
    if pressed > TOUCH:
        off = here - memory[LEVEL] - pressed / stiffness
        memory[OFF] += c[PERIOD] / SETTLE * (off - memory[OFF])
    elif pressed < LEFT:
        memory[OFF] = 0.0
    soon = memory[LEVEL] + min(0.0, memory[SINK] - _goes(memory)) * AHEAD
    most = min(c[PLATE_LIMIT], c[FORCE_LIMIT] - ROOM)
    return float(soon + memory[OFF] + max(0.0, most) / stiffness)


@kernel
def _come(c: Floats, memory: Floats, goal: float, last: float, depth: float, pressed: float, touching: bool) -> None:
    """Bring the plate to the finger, until it is at its goal [m]; ``depth``: how far it is in the finger [m].

    ``last`` is the height [m] to which it was sent last: what is in the way of a plate must not make it hurry later.
    """
    felt = pressed > LEFT
    if not touching and not felt:
        memory[SETTLED] = 1.0
        return
    if memory[SETTLED] > 0.0 and touching and memory[PRESSED] == 0.0 and depth < -ABOUT:  # not there in time
        memory[SETTLED], memory[PRESS] = 0.0, depth
    if memory[SETTLED] > 0.0:
        return
    memory[PRESS] = min(memory[PRESS], last - memory[LEVEL] + memory[SINK] * c[PERIOD] + SLACK)
    if memory[PRESS] < depth + BEHIND:
        memory[PRESS] += (SOFTLY if felt or memory[PRESS] > -SOON else QUICKLY) * c[PERIOD]
    if memory[LEVEL] + memory[PRESS] >= goal:
        memory[SETTLED] = 1.0


@kernel
def _go(c: Floats, memory: Floats, last: float, pressed: float, touching: bool) -> None:
    """Take the plate away from the finger, by the clearance, or further if it is still felt there.

    ``last`` is where it was sent last, less the height of the finger [m].
    """
    full, felt, high = -c[CLEARANCE], pressed > LEFT, memory[MISSED] == HIGH
    if memory[SETTLED] > 0.0:
        memory[SETTLED], memory[PRESS] = 0.0, last if high else max(last, full)
    if not touching and not felt:
        memory[PRESS] = min(memory[PRESS], full) if high else full
        return
    slow = not high and (felt or memory[PRESS] > -SOON)
    way = (SOFTLY if slow else QUICKLY) * c[PERIOD]
    memory[PRESS] = memory[PRESS] - way if felt and high else min(memory[PRESS], max(full, memory[PRESS] - way))


@kernel
def _learn(c: Floats, figures: Floats, memory: Floats, last: float, pressed: float, touching: bool) -> None:
    """Learn by how much the table misses its command, where nothing but the surface moves it.

    It misses it by so much for each newton on it, and by so much for each m/s up or down.
    """
    if not touching or pressed < TOUCH or figures[PLATE_YIELD] > 0.0:
        return
    speed = memory[CLIMB]
    off = last - figures[PLATE_TOP] - memory[GIVE] * pressed - memory[LAG] * speed
    if abs(off) > ASTRAY:
        return
    moves = speed * speed / (speed * speed + STILL * STILL)  # 1: what is seen is the lag, 0: it is the force
    step = LEARNS * c[PERIOD] * off
    give = memory[GIVE] + (1.0 - moves) * step * pressed / (pressed * pressed + 0.01)
    memory[GIVE] = min(MOST_GIVE, max(0.0, give))
    lag = memory[LAG] + moves * step * speed / (speed * speed + STILL * STILL)
    memory[LAG] = min(MOST_LAG, max(-MOST_LAG, lag))


@kernel
def _height(
    c: Floats, figures: Floats, memory: Floats, lowest: float, last: float, pressed: float, touching: bool
) -> float:
    """Return the height [m] at which the plate is wanted; ``last``: that to which it was sent last."""
    away, height, depth = lowest - c[CLEARANCE], figures[SURFACE_HEIGHT], figures[PLATE_TOP] - lowest
    goal = height + memory[CLIMB] * (c[PERIOD] + memory[LAG]) + (memory[GIVE] * pressed if touching else 0.0)
    if memory[RENDERS] > 0.0:
        _come(c, memory, goal, last, depth, pressed, touching)
    else:
        _go(c, memory, last - memory[LEVEL], pressed, touching)
    if memory[SETTLED] > 0.0:
        return float(max(goal - _yield(c, figures, pressed), away))
    figures[PLATE_YIELD] = 0.0  # what it yielded is in how far it is in the finger
    wanted = memory[LEVEL] + memory[PRESS]
    if height > -np.inf and wanted > goal:
        wanted = max(goal, away)
    return float(wanted)


@kernel
def _there(memory: Floats, depth: float, pressed: float) -> bool:
    """Tell whether the plate is at the finger, or about to be; ``depth`` is how far the finger seems in it [m]."""
    if depth > -ABOUT or (memory[RENDERS] > 0.0 and (memory[SETTLED] > 0.0 or memory[PRESS] > -HAND_OVER)):
        return True
    return pressed > (LEFT if memory[PRESENT] > 0.0 else TOUCH)


@kernel
def top(c: Floats, pose: Floats) -> float:
    """Return the height of the plate's top [m] in the world if its carrier has a pose (7,)."""
    _, _, z = turned_out(c, TABLE, pose[0] + c[OFFSET], pose[1] + c[OFFSET + 1], pose[2] + c[OFFSET + 2])
    return float(z + c[TABLE + 2])


@kernel
def _command(c: Floats, figures: Floats, sent: Floats, goal: Floats, height: float, touching: bool) -> None:
    """Write the table's command (7,): the plate under the finger at a height [m]; in touch it gives way first."""
    goal[0], goal[1], goal[2] = turned_in(
        c, TABLE, figures[HIP] - c[TABLE], figures[HIP + 1] - c[TABLE + 1], height - c[TABLE + 2]
    )
    for i in range(3):
        goal[i] -= c[OFFSET + i]
        goal[4 + i] = 0.0
    goal[3] = 1.0
    reach, down = c[TABLE_SPEED] * c[PERIOD], sent[2] - goal[2]
    aside = math.sqrt((goal[0] - sent[0]) ** 2 + (goal[1] - sent[1]) ** 2)
    left = math.sqrt(max(0.0, reach * reach - down * down))
    if touching and down > 0.0 and aside > left:
        for i in range(2):
            goal[i] = sent[i] + (goal[i] - sent[i]) * left / aside


@kernel
def stray(figures: Floats, sent: Floats, table: Floats) -> None:
    """Write how far what carries a surface is from where it was sent; poses (7,).

    ``figures`` (FIGURES,); ``sent`` and ``table`` (7,) [m; quaternion].
    """
    square = 0.0
    for i in range(3):
        square += (sent[i] - table[i]) ** 2
    figures[TRACKING] = math.sqrt(square)


@kernel
def spare(
    c: Floats, table: Floats, figures: Floats, memory: Floats, goal: Floats, pressed: float, yields: float
) -> None:  # fmt: skip
    """Lower the goal (7,) of a surface that somebody else carries to where it presses no harder than it may (K4).

    ``c`` (CONSTANTS,), ``figures`` (FIGURES,), ``memory`` (MEMORY,) of the surface; ``table``, what its device reads of
    its pose, and ``goal`` (7,) [m; quaternion]; ``pressed``: the force on it now [N]; ``yields``: how far it has given
    way already [m], below 0: not said.
    """
    _smooth(c, memory, figures[HIP + 2] - c[RADIUS])
    if c[HAS_LOAD] > 0.0:
        wanted = top(c, goal)
        most = _bearable(c, memory, top(c, table), pressed)
        if yields < 0.0:
            allowed = min(wanted, most) - _yield(c, figures, pressed)
        elif memory[SETTLED] > 0.0:
            allowed = min(wanted - max(0.0, _yield(c, figures, pressed) - yields), most)
        else:
            figures[PLATE_YIELD] = 0.0  # what it yielded is in how far it is in the finger
            allowed = min(wanted, most)
        if wanted - allowed > ROUNDING:
            x, y, z = turned_in(c, TABLE, 0.0, 0.0, allowed - wanted)
            goal[0], goal[1], goal[2] = goal[0] + x, goal[1] + y, goal[2] + z


@kernel
def take_over(
    c: Floats, memory: Floats, renders: bool, present: bool, away: float, coming: float, touching: bool
) -> None:  # fmt: skip
    """Remember who renders a contact as somebody else says it who carries the surface, ``away`` from the finger [m].

    ``c`` (CONSTANTS,), ``memory`` (MEMORY,) of the surface; ``coming``: how far it is still to come or to go [m], below
    0: not said.  What is missed, or withdrawn, renders nothing.
    """
    renders = renders and memory[MISSED] == 0.0
    if touching and memory[PRESSED] > 0.0 and renders != (memory[RENDERS] > 0.0):
        memory[CHANGING] = LED
    memory[RENDERS] = 1.0 if renders else 0.0
    memory[PRESENT] = 1.0 if touching and present else 0.0
    memory[SETTLED], memory[PRESS] = 1.0, -away
    if coming >= 0.0:
        memory[SETTLED] = 1.0 if renders and coming == 0.0 else 0.0
        if not renders:
            memory[PRESS] = coming - c[CLEARANCE]  # so that it is away when it says so, wherever that is


@kernel
def carry(
    c: Floats, table: Floats, sent: Floats, figures: Floats, memory: Floats, goal: Floats, load: float,
    touching: bool, ready: bool, time: float,
) -> None:  # fmt: skip
    """Say who renders the surface that was found under the finger, and command the plate.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    table, sent
        Pose reading of the table, and the pose last sent to it, shape (7,).
    figures, memory
        The probe's part of State, and that of the carried surface.
    goal
        The table's command, shape (7,); written.
    load
        The table's reading of the force along its z axis [N]; a finger that presses makes it negative.
    touching, ready, time
        Whether there is a virtual contact, whether the rig is calibrated, and the time of the tick [s].
    """
    lowest, height = figures[HIP + 2] - c[RADIUS], figures[SURFACE_HEIGHT]
    here, last = top(c, table), top(c, sent)
    figures[PLATE_TOP], figures[PLATE_GAP] = here, height - here if height > -np.inf else np.inf
    pressed = max(0.0, -load)
    choose(c, memory, along_plate(c, figures[NORMAL : NORMAL + 3]) if touching else memory[UPRIGHT], touching)
    if ready:
        doubt(c, figures, memory, pressed, touching, time)
    _smooth(c, memory, lowest)
    wanted = _height(c, figures, memory, lowest, last, pressed, touching)
    most = _bearable(c, memory, here, pressed)
    if memory[RENDERS] > 0.0 and memory[SETTLED] > 0.0 and wanted <= most:
        _learn(c, figures, memory, last, pressed, touching)
    wanted = min(wanted, most)
    _command(c, figures, sent, goal, wanted, touching)
    memory[PRESENT] = 1.0 if touching and _there(memory, here - lowest, pressed) else 0.0
    stray(figures, sent, table)
    feel(c, figures, memory, load, touching)
