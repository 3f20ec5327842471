"""What lies beside a contact: found along the surface, whatever it is made of and however the scene is turned."""

import numpy as np
import pytest
from probing import random_pose, rotation

from itouch.contact import Box, Friction, Geometry, Mesh, Shape, Surface
from itouch.contact.distance_queries import BRIDGED, beside

HALF = (0.03, 0.05, 0.005)
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * HALF
FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
     (1, 5, 7), (1, 7, 3)]
)  # fmt: skip
REACH = 0.008


def look(
    second: Shape, pose: np.ndarray, away: np.ndarray, point: np.ndarray, primary: int = 0, lean: float = 0.0,
    first: Shape | None = None,
) -> tuple[int, float]:  # fmt: skip
    """Look beside a point of the top of a block whose neighbour stands so far away, in their common frame.

    ``lean``: angle of the normal there towards x [rad].
    """
    geometry = Geometry.build([first or Box(HALF), second], [Friction(0.0, 0.0)] * 2)
    turn = rotation(pose[3:])
    poses = np.tile(pose, (2, 1))
    poses[1, :3] += turn @ away
    normal = turn @ np.array([np.sin(lean), 0.0, np.cos(lean)])
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


@pytest.mark.parametrize("mesh", [False, True])
def test_a_neighbour_counts_as_farther_away_the_lower_it_is(
    second: Shape, mesh: bool, rng: np.random.Generator
) -> None:
    """A pad bridges a step up to its indentation: at nothing it is level, at that nothing is touched any more."""
    first = Mesh(Surface(CORNERS, FACES)) if mesh else None
    for drop in (0.0, 1e-6, 1e-5, 2e-5, 1e-4, *rng.uniform(0.0, 1.5e-3, 20)):
        gap = rng.uniform(2e-5, REACH)
        point = np.array([0.03 - gap, rng.uniform(-0.04, 0.04), 0.005])
        found, distance = look(second, random_pose(rng, 0.1), np.array([0.06, 0.0, -drop]), point, first=first)
        expected = gap + REACH * drop / BRIDGED
        assert found == (1 if expected < REACH else -1), (drop, gap)
        if found >= 0:
            assert distance == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("drop", [1e-5, 5e-5, 3e-4, 9e-4, 2e-3])
def test_a_ball_that_rolls_over_a_rim_goes_over_to_the_lower_neighbour_without_a_jump(
    second: Shape, drop: float, rng: np.random.Generator
) -> None:
    pose, step = random_pose(rng, 0.1), np.array([0.06, 0.0, -drop])
    last = np.arccos(1.0 - drop / REACH)  # here the ball touches both

    def over(lean: float) -> float:
        found, distance = look(second, pose, step, np.array([0.03, 0.01, 0.005]), lean=float(lean))
        return distance if found >= 0 else REACH

    ways = np.array([over(lean) for lean in np.linspace(1e-6, last - 1e-6, 400)])
    before, after = min(REACH, REACH * drop / BRIDGED), np.sqrt(2.0 * REACH * drop - drop**2)
    assert ways[0] == pytest.approx(before, abs=1e-4)
    assert np.abs(np.diff(ways)).max() < 0.02 * (before + after) + 5e-5
    # seen from the lower one, the other is as far away as the lower one has come under the ball
    found, distance = look(second, pose, -step, np.array([0.03 - after, 0.01, 0.005]) * (-1.0, 1.0, 1.0))
    assert ways[-1] == pytest.approx(-after, abs=5e-5)
    assert found == 1
    assert distance == pytest.approx(after, abs=1e-8)


def test_what_a_thin_plate_lies_on_begins_at_the_rim_of_the_plate(second: Shape, rng: np.random.Generator) -> None:
    """Under the plate it is not touched; beyond its rim it is, as far away as that and lower by the thickness."""
    plate, thick = Box((0.02, 0.02, 1e-4)), 2e-4
    for gap in (0.012, *rng.uniform(0.0, 0.0055, 10)):
        point = np.array([0.02 - gap, 0.0, 1e-4])
        found, distance = look(second, random_pose(rng, 0.1), np.array([0.005, 0.0, -0.0051]), point, first=plate)
        expected = gap + REACH * thick / BRIDGED
        assert found == (1 if gap < 0.01 else -1)
        if found >= 0:  # the rim is looked for in eight directions
            assert expected - 1e-6 < distance < expected + 0.1 * gap + 1e-6
