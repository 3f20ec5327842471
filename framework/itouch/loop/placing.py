"""Supervision where the finger is, and what acts on it together, compiled as far as nothing unusual is seen.

What is unusual changes nothing here and is left to Python: a trip, a share that changes, a check whose turn it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.joining import SKIP
from itouch.loop.rig import ProbeRig
from itouch.loop.run_statistics import Counts, counted
from itouch.loop.runner import Runner
from itouch.monitors import Arm, Surface
from itouch.monitors.carried import Load, Nearing, felt, rise, size
from itouch.monitors.pushed import Pushing, check
from itouch.monitors.surface import TOUCH_FORCE
from itouch.plugin import Bound, Record
from itouch.safety import Finger
from itouch.safety.lifecycle import ENABLED

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Leaves the step to Python.
PYTHON = 1


class Post(NamedTuple):
    """A device with the monitor that looks at it, each of shape (1,): status, left-out ticks, last look, share."""

    status: Numbers
    missed: Numbers
    checked: Numbers
    share: Floats


class Astray(NamedTuple):
    """How far a surface is from its command [m], for how long that was too far [s], and when it was looked at [s]."""

    distance: Floats
    lasted: Floats
    looked: Floats


class Rules(NamedTuple):
    """Greatest distance [m] and force [N] before more is asked; the time between slower looks, and the period [s]."""

    distance: float
    force: float
    slow: float
    period: float


@kernel
def arm(
    post: Post, pushing: Pushing, wrench: Floats, velocity: Floats, figure: Floats, tick: Any, enabled: int
) -> int:  # fmt: skip
    """Watch an arm: the wrench sent last (6,), and the velocity of the finger (3,)."""
    if post.status[0] != enabled:
        return SKIP
    if check(pushing, wrench, size(velocity), figure) != post.share[0]:
        return PYTHON
    post.checked[0] = tick[0] + post.missed[0]
    return 0


@kernel
def surface(
    post: Post, rules: Rules, load: Load, astray: Astray, tick: Any, ready: Any, tracking: Counts, enabled: int
) -> int:  # fmt: skip
    """Watch a carried surface, and count how far it is from its command once scripts go on."""
    if post.status[0] != enabled:
        return SKIP
    if astray.distance[0] > rules.distance or astray.lasted[0] != 0.0 or felt(load) > rules.force:
        return PYTHON
    now = tick[0] + post.missed[0]
    if not now * rules.period - astray.looked[0] < rules.slow or post.share[0] != 1.0:
        return PYTHON
    if ready[0] != 0:
        counted(tracking, astray.distance[0])
    post.checked[0] = now
    return 0


@kernel
def together(
    load: Load, nearing: Nearing, touch: float, force: float, room: Floats, counted_at: Floats, missed: Any, tick: Any,
    slow: float, period: float,
) -> int:  # fmt: skip
    """Leave an arm the force [N] that a surface does not take, and see whether the clock of T4 is to be run.

    ``load``: of the surface; ``nearing``: of the finger; ``touch``: the force that counts [N]; ``force``: of all
    together [N]; ``room`` (n,): what is left for each of at most one arm; ``counted_at`` (1,): when that clock was
    looked at last [s].
    """
    if not (tick[0] + missed[0]) * period - counted_at[0] < slow:
        return PYTHON
    pressed = felt(load)
    more = rise(nearing, pressed)
    if not pressed > touch:
        pressed = 0.0
    for i in range(room.shape[0]):
        room[i] = max(0.0, force - (pressed + more))
    return 0


@kernel
def shown(status: Any, enabled: int, touched: Any, force: Floats, its_touched: Any, its_force: Floats) -> int:
    """Tell what a device carries whether it is touched, and with what force, each of shape (1,)."""
    if status[0] == enabled:
        its_touched[0], its_force[0] = touched[0], force[0]
    return 0


def bound_supervision(
    runner: Runner, rig: ProbeRig, carried: Sequence[Runner], state: Record, tracking: Counts
) -> tuple[Bound, ...]:  # fmt: skip
    """Return the supervision of an arm, or of a table, where one finger is, as compiled calls; none: it is Python."""
    panel = runner.panel
    placed = [post for post in panel.posts if post.monitor.placed]
    if len(placed) != 1 or not all(post.own for post in panel.posts):
        return ()
    (post,), name = placed, runner.model.name
    monitor, tick = post.monitor, state["tick"]
    own = Post(runner.gate, panel.clocks[0], post.checked, post.share)
    if isinstance(monitor, Arm) and runner is rig.arm:
        wrench, velocity = monitor.sent_of(runner.sent), state[f"{rig.probe.name}.velocity"]
        looks = Bound(arm, own, monitor.pushing, wrench, velocity, post.state["figure"], tick, int(ENABLED))
    elif isinstance(monitor, Surface) and runner is rig.table and not runner.model.wire:
        distance, lasted, looked = state[f"{rig.probe.name}.tracking"], post.state["strayed_for"], post.state["looked"]
        looks = Bound(
            surface, own, Rules(*monitor.most, rig.model.period), monitor.load(panel.seen),
            Astray(distance, lasted, looked), tick, state["ready"], tracking, int(ENABLED),
        )  # fmt: skip
    else:
        return ()
    mine = (state[f"{name}.touched"], state[f"{name}.felt"])
    told = [(state[f"{one.model.name}.touched"], state[f"{one.model.name}.felt"]) for one in carried]
    return (looks, *(Bound(shown, runner.gate, int(ENABLED), *mine, *its) for its in told))


def bound_together(finger: Finger, state: Record, period: float) -> Bound | None:
    """Return what ``Finger.check`` does while nothing is wrong, of one surface and at most one arm and one plate."""
    if not finger.simple or finger.worn:
        return None
    table = finger.tables[0]
    post = table.panel.surface
    nearing = finger.nearing.get(table.model.name)
    if post is None or not isinstance(post.monitor, Surface) or nearing is None:
        return None
    room = finger.arms_of[0].moving.room if finger.arms_of else np.zeros(0)
    return Bound(
        together, post.monitor.load(table.panel.seen), nearing, TOUCH_FORCE, finger.force, room,
        post.state["counted"], table.panel.clocks[0], state["tick"], post.monitor.most[2], period,
    )  # fmt: skip
