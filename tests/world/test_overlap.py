"""Solids of different materials that overlap are told; those that only touch, or stand beside one another, are not."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch.plugin import poses
from itouch.scene.elements import Box, Capsule, Cylinder, Sphere
from itouch.world.bindings import extent, pose_of
from itouch.world.overlap import overlaps


def box(name: str, x: float, material: str, turn: float = 0.0) -> Box:
    size = (0.02, 0.02, 0.02)
    return Box(name=name, pos=(x, 0.0, 0.0), rpy=(0.0, 0.0, math.radians(turn)), size=size, material=material)


def ball(name: str, x: float, y: float, material: str) -> Sphere:
    return Sphere(name=name, pos=(x, y, 0.0), radius=0.01, material=material)


def rod(
    name: str, x: float, y: float, material: str, kind: type[Capsule | Cylinder] = Cylinder, tilt: float = 0.0
) -> Capsule | Cylinder:
    """A rod of 10 mm radius and 40 mm length upright at x and y, tilted about y [deg]."""
    turned = (0.0, math.radians(tilt), 0.0)
    return kind(name=name, pos=(x, y, 0.0), rpy=turned, radius=0.01, length=0.04, material=material)


def told(*objects: Any) -> list[str]:
    scene: Any = SimpleNamespace(objects=objects)
    return list(overlaps(scene, {}))


@pytest.mark.parametrize(
    "objects",
    [
        (box("left", 0.0, "wood"), box("right", 0.015, "steel")),
        (box("left", 0.0, "wood"), box("right", 0.0235, "steel", 45.0)),
        (box("left", 0.0, "wood"), ball("right", 0.019, 0.0, "steel")),
        (box("left", 0.0, "wood"), ball("right", 0.0, 0.0, "steel")),
        (ball("left", 0.0, 0.0, "wood"), ball("right", 0.013, 0.013, "steel")),
        (box("left", 0.0, "wood"), rod("right", 0.019, 0.0, "steel")),
        (box("left", 0.0, "wood", 45.0), rod("right", 0.0139, 0.0139, "steel")),
        (rod("left", 0.0, 0.0, "wood", Capsule), rod("right", 0.019, 0.0, "steel", Capsule)),
        (rod("left", 0.0, 0.0, "wood", Capsule, 90.0), rod("right", 0.039, 0.0, "steel")),
        (rod("left", 0.0, 0.0, "wood"), ball("right", 0.0139, 0.0139, "steel")),
        (rod("left", 0.0, 0.0, "wood", Cylinder, 90.0), rod("right", 0.0, 0.019, "steel", Capsule)),
    ],
)
def test_an_overlap_is_told(objects: tuple[Any, Any]) -> None:
    (sentence,) = told(*objects)
    assert "'left' (wood)" in sentence
    assert "'right' (steel)" in sentence


@pytest.mark.parametrize(
    "objects",
    [
        (box("left", 0.0, "wood"), box("right", 0.02, "steel")),  # side by side
        (box("left", 0.0, "wood"), box("right", 0.015, "wood")),  # of one material
        (box("left", 0.0, "wood", 45.0), ball("right", 0.0175, 0.0175, "steel")),  # their bounds overlap, not they
        (box("left", 0.0, "wood"), ball("right", 0.0172, 0.0172, "steel")),  # beside the corner
        (ball("left", 0.0, 0.0, "wood"), ball("right", 0.015, 0.015, "steel")),
        (box("left", 0.0, "wood"), rod("right", 0.02, 0.0, "steel")),  # side by side
        (box("left", 0.0, "wood", 45.0), rod("right", 0.0143, 0.0143, "steel")),
        (rod("left", 0.0, 0.0, "wood"), rod("right", 0.02, 0.0, "steel")),
        (rod("left", 0.0, 0.0, "wood", Cylinder, 90.0), rod("right", 0.0305, 0.0, "steel")),
        (rod("left", 0.0, 0.0, "wood", Capsule, 45.0), rod("right", 0.0, 0.0201, "steel", Capsule, -45.0)),
        (rod("left", 0.0, 0.0, "wood"), ball("right", 0.0142, 0.0142, "steel")),
    ],
)
def test_what_does_not_overlap_is_not_told(objects: tuple[Any, Any]) -> None:
    assert not told(*objects)


@pytest.mark.parametrize("moves", [{"motion": object()}, {"pose_from": "arm"}, {"dynamics": object()}])
def test_what_moves_is_not_told(moves: dict[str, Any]) -> None:
    assert told(box("left", 0.0, "wood"), box("right", 0.015, "steel"))
    assert not told(box("left", 0.0, "wood"), replace(box("right", 0.015, "steel"), **moves))


@pytest.mark.parametrize("seed", range(12))
def test_two_solids_overlap_if_one_of_their_points_lies_deep_in_the_other(seed: int) -> None:
    """Random points of both are looked for in both; with none in common, and none near, they are apart."""
    rng = np.random.default_rng(seed)
    made = [solid(rng) for _ in range(2)]
    clouds = [points(one, rng) for one in made]
    deep = [depth(one, cloud) for one, cloud in zip(made, reversed(clouds), strict=True)]
    found = bool(told(*made))
    if max(float(one.max()) for one in deep) > 1e-4:
        assert found
    if max(float(one.max()) for one in deep) < -4e-3:  # farther apart than the points lie from each other
        assert not found


def solid(rng: np.random.Generator) -> Any:
    kind = rng.choice(["box", "sphere", "capsule", "cylinder"])
    name, place = f"{kind}{rng.integers(10**9)}", tuple(rng.uniform(-0.02, 0.02, 3).tolist())
    turned, stuff = tuple(rng.uniform(-3.0, 3.0, 3).tolist()), name
    radius, length = rng.uniform(0.004, 0.015, 2).tolist()
    if kind == "box":
        return Box(name=name, pos=place, rpy=turned, size=tuple(rng.uniform(0.008, 0.03, 3).tolist()), material=stuff)
    if kind == "sphere":
        return Sphere(name=name, pos=place, radius=radius, material=stuff)
    rods = {"capsule": Capsule, "cylinder": Cylinder}
    return rods[kind](name=name, pos=place, rpy=turned, radius=radius, length=2.0 * length, material=stuff)


def within(one: Any, places: np.ndarray) -> np.ndarray:
    """Return places (n, 3) in a solid's own frame."""
    return (places - np.array(one.pos)) @ np.asarray(poses.matrix(pose_of(one)[3:]))


def depth(one: Any, places: np.ndarray) -> np.ndarray:
    """Return how deep places (n, 3) are in a solid, at least; below 0: how far outside, at least [m]."""
    own = within(one, places)
    if isinstance(one, Box):
        return (np.array(one.size) / 2 - np.abs(own)).min(axis=1)
    if isinstance(one, Sphere):
        return one.radius - np.linalg.norm(own, axis=1)
    if isinstance(one, Capsule):
        own[:, 2] -= np.clip(own[:, 2], -one.length / 2, one.length / 2)
        return one.radius - np.linalg.norm(own, axis=1)
    return np.minimum(one.radius - np.hypot(own[:, 0], own[:, 1]), one.length / 2 - np.abs(own[:, 2]))


def points(one: Any, rng: np.random.Generator) -> np.ndarray:
    """Return random points in a solid (n, 3)."""
    low, high = (np.array(corner) for corner in extent(one, {}) or ())
    places = rng.uniform(low, high, (60_000, 3))
    return places[depth(one, places) >= 0.0]
