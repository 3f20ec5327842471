"""What lies beside a contact: found along the surface, whatever it is made of and however the scene is turned."""

import numpy as np
import pytest
from probing import random_pose, rotation

from itouch.contact import Box, Friction, Geometry, Mesh, Shape, Surface
from itouch.contact.distance_queries import beside

HALF = (0.03, 0.05, 0.005)
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * HALF
FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
     (1, 5, 7), (1, 7, 3)]
)  # fmt: skip
REACH = 0.008


def look(second: Shape, pose: np.ndarray, away: np.ndarray, point: np.ndarray, primary: int = 0) -> tuple[int, float]:
    """Look beside a point of the top of a block whose neighbour stands so far away, in their common frame."""
    geometry = Geometry.build([Box(HALF), second], [Friction(0.0, 0.0)] * 2)
    turn = rotation(pose[3:])
    poses = np.tile(pose, (2, 1))
    poses[1, :3] += turn @ away
    normal = turn @ np.array([0.0, 0.0, 1.0])
    found, distance = beside(
        geometry.world, geometry.mesh, poses, primary, turn @ point + pose[:3], normal, REACH
    )  # fmt: skip
    return int(found), float(distance)


@pytest.fixture(params=["box", "mesh"])
def second(request: pytest.FixtureRequest) -> Shape:
    """Return the same block in either way; a mesh is made in the test, as making one compiles."""
    return Box(HALF) if request.param == "box" else Mesh(Surface(CORNERS, FACES))


def test_a_neighbour_is_found_as_far_away_as_it_begins(second: Shape, rng: np.random.Generator) -> None:
    for gap in rng.uniform(0.0, 0.012, 30):
        point = np.array([0.03 - gap, rng.uniform(-0.04, 0.04), 0.005])
        found, distance = look(second, random_pose(rng, 0.1), np.array([0.06, 0.0, 0.0]), point)
        assert found == (1 if gap < REACH else -1)
        if found >= 0:
            assert distance == pytest.approx(gap, abs=1e-9)


def test_what_lies_below_is_not_beside_and_nothing_is_beside_itself(second: Shape, rng: np.random.Generator) -> None:
    point = np.array([0.01, 0.02, 0.005])
    for _ in range(10):
        pose = random_pose(rng, 0.1)
        assert look(second, pose, np.array([0.0, 0.0, -0.011]), point)[0] == -1
        assert look(second, pose, np.array([0.2, 0.0, 0.0]), point)[0] == -1
