"""Joined supervision of arms and carried surfaces near the finger, and of all that acts on one finger together.

What is unusual is left to Python.  It looks again at an arm whose share changes; what was found of a surface stands in
its post's ``said``, and Python acts on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.joining import SKIP
from itouch.loop.device_runner import Runner
from itouch.loop.probe_rig import ProbeRig
from itouch.loop.render import TABLE, size
from itouch.loop.run_statistics import Counts, counted
from itouch.monitors import Arm, Surface
from itouch.monitors.arm_kernels import Pushing, check
from itouch.monitors.surface_kernels import (
    Allowed,
    FingerAbove,
    Load,
    Memory,
    SurfaceObservation,
    count,
    pressed_by,
    rise,
)
from itouch.monitors.surface_kernels import check as watch
from itouch.monitors.thresholds import TOUCH_FORCE
from itouch.plugin import Bound, Record
from itouch.safety import Finger
from itouch.safety.latch import ENABLED
from itouch.safety.monitor_step import TOLD, Clocks, clocked, moment
from itouch.twin.frame_rotation import turned_in

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Code that leaves the step to Python.
PYTHON = 1


class MonitorViews(NamedTuple):
    """What of a device and its monitor is used here, each of shape (1,): status, left-out ticks, last look, share."""

    status: Numbers
    missed: Numbers
    checked: Numbers
    share: Floats


class TickViews(NamedTuple):
    """The tick and whether scripts go on, shape (1,) each, the servo period [s], and the code of an enabled device."""

    tick: Numbers
    ready: Numbers
    period: float
    enabled: int


class Carried(NamedTuple):
    """A surface and the finger over it.

    ``pose`` (7,) or (0,): its reading of its pose; ``tracking_error`` (1,): how far it is from its command [m];
    ``finger`` (3,) and ``top`` (1,): finger and top of the surface in the world [m]; ``frame``: the constants of the
    probe, which hold the frame of the device.  ``touch`` (2,): room for the result of a look; ``touched`` and ``felt``
    (1,): what other monitors are told.
    """

    pose: Floats
    tracking_error: Floats
    finger: Floats
    top: Floats
    frame: Floats
    touch: Floats
    touched: Numbers
    felt: Floats


@kernel
def arm(
    post: MonitorViews, pushing: Pushing, wrench: Floats, velocity: Floats, figure: Floats, tick: Any, enabled: int
) -> int:  # fmt: skip
    """Watch an arm; ``figure`` (1,) is written.

    ``wrench`` (6,): sent last [N, N m]; ``velocity`` (3,): of the finger [m/s]; ``tick`` (1,): the number of this tick.
    """
    if post.status[0] != enabled:
        return SKIP
    if check(pushing, wrench, size(velocity), figure) != post.share[0]:
        return PYTHON
    post.checked[0] = tick[0] + post.missed[0]
    return 0


@kernel
def surface(
    post: MonitorViews, allowed: Allowed, memory: Memory, load: Load, one: Carried, clocks: Clocks, said: Floats,
    turn: TickViews, tracking: Counts, radius: float, calibrates: bool,
) -> int:  # fmt: skip
    """Watch a carried surface, and count how far it is from its command once scripts go on.

    ``calibrates``: a touch-off finds its height; ``radius``: of the finger [m]; ``tracking``: histogram of the
    distances.  ``said`` (1,) is written for Python: the share of the drive that is allowed, 0 to 1, or minus the code
    of a trip.
    """
    if post.status[0] != turn.enabled:
        return SKIP
    if turn.ready[0] != 0:
        counted(tracking, one.tracking_error[0])
    now, time, seconds = moment(clocks, post.checked[0], turn.tick[0], turn.period)
    post.checked[0] = turn.tick[0] + clocks.missed[0]
    x = one.finger[0] - one.frame[TABLE]
    y = one.finger[1] - one.frame[TABLE + 1]
    z = one.finger[2] - one.frame[TABLE + 2]
    gap = one.finger[2] - radius - one.top[0]
    seen = SurfaceObservation(now, time, seconds, one.tracking_error[0], gap, turn.ready[0] != 0 and calibrates)
    found = watch(allowed, memory, load, one.pose, turned_in(one.frame, TABLE, x, y, z), seen, one.touch)
    if found >= 0.0 and memory.looked[0] == now:
        one.touched[0], one.felt[0] = int(one.touch[0]), one.touch[1]
    said[0] = found
    return 0 if found == post.share[0] else TOLD


@kernel
def together(
    load: Load, nearing: FingerAbove, touch: float, force: float, room: Floats, allowed: Allowed, memory: Memory,
    status: Any, touched: Any, missed: Any, said: Floats, turn: TickViews,
) -> int:  # fmt: skip
    """Leave an arm the force [N] that a surface does not take, and run the clock of T4.

    ``load``, ``allowed``, ``memory``: of the surface; ``status``, a code, ``touched``, whether it is, and ``missed``,
    how many ticks were left out, (1,) each: of its device; ``nearing``: of the finger; ``touch``: the least force that
    counts [N]; ``force``: the greatest of all together [N]; ``room`` (n,), n at most 1: the force
    left for the arm, written.  ``said`` (1,) is written for Python.
    """
    pressed = pressed_by(load, nearing)
    more = rise(nearing, pressed)
    if not pressed > touch:
        pressed = 0.0
    for i in range(room.shape[0]):
        room[i] = max(0.0, force - (pressed + more))
    time = clocked(turn.tick[0] + missed[0], turn.period)
    found = count(allowed, memory, time, status[0] == turn.enabled and touched[0] != 0)
    said[0] = found
    return TOLD if found < 0.0 else 0


@kernel
def shown(status: Any, enabled: int, touched: Any, force: Floats, its_touched: Any, its_force: Floats) -> int:
    """Tell the device that this one carries whether it is touched, and with what force [N]; arrays have shape (1,).

    ``status``: of this one, a code; ``touched``, ``its_touched``: whether each is touched; ``its_touched`` and
    ``its_force`` are written.
    """
    if status[0] == enabled:
        its_touched[0], its_force[0] = touched[0], force[0]
    return 0


def bound_supervision(
    runner: Runner, rig: ProbeRig, carried: Sequence[Runner], state: Record, tracking: Counts
) -> tuple[Bound, ...]:  # fmt: skip
    """Return the supervision of an arm or a table of one finger as compiled calls; none: it is left to Python."""
    panel = runner.gate.device_monitors
    placed = [post for post in panel.installed if post.monitor.needs_finger_position]
    if len(placed) != 1 or not all(post.own for post in panel.installed):
        return ()
    (post,), name = placed, runner.model.name
    monitor, tick = post.monitor, state["tick"]
    own = MonitorViews(runner.latch.seen, panel.clocks[0], post.checked, post.share)
    if isinstance(monitor, Arm) and rig.moves(runner):
        wrench, velocity = monitor.sent_of(runner.sent), state[f"{rig.probe.name}.velocity"]
        looks = Bound(arm, own, monitor.pushing, wrench, velocity, post.state["figure"], tick, int(ENABLED))
    elif isinstance(monitor, Surface) and runner is rig.table and not runner.model.wire:
        over = rig.contact_step.over
        one = Carried(
            monitor.pose(panel.seen), state[f"{rig.probe.name}.tracking"], over.finger, over.top, over.frame,
            np.array([0.0, math.nan]), state[f"{name}.touched"], state[f"{name}.felt"],
        )  # fmt: skip
        looks = Bound(
            surface, own, monitor.allowed, monitor.memory(post.state), monitor.load(panel.seen), one, panel.times,
            post.said, TickViews(tick, state["ready"], rig.model.period, int(ENABLED)), tracking,
            rig.probe.scene.radius, rig.touch_off is not None,
        )  # fmt: skip
    else:
        return ()
    mine = (state[f"{name}.touched"], state[f"{name}.felt"])
    told = [(state[f"{one.model.name}.touched"], state[f"{one.model.name}.felt"]) for one in carried]
    return (looks, *(Bound(shown, runner.latch.seen, int(ENABLED), *mine, *its) for its in told))


def bound_together(finger: Finger, state: Record, period: float) -> Bound | None:
    """Return ``Finger.check`` as a compiled call, for one surface and at most one arm and one plate; None: Python's."""
    if not finger.simple or finger.worn:
        return None
    table = finger.tables[0]
    post = table.device_monitors.surface
    nearing = finger.nearing.get(table.model.name)
    if post is None or not isinstance(post.monitor, Surface) or nearing is None:
        return None
    room = finger.arms_of[0].actuation.moving.room if finger.arms_of else np.zeros(0)
    panel, monitor = table.device_monitors, post.monitor
    return Bound(
        together, monitor.load(panel.seen), nearing, TOUCH_FORCE, finger.force, room, monitor.allowed,
        monitor.memory(post.state), table.latch.seen, state[f"{table.model.name}.touched"], panel.times.missed,
        post.said, TickViews(state["tick"], state["ready"], period, int(ENABLED)),
    )  # fmt: skip
