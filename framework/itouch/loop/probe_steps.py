"""The steps of one probe in a tick that stand between those of ``render`` and ``surface``, as calls that join.

They decide what is left to Python, and hand what a modality says of its surface to the functions of ``surface``.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.contact.distance_queries import beside
from itouch.joining import SKIP
from itouch.loop import render
from itouch.loop.surface import force, force_estimate, ground, handover, plate, surface_memory
from itouch.monitors.default_limits import SPEED_NEAR
from itouch.monitors.surface_kernels import pace

Floats = NDArray[np.float64]

#: Code that leaves the step to Python.
PYTHON = 1
#: A surface that is further away than this is as good as none [m].
FURTHEST = 1.0
#: By how much farther away [m] a surface still counts as near to a finger that goes away faster than it may follow.
WIDER = 5e-3


class ProbeArrays(NamedTuple):
    """A probe: its constants (CONSTANTS,) and figures (FIGURES,) of `render`, and its surface's memory (MEMORY,)."""

    c: Floats
    figures: Floats
    kept: Floats


class Objects(NamedTuple):
    """The objects of a scene.

    ``world`` (objects, WORLD_WIDTH); ``mesh``: vertices (v, 3) [m], triangles (n, TRIANGLE_WIDTH) and nodes
    (m, NODE_WIDTH) of all their meshes, see `itouch.contact.bvh`; ``poses`` (objects, 7) [m; quaternion], ``twists``
    (objects, 6) [m/s, rad/s].
    """

    world: Floats
    mesh: Any
    poses: Floats
    twists: Floats


class Carrier(NamedTuple):
    """The device that carries a surface.

    Its reading of its pose (7,), the pose sent to it last (7,), and its command (7,) [m; quaternion]; its reading of
    the force on it (6,) [N, N m], of which the third number is negative where a finger presses; behind a wire the tick
    in which the pose was measured (1,), and what is remembered of readings (4,), see `plate.rises`; else ``read`` has
    shape (0,), and each tick has its own reading.
    """

    table: Floats
    sent: Floats
    goal: Floats
    load: Floats
    measured: Any
    read: Floats


class StatedReadings(NamedTuple):
    """What a modality said a tick ago of a device's readings, which are older, (1,) each; see `SurfaceFields`.

    The force on the surface [N], below 0: nothing is said; how much higher the surface is than was read, and its
    distance from the finger [m].
    """

    presses: Floats
    risen: Floats
    distance: Floats


class StatedSurface(NamedTuple):
    """What a modality says of the surface that it carries, (1,) each: 0 or 1, lengths [m]; see `SurfaceFields`."""

    renders: Any
    present: Any
    distance: Any
    gap: Any
    coming: Any
    missed: Any
    yields: Any


@kernel
def placed(fixed: Any) -> int:
    """Leave the step to Python while frames may move; ``fixed`` (1,): whether they stay as they are."""
    return 0 if fixed[0] != 0 else PYTHON


@kernel
def look_beside(
    world: Floats, mesh: Any, poses: Floats, primary: Any, point: Floats, normal: Floats, reach: float, found: Any,
    away: Any,
) -> int:  # fmt: skip
    """Find which object begins beside the touched place, within reach [m]; ``found`` and ``away`` are written.

    ``world``, ``mesh``, ``poses``: as in `Objects`; ``primary`` (1,): index of the touched object, -1: none; ``point``
    [m] and ``normal`` [1], (3,) each: where it is touched, in the world; ``found`` (1,): index of the object beside it,
    -1: none; ``away`` (1,): how far away that begins [m].
    """
    found[0], away[0] = -1, np.inf
    if primary[0] >= 0:
        other, distance = beside(world, mesh, poses, primary[0], point, normal, reach)
        if other >= 0:
            found[0], away[0] = other, distance
    return 0


@kernel
def only_virtual(figures: Floats, felt: Floats) -> int:
    """Write the felt force (1,) of a probe without a surface: the virtual one, as there is no other.

    ``figures`` (FIGURES,) of `render`; ``felt`` [N].
    """
    felt[0] = figures[render.NORMAL_FORCE]
    return 0


@kernel
def led(withdrawn: Any, kept: Floats) -> int:
    """Leave the step to Python while safety, not the modality, leads the surface (T4).

    ``withdrawn`` (1,): whether it is withdrawn, a code; ``kept`` (MEMORY,) is the memory of the surface, with the units
    of `itouch.loop.surface.surface_memory`.
    """
    return PYTHON if withdrawn[0] != 0 or kept[surface_memory.MISSED] == surface_memory.WITHDRAWN else 0


@kernel
def look_below(
    own: ProbeArrays, objects: Objects, table: Floats, load: Floats, said: StatedReadings, below: Any, down: Floats,
    normal: Floats, start: Floats, measured: Any, fresh: bool,
) -> int:  # fmt: skip
    """Find the virtual surface below the finger, for the modality that carries one to it; ``below`` (1,): its index.

    ``table`` (7,) and ``load`` (6,): the device's readings of its pose [m; quaternion] and of the force on it [N, N m];
    ``said``: what its modality says of these; ``down``, ``normal`` and ``start`` (3,) as in `ground.find`; ``fresh``:
    whether each tick has its own readings, else ``measured`` (1,) is the tick in which the newest of the force was
    measured; (0,): it is not read.  ``below``, ``figures`` and ``kept`` are written.
    """
    c, figures, kept = own.c, own.figures, own.kept
    presses, risen, distance = said.presses, said.risen, said.distance
    world, mesh, poses, twists = objects.world, objects.mesh, objects.poses, objects.twists
    below[0] = ground.find(c, world, mesh, poses, twists, figures, kept, down, normal, start)
    higher = 0.0 if math.isnan(risen[0]) else risen[0]
    if fresh and presses[0] < 0.0:
        depth = plate.top(c, table) + higher - (figures[render.HIP + 2] - c[render.RADIUS])
        force_estimate.estimate(c, kept, load[2], depth)
    elif not fresh and presses[0] >= 0.0 and not math.isnan(distance[0]) and measured.shape[0] > 0:
        # what the modality says is of a tick ago, and not of the pose that has come since
        away = min(max(distance[0], -FURTHEST), FURTHEST)
        depth = -away - c[render.PERIOD] * figures[render.VELOCITY + 2]
        force_estimate.estimate_late(c, kept, load[2], presses[0], depth, float(measured[0]))
    else:  # what is read, or said, is all that is known
        force_estimate.believe(kept, -force.on_plate(load, presses))
    plate.foresee(c, table, figures, kept, force_estimate.believed(kept, force.on_plate(load, presses)), higher)
    return 0


@kernel
def carried(
    own: ProbeArrays,
    carrier: Carrier,
    said: StatedSurface,
    primary: Any,
    there: Any,
    rising: Floats,
    tick: Any,
    period: float,
) -> int:
    """Take over what a modality says of the surface that it carries.

    Parameters
    ----------
    own, carrier
        The probe, and the device, whose command is lowered where the surface would press harder than it may.
    said
        What the modality says.  If one is not a number, the step is left to Python.  Of the distance that the modality
        says and that by the device's own pose, the shorter counts, because a speed limit near the finger depends on it.
    primary, tick, period
        Index of the touched object (1,), -1: none; the tick (1,) and its length [s].
    there, rising
        Written, (1,) each: whether what touches the finger is the surface, and how fast it rises [m/s].
    """
    c, figures, kept = own.c, own.figures, own.kept
    table, load, read = carrier.table, carrier.load, carrier.read
    renders, present, distance, gap = said.renders, said.present, said.distance, said.gap
    coming, missed, yields = said.coming, said.missed, said.yields
    if math.isnan(distance[0]) or math.isnan(gap[0]) or math.isnan(renders[0]) or math.isnan(present[0]):
        return PYTHON
    if math.isnan(coming[0]) or math.isnan(missed[0]) or math.isnan(yields[0]):
        return PYTHON
    before, touching = figures[render.PLATE_TOP], primary[0] >= 0
    felt = force_estimate.believed(kept, load[2])
    pressed = max(0.0, -felt)
    away = min(max(distance[0], -FURTHEST), FURTHEST)
    height, top = figures[render.HIP + 2] - c[render.RADIUS] - away, plate.top(c, table)
    figures[render.PLATE_TOP] = height if height > top + plate.ROUNDING else top
    figures[render.PLATE_GAP] = gap[0]
    handover.miss(c, figures, kept, missed[0], pressed, touching, tick[0] * period)
    handover.take_over(c, kept, renders[0] != 0, present[0] != 0, away, coming[0], touching)
    plate.move(c, kept, before, figures[render.PLATE_TOP])
    plate.stray(figures, carrier.sent, table)
    plate.spare(c, figures, kept, carrier.goal, max(0.0, -load[2]), yields[0])
    force.feel(c, figures, kept, felt, touching)
    force.linger(c, figures, kept, felt, touching, tick[0] * period)
    there[0] = int(kept[surface_memory.PRESENT])
    moved = figures[render.PLATE_TOP] - before
    rising[0] = plate.rises(read, carrier.measured[0], top, moved, period) if read.shape[0] else moved / period
    return 0


def gap_of(figures: Floats, radius: float) -> float:
    """Return the distance [m] between finger pad and plate, by their readings, for how fast that may come nearer.

    From a finger that goes away faster than a near plate may follow, it counts as less by WIDER.  Where the plate is
    near, and must be slow, the finger would leave it behind; where it is not, it would catch up: in and out in turn, it
    would be as fast as the finger, which a near plate must not be.

    ``figures`` (FIGURES,) of `render`; ``radius`` [m].  Plain Python, so that a tick in which Python carries the
    surface has nothing to compile.
    """
    gap = figures[render.HIP + 2] - radius - figures[render.PLATE_TOP]
    return float(gap - WIDER if figures[render.VELOCITY + 2] > SPEED_NEAR else gap)


_gap_of = kernel(gap_of)


@kernel
def close_in(
    figures: Floats, radius: float, tracking: float, near: float, close: float, far: float, closing: Floats,
    clamped: Any,
) -> int:  # fmt: skip
    """Choose how fast the surface may approach the finger [m/s]; where it may not at all, count a limited command.

    ``figures`` (FIGURES,) of `render`, ``closing`` (1,) and ``clamped`` (1,), a count, are written; ``radius`` [m], the
    other numbers as in `carried.pace`.
    """
    closing[0] = pace(_gap_of(figures, radius), figures[render.TRACKING], tracking, near, close, far)
    if closing[0] == 0.0:
        clamped[0] += 1
    return 0


@kernel
def quiet(nearest: Any, near: Any, current: Any, primary: Any, separated: Any, moves: bool) -> int:
    """Leave the step to Python if there is an event to tell or a contact about to end; all arrays have shape (1,).

    ``nearest``, ``near``, ``primary``, ``current``: indices of the nearest object, of the one that was near, of the
    touched one, and of the one whose contact is open, -1: none; ``separated``: for how many ticks that has been apart;
    ``moves``: whether anybody hears MOVE.
    """
    if nearest[0] != near[0]:
        return PYTHON
    if current[0] < 0:
        return PYTHON if primary[0] >= 0 else 0
    return PYTHON if moves or primary[0] != current[0] or separated[0] != 0 else 0


@kernel
def original(replaced: Any) -> int:
    """Leave the step to Python where another twin has replaced the compiled one; ``replaced`` (1,): whether it has."""
    return PYTHON if replaced[0] != 0 else 0


@kernel
def turn(tick: Any, every: int) -> int:
    """Skip the rest of the step except in one tick of ``every``; ``tick`` (1,): the number of this tick."""
    return 0 if tick[0] % every == 0 else SKIP


@kernel
def due(tick: Any, every: int) -> int:
    """Leave the step to Python in one tick of ``every``; ``tick`` (1,): the number of this tick."""
    return PYTHON if tick[0] % every == 0 else 0
