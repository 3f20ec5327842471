"""Corners, grooves, plates, needles and rims in random poses, from 1 mm to 10 m, at up to 10 m/s."""

from collections.abc import Callable

import numpy as np
import pytest
from campaign import seeds
from probing import Floats, Probe, box_mesh, grid, mesh, needle, quads, random_pose, winding

from itouch.contact import Box, Mesh, Shape, Surface
from itouch_evidence.contact.contact_workload import icosphere

CORNER = quads(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]],
    [[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]],
)


def groove(angle: float) -> tuple[Floats, Floats]:
    """Two planes that rise by an angle on both sides of the y axis."""
    c, s = np.cos(angle), np.sin(angle)
    return quads([[0, -1, 0], [c, -1, s], [c, 1, s], [0, 1, 0]], [[0, 1, 0], [-c, 1, s], [-c, -1, s], [0, -1, 0]])


def random_size(rng: np.random.Generator) -> float:
    return float(10 ** rng.uniform(-3, 1))


@pytest.mark.parametrize("seed", seeds(6, 40))
def test_in_the_corner_of_three_planes_the_probe_touches_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, steps = random_size(rng), int(rng.choice([1, 5, 100]))
    radius = float(rng.choice([0.0, 0.003, 0.05, 0.2]))
    shape = mesh(*CORNER, size, two_sided=bool(rng.integers(2)))
    probe = Probe(shape, radius=radius * size, pose=random_pose(rng, size))
    for share in np.linspace(0, 1, steps + 1):
        probe((0.6 - share * (0.6 + rng.uniform(0.05, 0.3, 3) * (share == 1))) * size)
    for _ in range(3):
        place = probe(-np.array([0.05, 0.1, 0.2]) * size)
    np.testing.assert_allclose(place / size, radius, atol=2e-7)
    assert probe.contacts == 3
    np.testing.assert_allclose(probe.force, place - [-0.05 * size, -0.1 * size, -0.2 * size], atol=1e-12)


@pytest.mark.parametrize("seed", seeds(6, 40))
def test_along_a_groove_the_probe_neither_sticks_nor_trembles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, angle = random_size(rng), rng.uniform(0.05, 1.4)
    radius, pace = float(rng.choice([0.0, 0.003, 0.05])), float(rng.choice([1e-4, 1e-3, 0.05]))
    surface = Surface(groove(angle)[0] * size, groove(angle)[1], bool(rng.integers(2)))
    probe = Probe(Mesh(surface), radius=radius * size, pose=random_pose(rng, size))
    probe([0.0, -0.9 * size, 0.3 * size])
    probe([0.0, -0.9 * size, 0.0])
    away = max(radius, surface.skin / size)
    for step in range(150):
        hip = np.array([rng.uniform(-0.02, 0.02), -0.9 + (step * pace) % 1.8, -0.02])
        place = probe(hip * size) / size
        np.testing.assert_allclose(place, in_groove(hip, angle, away), atol=1e-7)


def in_groove(hip: Floats, angle: float, away: float) -> Floats:
    """Nearest place to the HIP at this distance from both planes of a groove."""
    best = np.array([0.0, hip[1], away / np.cos(angle)])
    normals = np.array([[-np.sin(angle), 0, np.cos(angle)], [np.sin(angle), 0, np.cos(angle)]])
    for one, other in (normals, normals[::-1]):
        place = hip + (away - one @ hip) * one
        if other @ place >= away and np.linalg.norm(place - hip) < np.linalg.norm(best - hip):
            best = place
    return best


def plates(rng: np.random.Generator, side: float, thickness: float) -> list[tuple[Shape, float]]:
    half, cells = thickness / 2, int(rng.integers(1, 30))
    return [
        (Box((side, side, half)), half),
        (mesh(*box_mesh(side, side, half), 1.0), half),
        (mesh(*grid(cells, 2 * side), 1.0, two_sided=True), 0.0),
        (mesh(*grid(cells, 2 * side), 1.0), 0.0),
    ]


@pytest.mark.parametrize("kind", range(4))
@pytest.mark.parametrize("seed", seeds(4, 15))
def test_nothing_goes_through_a_plate_of_one_millimetre(seed: int, kind: int) -> None:
    rng = np.random.default_rng(seed)
    size = float(10 ** rng.uniform(-2, 1))
    shape, half = plates(rng, 0.2 * size, min(0.001, 0.01 * size))[kind]
    friction = float(rng.choice([0.0, 0.5]))
    radius = min(float(rng.choice([0.0, 0.0005, 0.005])), 0.05 * size)
    probe = Probe(shape, radius=radius, friction=(friction, 0.6 * friction), pose=random_pose(rng, size))
    side = 1.0 if kind == 3 else float(rng.choice([-1.0, 1.0]))
    hip = np.array([0, 0, side * (0.02 * size + radius)])
    probe(hip)
    for _ in range(150):
        jump = rng.normal(size=3)
        hip = hip + jump / np.linalg.norm(jump) * rng.random() * min(0.01, 0.05 * size)
        hip = np.clip(hip, np.array([-0.1, -0.1, -0.03]) * size, np.array([0.1, 0.1, 0.03]) * size)
        assert side * probe(hip)[2] >= half + radius - 1e-7 * size


def blob(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Sphere with dents and bumps."""
    vertices, faces = icosphere(3, 1.0)
    x, y, z = (5 * vertices + rng.uniform(0, 6, 3)).T
    return vertices * (1 + 0.3 * np.sin(x) * np.sin(y) * np.cos(z))[:, None], faces


def star(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Sphere whose vertices are drawn in at random: spikes and pits."""
    vertices, faces = icosphere(2, 1.0)
    return vertices * rng.uniform(0.3, 1.0, len(vertices))[:, None], faces


SOLIDS: dict[str, Callable[[np.random.Generator], tuple[Floats, Floats]]] = {
    "needle": lambda rng: needle(),
    "cube": lambda rng: box_mesh(0.5, 0.5, 0.5),
    "blob": blob,
    "star": star,
}


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("seed", range(8))
def test_a_probe_stays_out_of_a_solid_and_as_near_as_it_can(seed: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    size, friction = random_size(rng), float(rng.choice([0.0, 0.5]))
    vertices, faces = SOLIDS[name](rng)
    surface = Surface(vertices * size, faces)
    assert surface.is_solid
    radius, pace = float(rng.choice([0.0, 0.001, 0.01, 0.1])) * size, float(rng.choice([0.001, 0.02, 0.2]))
    probe = Probe(Mesh(surface), radius=radius, friction=(friction, 0.6 * friction), pose=random_pose(rng, size))
    middle, away = vertices.mean(axis=0), max(radius, surface.skin)
    hip, velocity = middle + [1.5, 0, 0] + rng.normal(size=3) * 0.1, np.zeros(3)
    for _ in range(120):
        velocity = 0.9 * velocity + 0.3 * pace * (middle - hip + rng.normal(size=3))
        velocity *= min(1.0, pace / np.linalg.norm(velocity))
        hip = hip + velocity
        place = probe(hip * size)
        assert winding(surface, place) < 0.5
        assert (
            surface.closest(place)[1]
            >= away * (1 - 1e-5) - 1e-8 * surface.skin - (probe.contacts > 0) * 0.02 * surface.skin
        )
        assert probe.in_cone(friction)
        beside = place + rng.normal(size=3) * 1e-3 * size
        if friction == 0 and surface.closest(beside)[1] >= away and winding(surface, beside) < 0.5:
            assert np.linalg.norm(beside - hip * size) > np.linalg.norm(place - hip * size) - 1e-4 * size


@pytest.mark.parametrize("seed", seeds(5, 20))
def test_a_probe_rolls_over_the_rim_of_an_open_surface(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, y = random_size(rng), rng.uniform(-0.4, 0.4)
    radius = float(rng.choice([0.002, 0.02, 0.1])) * size
    shape = mesh(*grid(int(rng.integers(1, 20))), size, two_sided=bool(rng.integers(2)))
    probe = Probe(shape, radius=radius, pose=random_pose(rng, size))
    probe([0.5 * size, y * size, 2 * radius])
    for angle in np.pi / 2 - np.linspace(0, 0.98 * np.pi, 150):  # from above the rim to below it
        way = np.array([np.cos(angle), 0, np.sin(angle)])
        place = probe([0.5 * size, y * size, 0.0] + 0.7 * radius * way)
        np.testing.assert_allclose(place, [0.5 * size, y * size, 0.0] + radius * way, atol=1e-4 * radius)


@pytest.mark.parametrize("seed", seeds(5, 20))
def test_what_comes_from_behind_is_let_through_and_held_from_the_front(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, steps = random_size(rng), int(rng.choice([5, 50, 300]))
    vertices, faces = grid(int(rng.integers(1, 20)))
    vertices[:, 2] = 0.05 * np.sin(4 * vertices[:, 0]) * np.cos(5 * vertices[:, 1])
    surface = Surface(vertices * size, faces)
    radius = float(rng.choice([0.0, 0.002, 0.02, 0.1])) * size
    probe = Probe(Mesh(surface), radius=radius, pose=random_pose(rng, size))
    x, y = rng.uniform(-0.3, 0.3, 2) * size
    for z in np.linspace(-0.4, 0.4, steps + 1):
        probe([x, y, z * size])
        assert np.linalg.norm(probe.force) <= 2e-5 * size
    for z in np.linspace(0.4, -0.4, steps + 1):
        place = probe([x, y, z * size])
    assert place[2] > surface.closest(place)[0][2]


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_a_probe_behind_a_surface_that_touches_the_front_of_its_wall_is_not_thrown_out(
    seed: int, friction: float
) -> None:
    """A sheet is touched from below only, and a wall hangs from its edge: a probe in the sheet came to lie upon it."""
    rng = np.random.default_rng(seed)
    size, high = random_size(rng), 0.13
    corners = [[-1, 0, 0], [1, 0, 0], [1, 1, 0], [-1, 1, 0], [-1, 0, -0.5], [1, 0, -0.5]]
    shape = mesh(np.array(corners, float), np.array([[0, 2, 1], [0, 3, 2], [0, 1, 5], [0, 5, 4]], np.int32), size)
    probe = Probe(shape, radius=0.4 * size, friction=(friction, friction), pose=random_pose(rng, size))
    last = None
    for y in np.arange(0.7, 0.05, -0.003):
        place = probe([0.01 * size, y * size, high * size]) / size
        assert last is None or np.linalg.norm(place - last) < 0.03
        last = place
    assert probe.contacts == 1


@pytest.mark.parametrize("seed", range(6))
def test_a_closed_surface_with_its_front_inside_is_a_room(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = random_size(rng)
    vertices, faces = icosphere(3)
    surface = Surface(vertices * size, faces[:, ::-1])
    assert not surface.is_solid
    radius = float(rng.choice([0.0, 0.002, 0.02, 0.1])) * size
    probe = Probe(Mesh(surface), radius=radius, friction=(0.5, 0.3), pose=random_pose(rng, size))
    hip, pace = np.zeros(3), np.zeros(3)
    for _ in range(200):
        pace = 0.9 * pace + rng.normal(size=3) * 0.02
        hip = hip + pace
        hip *= min(1.0, 0.7 / np.linalg.norm(hip))
        place = probe(hip * size)
        assert np.linalg.norm(place) < 0.5 * size
        assert surface.closest(place)[1] >= radius * (1 - 1e-5)
