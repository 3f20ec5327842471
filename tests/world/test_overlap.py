"""Solids of different materials that overlap are told; those that only touch, or stand beside one another, are not."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from itouch.scene.elements import Box, Sphere
from itouch.world.overlap import overlaps


def box(name: str, x: float, material: str, turn: float = 0.0) -> Box:
    size = (0.02, 0.02, 0.02)
    return Box(name=name, pos=(x, 0.0, 0.0), rpy=(0.0, 0.0, math.radians(turn)), size=size, material=material)


def ball(name: str, x: float, y: float, material: str) -> Sphere:
    return Sphere(name=name, pos=(x, y, 0.0), radius=0.01, material=material)


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
    ],
)
def test_what_does_not_overlap_is_not_told(objects: tuple[Any, Any]) -> None:
    assert not told(*objects)


@pytest.mark.parametrize("moves", [{"motion": object()}, {"pose_from": "arm"}, {"dynamics": object()}])
def test_what_moves_is_not_told(moves: dict[str, Any]) -> None:
    assert told(box("left", 0.0, "wood"), box("right", 0.015, "steel"))
    assert not told(box("left", 0.0, "wood"), replace(box("right", 0.015, "steel"), **moves))
