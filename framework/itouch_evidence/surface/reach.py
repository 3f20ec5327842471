"""How near a plate behind a wire can come to the virtual surface at all: a bound to judge the law of its force by.

A command reaches the table only in an exchange, acts after that has ended and until the next one has, and the drive
follows it by its own control.  Nobody who commands it can undo this.  Here the table's twin is sent, through the same
exchanges, where the virtual surface *will be* under the finger, which only somebody knows who has seen the whole run;
and where it would be if it went on at its speed, which is all that can be known without a model of the hand.  The path
of the finger is that of the run.  How far ahead the commands look is chosen afterwards, the best for each run.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from itouch.plugin import Field, Record, Role, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch.world import DeviceModel
from itouch_evidence.surface.course import Course, Floats

#: Over how many ticks the speed of the virtual surface is taken.
SPAN = 3
#: How much farther ahead than the middle of a command's time the commands may look [ticks]: a drive needs time, too.
FARTHER = range(10)
#: Where the table begins [m], so that the path of the surface is within its travel.
BEGINS = 0.01


class Reach(NamedTuple):
    """The pad's force (n,) [N] over a run, once for each look ahead that was tried.

    ``know``: with commands that know the finger's path; ``straight``: with commands that take it to go on straight.
    """

    know: list[Floats]
    straight: list[Floats]


def reach(course: Course, table: DeviceModel, seed: int = 0) -> Reach:
    """Return the pad's force under the best commands through a wire.

    Parameters
    ----------
    course
        A run behind this wire.
    table
        The device that carries the plate, with its wire; its twin is moved along the vertical alone.
    seed
        Seed of the twin's noise.
    """
    period = float(course.time[1] - course.time[0])
    height = surface(course)
    speed = np.zeros_like(height)
    speed[SPAN:] = (height[SPAN:] - height[:-SPAN]) / SPAN
    middle = round((table.cls.delay + 0.5 * table.cls.period) / period)
    know, straight = [], []
    for ahead in (middle + more for more in FARTHER):
        at = np.minimum(np.arange(len(height)) + ahead, len(height) - 1)
        know.append(_pressed(course, height, _follow(table, height[at], period, seed), period))
        straight.append(_pressed(course, height, _follow(table, height + ahead * speed, period, seed), period))
    return Reach(know, straight)


def surface(course: Course) -> Floats:
    """Return the height of the virtual surface below the finger (n,) [m]; where there is none, the one before."""
    height = course.depth + course.lowest
    there = np.flatnonzero(np.isfinite(height))
    if not there.size:
        return np.zeros(len(height))
    before = np.maximum(0, np.searchsorted(there, np.arange(len(height)), side="right") - 1)
    found: Floats = height[there[before]]
    return found


def _follow(table: DeviceModel, wanted: Floats, period: float, seed: int) -> Floats:
    """Return the heights (n,) [m] at which the table's twin truly is when it is sent ``wanted`` (n,) [m]."""
    twin = table.make_twin()
    state, command = Record.of(twin.fields()), Record.of([Field.of(channel) for channel in table.commands])
    twin.reset(state, np.random.default_rng(seed))
    channel = table.command(Role.SURFACE_POSE)
    name = channel.name if channel is not None else ""
    lowest, touch = float(wanted.min()), TwinInputs()
    command[name] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    found, bound = np.empty(len(wanted)), BoundTwin(twin)
    for i, height in enumerate(wanted.tolist()):
        command[name][2] = height - lowest + BEGINS
        bound.step(state, command, touch, period)
        place = twin.position(state)
        found[i] = place[2] + lowest - BEGINS if place is not None else height
    return found


def _pressed(course: Course, height: Floats, plate: Floats, period: float) -> Floats:
    """Return the force (n,) [N] on the finger's pad of a plate at these heights (n,) [m]."""
    depth = np.where(np.isfinite(course.depth), course.depth + plate - height, 0.0)
    rate = np.r_[0.0, np.diff(depth)] / period
    pressed = np.maximum(0.0, course.pad_stiffness * depth + course.pad_damping * rate)
    force: Floats = np.where(depth > 0.0, pressed, 0.0)
    return force
