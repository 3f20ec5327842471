"""Random scenes of a carried surface, each drawn from a seed and a number: they are the same on every machine."""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np

from itouch_evidence.surface import edges, meshes, moving
from itouch_evidence.surface.scenes import RADIUS, Slope, ball, ramp

#: The steepest ramp [deg].
STEEPEST = 80.0
#: Greatest speed of strokes over a ball [mm/s]: a plate that slides past a finger at more than 0.15 m/s trips (K5).
FASTEST = 140.0
#: Share of the scenes that have a thermal display on the table.
WARM = 0.3


def draw(number: int, seed: int, folder: Path) -> tuple[str, Slope]:
    """Return the family and the scene of a number; ``folder`` has the shipped scenes, and the mesh is written there."""
    rng = random.Random(f"surface {seed} {number}")
    family = tuple(FAMILIES)[number % len(FAMILIES)]
    return family, dataclasses.replace(FAMILIES[family](rng, folder), warm=rng.random() < WARM)


def _ramp(rng: random.Random, folder: Path) -> Slope:
    return _with(rng, *ramp(rng.uniform(0.0, STEEPEST), rng.uniform(1.0, 6.0)))


def _ball(rng: random.Random, folder: Path) -> Slope:
    """Return a scene of strokes over a ball, both drawn from wide ranges of speed and size."""
    count = rng.randint(3, 6)
    angles = np.clip(np.cumsum([rng.uniform(-35.0, 35.0) for _ in range(count)]), -70.0, 70.0).tolist()
    radius, deep = rng.uniform(5.0, 100.0), rng.uniform(1.5, 8.0)
    longest = 1.875 * math.radians(np.abs(np.diff([0.0, *angles])).max()) * (radius + RADIUS)
    speed = math.exp(rng.uniform(math.log(10.0), math.log(FASTEST)))
    each = max(min(max(0.1, longest / speed), 8.0 / count), longest / FASTEST)  # a plate withdraws after 10 s (T4)
    return _with(rng, *ball(angles, each, radius, deep))


def _mesh(rng: random.Random, folder: Path) -> Slope:
    return _stroked(rng, meshes.make, folder, rng.choice(meshes.KINDS))


def _shipped(rng: random.Random, folder: Path) -> Slope:
    return _stroked(rng, meshes.shipped, folder, rng.choice(meshes.SHIPPED))


def _edge(rng: random.Random, folder: Path) -> Slope:
    return edges.edge(_seed(rng))


def _rim(rng: random.Random, folder: Path) -> Slope:
    return edges.rim(_seed(rng))


def _moving(rng: random.Random, folder: Path) -> Slope:
    return moving.moved(_seed(rng))


FAMILIES: dict[str, Callable[[random.Random, Path], Slope]] = {
    "ramp": _ramp, "ball": _ball, "mesh": _mesh, "shipped mesh": _shipped, "edge": _edge, "rim": _rim,
    "moving": _moving,
}  # fmt: skip


def _seed(rng: random.Random) -> int:
    return rng.randrange(10**9)


def _with(rng: random.Random, world: str, motion: str) -> Slope:
    return Slope(world, motion, **_material(rng), seed=rng.randint(0, 99))  # type: ignore[arg-type]


def _material(rng: random.Random) -> dict[str, float]:
    return {
        "stiffness": rng.uniform(0.4, 2.0), "friction": rng.choice((0.0, 0.3, 0.8)), "force": rng.uniform(1.0, 3.0),
    }  # fmt: skip


def _stroked(rng: random.Random, make: Callable[..., Slope], folder: Path, kind: str) -> Slope:
    deep, speed, scene = rng.uniform(2.0, 7.0), rng.uniform(15.0, 110.0), _material(rng)
    found = make(folder, kind, _seed(rng), deep=deep, speed=speed, **scene)
    return dataclasses.replace(found, seed=rng.randint(0, 99))
