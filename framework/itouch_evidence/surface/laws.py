"""The laws that a carried surface must keep in every tick, each with its bound, and the figure of each for a run."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch_evidence.surface.course import Course, Floats, around

#: Errors are relative to the force, but to no smaller one than this [N]: for the arm's force, and for the plate's.
LEAST_ARM, LEAST_PLATE = 0.25, 0.5
#: An error with noise is judged over at least this many ticks, and by this percentile of it [%].
ENOUGH, MOST = 100, 95
#: How far the force of arm and plate must be below the scene's limit [N] so that it surely is not limited.
ROOM = 0.15
#: A step of the felt force is put down to the virtual force if that makes one, at most so many ticks away, which is at
#: most this much smaller [N].
APART, SAME = 3, 5e-3
#: How long a first impact lasts, in which safety limits how fast a force grows [s].
FIRST = 0.05
#: How long after a change the force is still being handed over between plate and arm [s].
LED = 0.3


@dataclass(frozen=True, slots=True)
class Law:
    """A law, and the greatest figure that keeps it, in ``unit``."""

    name: str
    says: str
    bound: float
    unit: str


LAWS = (
    Law("arm", "where the arm renders, its force is the virtual one's", 2.0, "%"),
    Law("plate", "where the plate renders, the pad's force is a rigid surface's at that height", 2.0, "%"),
    Law("aside", "where the plate renders, the arm adds the tangential part only", 2.0, "%"),
    Law("step", "at a change between arm and plate nothing steps, in a tick", 0.1, "N"),
    Law("limit", "arm and plate together stay below the scene's limit: above it by", 0.0, "N"),
    Law("absent", "a plate that is called absent presses with nothing", 0.0, "N"),
    Law("heat", "heat that flows is in the report: missing for", 3.0, "ms"),
    Law("skin", "a plate that is called absent does not cool the skin", 0.01, "K"),
    Law("trip", "no such scene is stopped", 0.0, "1"),
)
#: Behind a wire the plate's law is for the rms over a run instead: between two exchanges no command reaches the plate.
WIRED = Law("plate", "where the plate renders, the pad's force is a rigid surface's at that height (rms)", 2.0, "%")
#: The laws behind a wire.
LAWS_WIRED = tuple(WIRED if law.name == WIRED.name else law for law in LAWS)
#: Not a law of arm and plate: the steps that `step` leaves out, because the virtual force itself makes them.
VIRTUAL = Law("virtual", "left out of `step`: the virtual force itself steps by as much", 0.1, "N")


def judge(course: Course, *, wired: bool = False) -> dict[str, float]:
    """Return the figure of each law for a run, in its unit; laws that did not apply to any of its ticks are left out.

    ``wired``: whether the laws are `LAWS_WIRED` instead of `LAWS`.
    """
    steps, own = course.steps, np.r_[0.0, np.linalg.norm(np.diff(course.virtual, axis=0), axis=1)]
    changing, itself = course.changing(), steps <= around(own, APART) + SAME
    size = np.linalg.norm(course.total, axis=1)
    absent = course.touching & ~course.plate
    found = {
        "arm": _arm(course, absent),
        **_plate(course, _rms if wired else _most),
        "step": float(steps[changing & ~itself].max(initial=0.0)),
        "virtual": float(steps[changing & itself].max(initial=0.0)),
        "limit": max(0.0, max(course.before, float(size.max())) - course.force * (1.0 + 1e-9)),
        "absent": float(course.pad[absent].max(initial=0.0)),
        "trip": 0.0,
    }
    if course.warm:
        found["heat"] = 1e3 * _untold(course)
        found["skin"] = _cooled(course, absent)
    return {name: figure for name, figure in found.items() if figure is not None}


def broken(figures: dict[str, float]) -> list[str]:
    """Return the names of the laws that a run breaks, by its figures."""
    return [law.name for law in LAWS if figures.get(law.name, 0.0) > law.bound]


def _arm(course: Course, absent: NDArray[np.bool_]) -> float | None:
    """Return the greatest error of the arm's force where it renders alone [%]; None: it never does.

    It is compared with the virtual force, shortened to the scene's limit.
    """
    alone = absent & (course.share >= 0.999) & ~course.after(course.changes(), LED)
    alone &= ~course.after(course.begins(), FIRST)
    if not alone.any():
        return None
    size = np.linalg.norm(course.virtual, axis=1)
    allowed = course.virtual * np.minimum(1.0, course.force / np.maximum(size, 1e-9))[:, None]
    off = np.linalg.norm(course.arm - allowed, axis=1) / np.maximum(np.minimum(size, course.force), LEAST_ARM)
    return 100.0 * float(off[alone].max())


def _plate(course: Course, so_much: Callable[[Floats], float | None]) -> dict[str, float | None]:
    """Return the errors of the pad's force against a rigid surface's, and of the arm's against the tangential part [%].

    ``so_much`` makes one figure of the pad's errors (n,).
    """
    off, there = _off(course, course.pad)
    along = np.sum(course.virtual * course.normal, axis=1)[:, None] * course.normal
    aside, size = course.virtual - along, np.linalg.norm(course.virtual, axis=1)
    extra = np.linalg.norm(course.arm - aside, axis=1) / np.maximum(size, LEAST_PLATE)
    free = there & (np.linalg.norm(aside, axis=1) + course.pad < course.force - ROOM)
    return {"plate": so_much(off[there]), "aside": _most(extra[free])}


def least(course: Course, forces: Iterable[Floats]) -> float | None:
    """Return the least of the figures that the plate's law behind a wire gives for forces on the pad [%].

    ``forces``: arrays (n,) [N], each in place of the run's own.  None: there are too few ticks to judge.
    """
    figures = [
        figure for off, there in (_off(course, pad) for pad in forces) if (figure := _rms(off[there])) is not None
    ]
    return min(figures, default=None)


def _off(course: Course, pad: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the relative errors (n,) of forces on the pad (n,) [N] against a rigid surface's, and where they count."""
    rigid, found, there = course.rigid(pad)
    return np.abs(found - rigid) / np.maximum(rigid, LEAST_PLATE), there


def _most(off: Floats) -> float | None:
    return 100.0 * float(np.percentile(off, MOST)) if off.size >= ENOUGH else None


def _rms(off: Floats) -> float | None:
    return 100.0 * float(np.sqrt(np.mean(off**2))) if off.size >= ENOUGH else None


def _untold(course: Course) -> float:
    """Return the longest time without a break in which heat flowed that the report does not mention [s].

    For heat after the END of a contact the report gives only the longest time, which is subtracted there.
    """
    told, period = np.zeros(len(course.time), bool), course.time[1] - course.time[0]
    for contact in course.report["contacts"]:
        if contact["plate"] and contact["mean_flux_W_m2"] is not None:
            end = contact["end_s"] if contact["end_s"] is not None else np.inf
            told |= (course.time > contact["begin_s"] - 1.5 * period) & (course.time < end + 1.5 * period)
    after = [float(ms) for notice in course.report["notices"] for ms in re.findall(r"for (\d+) ms after", notice)]
    flows = (course.flux != 0.0) & ~told
    edges = np.flatnonzero(np.diff(np.r_[0, flows.astype(int), 0]))
    longest = 0.0
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        ends = begin > 0 and told[begin - 1]
        longest = max(longest, (end - begin) * period - (1e-3 * max(after, default=0.0) if ends else 0.0))
    return float(longest)


def _cooled(course: Course, absent: NDArray[np.bool_]) -> float:
    """Return by how much the skin cools while the plate is called absent [K]."""
    edges = np.flatnonzero(np.diff(np.r_[0, absent.astype(int), 0]))
    falls = [
        course.skin[begin] - course.skin[begin:end].min() for begin, end in zip(edges[::2], edges[1::2], strict=True)
    ]
    return float(max(falls, default=0.0))
