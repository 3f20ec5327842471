"""The small quadratic programme: the point nearest to a goal inside half-spaces."""

import numpy as np
import pytest

from itouch.contact import layout as at
from itouch.contact.halfspaces import nearest_inside, set_loads
from itouch.contact.kernel_decorators import entry


@entry
def solve(planes, count, x, y, z):
    solution = nearest_inside(planes, count, (x, y, z))
    set_loads(planes, count, (x, y, z), solution)
    return solution


def table(normals: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    planes = np.zeros((at.MAX_PLANES, at.SITE_WIDTH))
    planes[: len(gaps), at.PLANE_NORMAL : at.PLANE_NORMAL + 3] = normals
    planes[: len(gaps), at.PLANE_GAP] = gaps
    return planes


@pytest.mark.parametrize("count", [1, 2, 3, 5, 9, 16])
def test_the_solution_fulfils_the_conditions_of_kuhn_and_tucker(rng: np.random.Generator, count: int) -> None:
    for _ in range(200):
        normals = rng.normal(size=(count, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        gaps = np.abs(rng.normal(size=count)) * rng.choice([0.0, 1.0], size=count)
        goal = rng.normal(size=3) * 10
        planes = table(normals, gaps)
        point, *_, feasible = solve(planes, count, *goal)
        loads = planes[:count, at.PLANE_LOAD]
        room = normals @ point + gaps
        assert feasible
        assert room.min() > -1e-9
        assert loads.min() >= 0.0
        np.testing.assert_allclose(np.array(point) - goal, loads @ normals, atol=1e-8)
        assert np.abs(loads * room).max() < 1e-7


def test_parallel_planes_count_once() -> None:
    planes = table(np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 1e-13, 1.0]]), np.zeros(3))
    point, *_, feasible = solve(planes, 3, 1.0, 2.0, -3.0)
    assert feasible
    np.testing.assert_allclose(point, (1, 2, 0), atol=1e-9)


def test_opposed_planes_without_room_are_reported() -> None:
    planes = table(np.array([[0, 0, 1.0], [0, 0, -1.0]]), np.array([-1.0, -1.0]))
    assert not solve(planes, 2, 0.0, 0.0, 0.0)[4]


def test_a_corner_of_almost_equal_planes_stays_near_the_anchor(rng: np.random.Generator) -> None:
    for angle in 10.0 ** rng.uniform(-8, -2, 100):
        normals = np.array([[0, np.sin(angle), np.cos(angle)], [0, -np.sin(angle), np.cos(angle)]])
        point, *_ = solve(table(normals, np.zeros(2)), 2, 0.0, 1e-3, -1e-2)
        assert (normals @ point).min() > -1e-12
        assert np.linalg.norm(np.array(point) - (0, 1e-3, -1e-2)) <= np.linalg.norm((1e-3, 1e-2)) * (1 + 1e-9)
