"""A surface as an object: what it takes, what it refuses, and the nearest point."""

import numpy as np
import pytest
from probing import Floats, box_mesh, grid, needle
from test_bvh import MESHES

from itouch.contact import Surface
from itouch.contact.triangle import nearest_on_triangle
from itouch_evidence.contact.contact_workload import icosphere


def brute_force(vertices: Floats, faces: Floats, p: Floats) -> float:
    corners = np.asarray(vertices, dtype=float)[np.asarray(faces)]
    return min(float(np.linalg.norm(p - nearest_on_triangle(tuple(p), *map(tuple, abc)))) for abc in corners)


@pytest.mark.parametrize("name", MESHES)
def test_the_nearest_point_is_that_of_all_triangles(name: str, rng: np.random.Generator) -> None:
    vertices, faces = MESHES[name]
    surface = Surface(vertices, faces)
    middle, size = np.mean(vertices, axis=0), np.ptp(vertices, axis=0).max() + 1e-3
    points = middle + rng.normal(size=(20, 3)) * size * 10.0 ** rng.uniform(-2, 1, (20, 1))
    found, distances, faces_found = surface.closest(points)
    for p, q, distance, face in zip(points, found, distances, faces_found, strict=True):
        assert distance == pytest.approx(brute_force(vertices, faces, p), abs=1e-9 * size)
        assert np.linalg.norm(p - q) == pytest.approx(distance, abs=1e-9 * size)
        abc = np.asarray(vertices, dtype=float)[np.asarray(faces)[face]]
        np.testing.assert_allclose(nearest_on_triangle(tuple(p), *map(tuple, abc)), q, atol=1e-9 * size)


def test_the_nearest_point_of_one_triangle_by_sampling(rng: np.random.Generator) -> None:
    for _ in range(100):
        a, b, c, p = rng.normal(size=(4, 3))
        weights = rng.dirichlet([1, 1, 1], 3000)
        sampled = np.linalg.norm(weights @ np.array([a, b, c]) - p, axis=1).min()
        exact = np.linalg.norm(p - nearest_on_triangle(tuple(p), tuple(a), tuple(b), tuple(c)))
        assert exact <= sampled + 1e-12
        assert sampled - exact < 0.1


def test_one_point_and_many_points() -> None:
    surface = Surface(*grid(3))
    point, distance, face = surface.closest([0.1, 0.2, -0.5])
    np.testing.assert_allclose(point, [0.1, 0.2, 0])
    assert (float(distance), point.shape) == (0.5, (3,))
    assert 0 <= int(face) < 18
    points, distances, faces = surface.closest(np.zeros((4, 3)))
    assert (points.shape, distances.shape, faces.shape) == ((4, 3), (4,), (4,))
    assert surface.closest(np.zeros((0, 3)))[0].shape == (0, 3)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.eye(3), np.zeros((0, 3), int), "faces is empty"),
        (np.eye(3)[:, :2], [[0, 1, 2]], r"vertices has shape \(3, 2\)"),
        (np.eye(3), [[0, 1]], r"faces has shape \(1, 2\)"),
        (np.eye(3), [[0, 1, 3]], "vertex 3; there are vertices 0 to 2"),
        (np.eye(3), [[0, -1, 2]], "vertex -1"),
        (np.eye(3), [[0.0, 1.0, 2.0]], "whole numbers"),
        (np.array([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]]), [[0, 1, 2]], r"vertices\[2\] is not finite"),
        (np.array([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]]), [[0, 1, 2]], r"vertices\[2\] is not finite"),
    ],
)
def test_what_is_no_surface_is_refused(vertices: Floats, faces: Floats, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Surface(vertices, faces)


def test_points_of_the_wrong_shape_are_refused() -> None:
    with pytest.raises(ValueError, match=r"points has shape \(2,\)"):
        Surface(*grid(2)).closest([1.0, 2.0])


@pytest.mark.parametrize(
    ("name", "solid"), [("box", True), ("needle", True), ("sphere", True), ("grid", False), ("soup", False)]
)
def test_a_closed_surface_with_its_front_outside_is_a_solid(name: str, solid: bool) -> None:
    vertices, faces = (np.asarray(array) for array in MESHES[name])
    assert Surface(vertices, faces).is_solid == solid
    assert not Surface(vertices, faces[:, ::-1]).is_solid
    assert not Surface(vertices, faces, two_sided=True).is_solid
    assert not Surface(vertices, faces[1:]).is_solid or len(faces) == 1
    apart = vertices[faces].reshape(-1, 3)  # each triangle with vertices of its own
    assert Surface(apart, np.arange(len(apart)).reshape(-1, 3)).is_solid == solid


def test_one_triangle_turned_over_is_no_solid() -> None:
    vertices, faces = icosphere(2)
    turned = faces.copy()
    turned[7] = turned[7, ::-1]
    assert not Surface(vertices, turned).is_solid


def test_a_surface_does_not_change_and_does_not_keep_what_it_was_made_of() -> None:
    vertices, faces = box_mesh(1, 1, 1)
    surface = Surface(vertices, faces)
    before = surface.closest([2.0, 0.1, 0.2])[1]
    vertices *= 7
    assert surface.closest([2.0, 0.1, 0.2])[1] == before
    with pytest.raises(ValueError, match="read-only"):
        surface.tables[0][0, 0] = 1.0
    assert surface.memory_bytes == sum(table.nbytes for table in surface.tables)


def test_a_big_surface_takes_little_memory() -> None:
    vertices, faces = icosphere(6)
    assert Surface(vertices, faces).memory_bytes < 110 * len(faces)
    assert needle()[0].shape == (14, 3)
