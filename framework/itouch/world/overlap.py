"""Which solids of different materials overlap: there the scene does not tell which of them the finger meets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any

import numpy as np

from itouch.plugin import poses
from itouch.scene import Scene
from itouch.scene.elements import Box, Sphere
from itouch.world.bindings import extent, pose_of

#: Solids that penetrate each other by no more than this only touch [m].
TOUCH = 1e-6
#: Greatest number of objects of which every pair is checked.
MOST = 200


def overlaps(scene: Scene, boxes: Mapping[str, Any]) -> Iterator[str]:
    """Yield a notice for each pair that ``overlapping`` finds."""
    for _, _, sentence in overlapping(scene, boxes):
        yield f"{sentence}; move them apart"


def overlapping(scene: Scene, boxes: Mapping[str, Any]) -> Iterator[tuple[Any, Any, str]]:
    """Yield two elements and a sentence for each pair of resting boxes and spheres of different materials that overlap.

    Other shapes are not checked: their bounding boxes may overlap where they do not.  ``boxes`` as in ``extent``.
    """
    solids = [(element, found) for element in scene.objects if (found := _solid(element, boxes)) is not None]
    for (one, first), (other, second) in combinations(solids[:MOST], 2):
        if one.material == other.material or _apart(one, first, other, second):
            continue
        sentence = (
            f"objects '{one.name}' ({one.material}) and '{other.name}' ({other.material}) overlap: where they do, "
            "the finger meets whichever surface comes first"
        )
        yield one, other, sentence


def _solid(element: Any, boxes: Mapping[str, Any]) -> tuple[Any, Any] | None:
    if not isinstance(element, (Box, Sphere)):
        return None
    moves = element.motion is not None or element.pose_from or element.dynamics is not None
    return None if moves else extent(element, boxes)


def _apart(one: Any, first: tuple[Any, Any], other: Any, second: tuple[Any, Any]) -> bool:
    """Tell whether two solids are apart, by their bounds along separating axes: the world's and those of the boxes."""
    if np.any(np.minimum(first[1], second[1]) - np.maximum(first[0], second[0]) <= TOUCH):
        return True
    turns = [poses.matrix(pose_of(element)[3:]) for element in (one, other) if isinstance(element, Box)]
    axes = [axis for turn in turns for axis in np.asarray(turn).T]
    if len(turns) == 2:
        axes += [np.cross(a, b) for a in np.asarray(turns[0]).T for b in np.asarray(turns[1]).T]
    else:
        axes.append(_nearest(one, other))
    between = np.subtract(other.pos, one.pos)
    for axis in axes:
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            continue
        along = axis / length
        if abs(float(between @ along)) + TOUCH >= _reach(one, along) + _reach(other, along):
            return True
    return False


def _nearest(one: Any, other: Any) -> Any:
    """Return the direction between the nearest points of two solids, one of them a sphere, shape (3,)."""
    ball, solid = (one, other) if isinstance(one, Sphere) else (other, one)
    away = np.subtract(ball.pos, solid.pos)
    if not isinstance(solid, Box):
        return away
    turn, half = np.asarray(poses.matrix(pose_of(solid)[3:])), np.array(solid.size) / 2
    inside = turn.T @ away
    return turn @ (inside - np.clip(inside, -half, half))


def _reach(element: Any, along: Any) -> float:
    """Return how far a solid extends from its centre along a unit vector (3,) [m]."""
    if isinstance(element, Sphere):
        return float(element.radius)
    return float(np.abs(along @ np.asarray(poses.matrix(pose_of(element)[3:]))) @ (np.array(element.size) / 2))
