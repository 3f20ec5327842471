"""Which solids of different materials overlap: there the scene does not tell which of them the finger meets.

Boxes, spheres, capsules and cylinders are convex: whether two of them have points in common is found by following the
point of their Minkowski difference that is nearest to the origin (Gilbert, Johnson and Keerthi 1988).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import poses
from itouch.scene import Scene
from itouch.scene.elements import Box, Capsule, Cylinder, Sphere
from itouch.world.bindings import extent, pose_of

Floats = NDArray[np.float64]
#: A function that returns the point of a solid (3,) that lies farthest along a direction (3,) [m].
Support = Callable[[Floats], Floats]

#: Solids that penetrate each other by no more than this only touch [m].
TOUCH = 1e-6
#: Greatest number of objects of which every pair is checked.
MOST = 200
#: After so many steps two solids count as apart: they touch, or nearly so.
STEPS = 64


def overlaps(scene: Scene, boxes: Mapping[str, Any]) -> Iterator[str]:
    """Yield a notice for each pair that ``overlapping`` finds."""
    for _, _, sentence in overlapping(scene, boxes):
        yield f"{sentence}; move them apart"


def overlapping(scene: Scene, boxes: Mapping[str, Any]) -> Iterator[tuple[Any, Any, str]]:
    """Yield two elements and a sentence for each pair of resting convex solids of different materials that overlap.

    Meshes are not checked: what they enclose may be hollow, or open.  ``boxes`` as in ``extent``.
    """
    solids = [(element, found) for element in scene.objects if (found := _solid(element, boxes)) is not None]
    for (one, first), (other, second) in combinations(solids[:MOST], 2):
        if one.material == other.material or _beside(first, second) or not _meet(_support(one), _support(other)):
            continue
        sentence = (
            f"objects '{one.name}' ({one.material}) and '{other.name}' ({other.material}) overlap: where they do, "
            "the finger meets whichever surface comes first"
        )
        yield one, other, sentence


def _solid(element: Any, boxes: Mapping[str, Any]) -> tuple[Any, Any] | None:
    if not isinstance(element, (Box, Sphere, Capsule, Cylinder)):
        return None
    moves = element.motion is not None or element.pose_from or element.dynamics is not None
    return None if moves else extent(element, boxes)


def _beside(first: tuple[Any, Any], second: tuple[Any, Any]) -> bool:
    """Tell whether two extents, lower and upper corner (3,) [m], have nothing in common but their faces."""
    return bool(np.any(np.minimum(first[1], second[1]) - np.maximum(first[0], second[0]) <= TOUCH))


def _support(element: Any) -> Support:
    """Return the support function of a solid that is smaller all round by half of what counts as touching."""
    centre, turn = np.array(element.pos), np.asarray(poses.matrix(pose_of(element)[3:]))
    less = TOUCH / 2.0
    if isinstance(element, Box):
        half = np.array(element.size) / 2.0 - less
        return lambda way: centre + turn @ (np.sign(turn.T @ way) * half)
    radius = element.radius - less
    if isinstance(element, Sphere):
        return lambda way: centre + radius * way / np.linalg.norm(way)
    along = turn[:, 2]
    if isinstance(element, Capsule):
        half_length = element.length / 2.0
        return lambda way: centre + np.sign(way @ along) * half_length * along + radius * way / np.linalg.norm(way)
    end = element.length / 2.0 - less

    def of_cylinder(way: Floats) -> Floats:
        side = way - (way @ along) * along
        size = float(np.linalg.norm(side))
        place: Floats = centre + np.sign(way @ along) * end * along
        return place + radius * side / size if size > 0.0 else place

    return of_cylinder


def _meet(one: Support, other: Support) -> bool:
    """Tell whether two convex solids have a point in common."""

    def difference(way: Floats) -> Floats:
        return one(way) - other(-way)

    points = difference(np.array([1.0, 0.0, 0.0]))[None]
    nearest = points[0]
    for _ in range(STEPS):
        square = float(nearest @ nearest)
        if square < (1e-3 * TOUCH) ** 2:
            return True
        farther = difference(-nearest)
        if float(nearest @ farther) > 0.0:  # all of the difference lies beyond a plane: they are apart
            return False
        if square - float(nearest @ farther) <= 1e-12 * square:
            return False
        nearest, points = _towards(np.vstack((points, farther)))
    return False


def _towards(points: Floats) -> tuple[Floats, Floats]:
    """Return the point nearest to the origin of a simplex (n, 3), n at most 4, and the corners that span it there."""
    best, kept = points[0], points[:1]
    for size in range(1, len(points) + 1):
        for chosen in combinations(range(len(points)), size):
            corners = points[list(chosen)]
            edges = (corners[1:] - corners[0]).T
            parts = np.linalg.lstsq(edges, -corners[0], rcond=None)[0] if size > 1 else np.empty(0)
            if size > 1 and (parts.min() < 0.0 or parts.sum() > 1.0):
                continue
            place = corners[0] + edges @ parts
            if place @ place < best @ best:
                best, kept = place, corners
    return best, kept
