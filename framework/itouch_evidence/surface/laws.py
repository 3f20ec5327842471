"""What a carried surface must hold to in every tick, each law with its bound, and what a run shows of it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch_evidence.surface.course import Course, Floats, around

#: What a part of a small force is counted of, of the arm's and of the plate's [N].
LEAST_ARM, LEAST_PLATE = 0.25, 0.5
#: Of so many ticks at least an error is judged that has noise, by the part of them that must be within the bound [%].
ENOUGH, MOST = 100, 95
#: How far below the limits of plate and scene their forces are what a surface would give [N].
ROOM = 0.15
#: How many ticks apart the virtual force and what is felt may do the same, and what they may then differ by [N].
APART, SAME = 3, 5e-3
#: For how long a first impact lasts, in which safety lets no force grow at once [s].
FIRST = 0.05
#: For how long after a change the force is still led over from one to the other [s].
LED = 0.3


@dataclass(frozen=True, slots=True)
class Law:
    """A law, and the greatest figure that is within it, in its unit."""

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
    Law("heat", "heat that flows is in the report: not told for", 3.0, "ms"),
    Law("skin", "a plate that is called absent does not cool the skin", 0.01, "K"),
    Law("trip", "no such scene is stopped", 0.0, "1"),
)
#: Behind a wire it holds in the mean over a run instead: between two exchanges a plate is where it is.
WIRED = Law("plate", "where the plate renders, the pad's force is a rigid surface's at that height (rms)", 2.0, "%")
#: The laws behind a wire.
LAWS_WIRED = tuple(WIRED if law.name == WIRED.name else law for law in LAWS)
#: Not a law of arm and plate: what `step` leaves out, because the virtual force itself does it.
VIRTUAL = Law("virtual", "left out of `step`: the virtual force itself steps by as much", 0.1, "N")


def judge(course: Course, *, wired: bool = False) -> dict[str, float]:
    """Return the figure of each law for a run, in its unit; a law that the run says nothing of is left out.

    ``wired``: of `LAWS_WIRED`.
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
        "limit": max(0.0, float(size.max()) - course.force * (1.0 + 1e-9)),
        "absent": float(course.pad[absent].max(initial=0.0)),
        "trip": 0.0,
    }
    if course.warm:
        found["heat"] = 1e3 * _untold(course)
        found["skin"] = _cooled(course, absent)
    return {name: figure for name, figure in found.items() if figure is not None}


def broken(figures: dict[str, float]) -> list[str]:
    """Return the names of the laws that figures of a run break."""
    return [law.name for law in LAWS if figures.get(law.name, 0.0) > law.bound]


def _arm(course: Course, absent: NDArray[np.bool_]) -> float | None:
    """Return how far the arm is from the virtual force, as far as the scene allows that, where it renders alone [%]."""
    alone = absent & (course.share >= 0.999) & ~course.after(course.changes(), LED)
    alone &= ~course.after(course.begins(), FIRST)
    if not alone.any():
        return None
    size = np.linalg.norm(course.virtual, axis=1)
    allowed = course.virtual * np.minimum(1.0, course.force / np.maximum(size, 1e-9))[:, None]
    off = np.linalg.norm(course.arm - allowed, axis=1) / np.maximum(np.minimum(size, course.force), LEAST_ARM)
    return 100.0 * float(off[alone].max())


def _plate(course: Course, so_much: Callable[[Floats], float | None]) -> dict[str, float | None]:
    """Return how far the pad's force is from a rigid surface's, and the arm's from the tangential part [%]."""
    rigid, pad, there = course.rigid()
    off = np.abs(pad - rigid) / np.maximum(rigid, LEAST_PLATE)
    along = np.sum(course.virtual * course.normal, axis=1)[:, None] * course.normal
    aside, size = course.virtual - along, np.linalg.norm(course.virtual, axis=1)
    extra = np.linalg.norm(course.arm - aside, axis=1) / np.maximum(size, LEAST_PLATE)
    free = there & (np.linalg.norm(aside, axis=1) + course.pad < course.force - ROOM)
    return {"plate": so_much(off[there]), "aside": _most(extra[free])}


def _most(off: Floats) -> float | None:
    return 100.0 * float(np.percentile(off, MOST)) if off.size >= ENOUGH else None


def _rms(off: Floats) -> float | None:
    return 100.0 * float(np.sqrt(np.mean(off**2))) if off.size >= ENOUGH else None


def _untold(course: Course) -> float:
    """Return for how long at a stretch heat flowed of which the report says nothing [s].

    What flows after the END of a contact is told by the longest such time.
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
