"""Distances from primitives."""

import numpy as np
import pytest

from itouch.contact import Box, Capsule, Cylinder, Plane, Shape, Sphere
from itouch.contact import layout as at
from itouch.contact.distance import distance

SHAPES = [Plane(), Sphere(0.7), Box((0.3, 0.5, 0.8)), Capsule(0.4, 0.6), Cylinder(0.5, 0.4)]


def measure(shape: Shape, q: np.ndarray) -> tuple[float, np.ndarray]:
    site = np.zeros((1, at.SITE_WIDTH))
    site[0, at.FRAME_KIND] = shape.kind
    site[0, at.FRAME_SIZE : at.FRAME_SIZE + 3] = shape.sizes()
    depth, normal, _ = distance(site, 0, tuple(q))
    return float(depth), np.array(normal)


def surface_points(shape: Shape, rng: np.random.Generator, count: int) -> np.ndarray:
    """Points on the surface, by going out from the middle axis until the inside ends."""
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    low, high = np.zeros(count), np.full(count, 3.0)
    for _ in range(60):
        middle = (low + high) / 2
        inside = np.array([measure(shape, w * m)[0] < 0 for w, m in zip(ways, middle, strict=True)])
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return ways * low[:, None]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_the_foot_of_the_distance_is_on_the_surface(shape: Shape, rng: np.random.Generator) -> None:
    for q in rng.uniform(-1.5, 1.5, (300, 3)):
        depth, normal = measure(shape, q)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-12)
        assert measure(shape, q - depth * normal)[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("shape", SHAPES[1:], ids=lambda s: type(s).__name__)
def test_no_point_of_the_surface_is_nearer(shape: Shape, rng: np.random.Generator) -> None:
    points = surface_points(shape, rng, 400)
    for q in rng.uniform(-1.5, 1.5, (100, 3)):
        depth, normal = measure(shape, q)
        assert np.linalg.norm(points - q, axis=1).min() >= abs(depth) - 1e-9
        if depth > 0:  # the whole object lies behind the plane through the nearest point
            assert ((points - q) @ normal).max() <= -depth + 1e-9


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Sphere(0.0), "radius"),
        (lambda: Sphere(float("nan")), "radius"),
        (lambda: Box((1.0, -1.0, 1.0)), r"half_extents\[1\]"),
        (lambda: Capsule(0.1, float("inf")), "half_length"),
        (lambda: Cylinder(-1.0, 1.0), "radius"),
    ],
)
def test_sizes_that_make_no_sense_are_refused_by_name(make: object, field: str) -> None:
    with pytest.raises(ValueError, match=field):
        make()  # type: ignore[operator]
