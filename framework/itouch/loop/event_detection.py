"""Contact events of a probe in a tick, found in compiled code: NEAR, then END and BEGIN, or MOVE; kept in State.

In every function ``seen`` is `EventInputs`, ``kept`` an `EventMemory`, ``event`` a `ContactArrays` and ``ended`` an
`Ended`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel, linked
from itouch.contact import layout as at
from itouch.joining import run_chain
from itouch.loop import render
from itouch.loop.probe_steps import quiet
from itouch.plugin import Contact, ContactArrays
from itouch.world.state import EVENT_DTYPE

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: The kinds of event, as numbers for compiled code; a call returns 1 + the kind of the event, or 0 for none.
NEAR, BEGIN, MOVE, END = (int(kind) for kind in (Contact.NEAR, Contact.BEGIN, Contact.MOVE, Contact.END))
#: The kind that stands for no event.
NOTHING = -1
#: A contact has ended when the probe was this far away [m], for so long [s].
SEPARATION, SEPARATION_TIME = 1e-4, 0.020

#: Where each number of a remembered event stands in its row.
_KIND, _TICK, _PROBE, _OBJECT, _POINT, _NORMAL, _DISTANCE, _SPEED, _TANGENTIAL, _PENETRATION, _FORCE, _TIME, _AREA = (
    place[1] // 8 for place in (np.dtype(EVENT_DTYPE).fields or {}).values()
)


class EventInputs(NamedTuple):
    """What events are found from; scalars have shape (1,).

    The nearest object, and the one that is touched, -1: none; the figures (FIGURES,) of `render` and the result of the
    contact search; pose (objects, 7) [m; quaternion] and twist (objects, 6) [m/s, rad/s] of the objects; the tick.
    """

    nearest: Numbers
    primary: Numbers
    figures: Floats
    result: Floats
    poses: Floats
    twists: Floats
    tick: Numbers


class EventMemory(NamedTuple):
    """What State remembers of events; scalars have shape (1,).

    The object that was near, and the one whose contact is open, -1: none; for how many ticks probe and that object have
    been apart, and the tick in which the contact began; how many events there were, and the table of the last ones
    (n, words), as integers and, in the same memory, as floats.
    """

    near: Numbers
    current: Numbers
    separated: Numbers
    begin: Numbers
    told: Numbers
    table: Numbers
    table_numbers: Floats


@kernel
def happens(seen: Any, kept: Any, event: Any, probe: int, moving: bool, moves: bool, patience: int) -> int:
    """Return 1 + the kind of what happens next at a probe in this tick, with its numbers in ``event``; 0: nothing.

    Call it until nothing more happens; after BEGIN or MOVE nothing does, and it is not called again.  At END the
    contact stays open, for whoever is told of it, until the caller sets ``kept.current`` to -1.

    Parameters
    ----------
    seen, kept, event
        See above; ``event`` is written.
    probe
        The number of the probe.
    moving, moves
        Whether objects move, and whether anybody hears MOVE.
    patience
        After how many ticks apart a contact ends.
    """
    nearest, primary, current = seen.nearest[0], seen.primary[0], kept.current[0]
    news = nearest != kept.near[0]
    kept.near[0] = nearest
    kind, index = NOTHING, -1
    if news and nearest >= 0:
        kind, index = NEAR, nearest
    elif current >= 0:
        index = current
        if not _goes_on(seen, kept, patience):
            kind = END
        elif moves:
            kind = MOVE
    elif primary >= 0:
        kept.current[0], kept.separated[0], kept.begin[0] = primary, 0, seen.tick[0]
        kind, index = BEGIN, primary
    if kind == NOTHING:
        return 0
    # one call: with a constant for its kind, each would be compiled anew
    return _tell(seen, kept, event, probe, moving, kind, index, kind != NEAR and primary == index)


@linked
def _goes_on(seen: Any, kept: Any, patience: int) -> bool:
    """Tell whether the contact with an object goes on."""
    nearest, primary, current = seen.nearest[0], seen.primary[0], kept.current[0]
    if primary == current or (primary >= 0 and _touches(seen.result, current)):
        kept.separated[0] = 0
        return True
    far = nearest != current or seen.figures[render.NEAR_DISTANCE] > SEPARATION
    kept.separated[0] = kept.separated[0] + 1 if far else 0
    return bool(primary < 0 and kept.separated[0] < patience)


@linked
def _touches(result: Any, index: int) -> bool:
    for row in range(int(result[at.RESULT_COUNT])):
        if result[at.RESULT_CONTACTS + row * at.CONTACT_WIDTH + at.CONTACT_OBJECT] == index:
            return True
    return False


@linked
def _tell(
    seen: Any, kept: Any, event: Any, probe: int, moving: bool, kind: int, index: int, touching: bool
) -> int:  # fmt: skip
    """Write the numbers of an event and, unless it is MOVE, remember it; return 1 + its kind."""
    f, begin = seen.figures, at.RESULT_NEAREST_POINT
    event.kind[0], event.tick[0], event.probe[0], event.object[0] = kind, seen.tick[0], probe, index
    for i in range(3):
        event.point[i] = f[render.POINT + i] if touching else seen.result[begin + i]
        event.normal[i] = f[render.NORMAL + i] if touching else seen.result[begin + 3 + i]
    event.distance[0] = 0.0 if touching else f[render.NEAR_DISTANCE]
    u, v, w = f[render.VELOCITY], f[render.VELOCITY + 1], f[render.VELOCITY + 2]
    if moving:  # relative to the object's material point
        x, y, z = (
            event.point[0] - seen.poses[index, 0],
            event.point[1] - seen.poses[index, 1],
            event.point[2] - seen.poses[index, 2],
        )
        vx, vy, vz = seen.twists[index, 0], seen.twists[index, 1], seen.twists[index, 2]
        wx, wy, wz = seen.twists[index, 3], seen.twists[index, 4], seen.twists[index, 5]
        u, v, w = u - (vx + wy * z - wz * y), v - (vy + wz * x - wx * z), w - (vz + wx * y - wy * x)
    nx, ny, nz = event.normal[0], event.normal[1], event.normal[2]
    along = u * nx + v * ny + w * nz
    event.speed[0] = -along
    event.tangential_velocity[0] = u - along * nx
    event.tangential_velocity[1] = v - along * ny
    event.tangential_velocity[2] = w - along * nz
    event.penetration[0], event.force[0] = f[render.PENETRATION], f[render.NORMAL_FORCE]
    event.time_to_contact[0], event.area[0] = f[render.TIME_TO_CONTACT], f[render.AREA]
    if kind != MOVE:
        _remember(kept, event)
    return 1 + kind


@linked
def _remember(kept: Any, event: Any) -> None:
    """Write an event into the table of the last events."""
    row = kept.told[0] % kept.table.shape[0]
    words, numbers = kept.table[row], kept.table_numbers[row]
    words[_KIND], words[_TICK], words[_PROBE], words[_OBJECT] = (
        event.kind[0], event.tick[0], event.probe[0], event.object[0]
    )  # fmt: skip
    for i in range(3):
        numbers[_POINT + i], numbers[_NORMAL + i] = event.point[i], event.normal[i]
        numbers[_TANGENTIAL + i] = event.tangential_velocity[i]
    numbers[_DISTANCE], numbers[_SPEED] = event.distance[0], event.speed[0]
    numbers[_PENETRATION], numbers[_FORCE] = event.penetration[0], event.force[0]
    numbers[_TIME], numbers[_AREA] = event.time_to_contact[0], event.area[0]
    kept.told[0] += 1


class Ended(NamedTuple):
    """The contact that ended last, while its log entry is still to be made, with a copy of State as it was then.

    State and the copy (n,), in whole words if State consists of such, else in bytes; ``open`` (1,): whether the entry
    is still to be made; the tick of END and the number of the probe, (1,) each.
    """

    state: NDArray[Any]
    copy: NDArray[Any]
    open: Numbers
    tick: Numbers
    probe: Numbers


@kernel
def next_told(
    seen: Any, kept: Any, event: Any, probe: int, moving: bool, moves: bool, patience: int, ended: Any
) -> int:  # fmt: skip
    """Find what happens next, as `happens` does; if nothing does, write the kind NOTHING.

    Return 0, or what `happens` returns, to leave the event to Python, where a contact ends while the entry of an
    earlier one is still to be made.
    """
    found = happens(seen, kept, event, probe, moving, moves, patience)
    if found == 0:
        event.kind[0] = NOTHING
    return found if found == 1 + END and ended.open[0] != 0 else 0


@kernel
def close(event: Any, current: Any, ended: Any) -> int:
    """At END keep a copy of State for the contact's log entry, and mark the contact as no longer open; return 0.

    ``current`` (1,): index of the object whose contact is open.
    """
    if event.kind[0] == END:
        for i in range(ended.state.shape[0]):  # not [:] =, whose message about shapes takes over a second to compile
            ended.copy[i] = ended.state[i]
        ended.open[0], ended.tick[0], ended.probe[0] = 1, event.tick[0], event.probe[0]
        current[0] = -1
    return 0


@kernel
def asks(event: Any, kinds: int) -> int:
    """Return 1, to leave the event to Python, if it is of one of these kinds, a bit for each; else 0."""
    kind = event.kind[0]
    return int(kind >= 0 and (kinds >> kind) & 1 != 0)


@kernel
def tell(
    nearest: Any, near: Any, current: Any, primary: Any, separated: Any, moves: bool, event: Any, chain: int, left: Any,
    number: int,
) -> int:  # fmt: skip
    """Deliver all that happens at a probe in this tick to those who hear it.

    Parameters
    ----------
    nearest, near, current, primary, separated, moves
        Indices of objects, and a count, shape (1,) each, and whether anybody hears MOVE; see `probe_steps.quiet`.
    event
        Written; see above.
    chain
        Address of the chain that finds one event and delivers it (`Chain.place`).
    left
        Where the chain has stopped, index and code as of `run_chain`, if a call has left something to Python, shape
        (1,); written.
    number
        What is returned then, 1 or more.
    """
    if quiet(nearest, near, current, primary, separated, moves) == 0:
        return 0
    while True:
        found = run_chain(chain, 0)
        if found >= 0:
            left[0] = found
            return number
        if event.kind[0] != NEAR and not (event.kind[0] == END and primary[0] >= 0):
            return 0


def silent() -> ContactArrays:
    """Return the numbers of an event, all 0, into which events are written."""
    sizes = (3, 3, 1, 1, 3, 1, 1, 1, 1)
    return ContactArrays._make([*(np.zeros(1, np.int64) for _ in range(4)), *(np.zeros(size) for size in sizes)])
