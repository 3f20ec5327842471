"""A sphere moved along a line until it touches."""

import numpy as np
import pytest
from probing import Floats, box_mesh, mesh, random_pose, rotation

from itouch.contact import Box, Capsule, Cylinder, Geometry, Mesh, Plane, Shape, Sphere, Surface
from itouch.contact.cast import BACK, sphere_cast
from itouch_evidence.contact.contact_workload import icosphere

POSES = np.array([[0, 0, -0.1, 1, 0, 0, 0], [0.3, 0, 0.1, 1, 0, 0, 0], [0, 0.3, 0.05, 1, 0, 0, 0]])
DOWN = np.array([0.0, 0.0, -1.0])


def cast(shapes: list[Shape], poses: Floats, start: Floats, way: Floats, radius: float, far: float = 1.0) -> tuple:
    geometry, normal = Geometry.build(shapes), np.zeros(3)
    distance, hit = sphere_cast(
        geometry.world, geometry.mesh, poses, np.asarray(start, float), way, radius, far, normal
    )
    return distance, hit, normal


@pytest.mark.parametrize(
    ("start", "distance", "hit"),
    [
        ((0, 0, 0.2), 0.192, 0),
        ((0, 0, 0.005), -0.003, 0),
        ((0, 0, -0.01), -0.018, 0),
        ((0.3, 0, 0.5), 0.292, 1),
        ((0.3, 0, 0.19), -0.018, 1),
        ((0.405, 0, 0.5), 0.3 - np.sqrt(0.008**2 - 0.005**2), 1),
        ((0.409, 0, 0.5), 0.492, 0),
        ((0, 0.33, 0.5), 0.45 - np.sqrt(0.058**2 - 0.03**2), 2),
        ((0, 0, -0.15), np.inf, -1),
        ((0, 0, -0.3), np.inf, -1),
        ((0.25, 0, 0.05), 0.042, 0),
        ((5, 0, 0.5), np.inf, -1),
    ],
)
@pytest.mark.parametrize("as_mesh", [False, True])
def test_distances_equal_known_ones(start: Floats, distance: float, hit: int, as_mesh: bool) -> None:
    block: Shape = mesh(*box_mesh(0.1, 0.1, 0.1), 1.0) if as_mesh else Box((0.1, 0.1, 0.1))
    found, which, normal = cast([Box((0.5, 0.5, 0.1)), block, Sphere(0.05)], POSES, start, DOWN, 0.008)
    assert (found, which) == (pytest.approx(distance, abs=1e-9), hit)
    assert hit < 0 or normal @ DOWN < 0


@pytest.mark.parametrize("shape", [Plane(), Sphere(0.1), Box((0.1, 0.2, 0.05)), Capsule(0.1, 0.1), Cylinder(0.1, 0.2)])
def test_the_sphere_just_touches_where_it_is_said_to(shape: Shape, rng: np.random.Generator) -> None:
    from test_distance import measure

    hits = 0
    for _ in range(200):
        pose, radius = random_pose(rng, 0.1), rng.uniform(0, 0.02)
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        start = pose[:3] + rng.normal(size=3) * 0.03 - 0.6 * way
        local = rotation(pose[3:]).T @ (start - pose[:3])
        if measure(shape, local)[0] < radius:
            continue
        distance, hit, normal = cast([shape], pose[None], start, way, radius, 2.0)
        places = np.linspace(0, 2.0 if hit < 0 else distance - 1e-6, 200)
        gaps = [measure(shape, local + a * (rotation(pose[3:]).T @ way))[0] - radius for a in places]
        assert min(gaps) >= -1e-9
        if hit >= 0:
            hits += 1
            depth, out = measure(shape, local + distance * (rotation(pose[3:]).T @ way))
            assert depth == pytest.approx(radius, abs=1e-8)
            np.testing.assert_allclose(rotation(pose[3:]) @ out, normal, atol=1e-3)
    assert hits > 40


def test_a_mesh_is_met_where_its_triangles_are(rng: np.random.Generator) -> None:
    surface = Surface(*icosphere(3, 0.2))
    for _ in range(200):
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        start, radius = rng.normal(size=3) * 0.05 - 0.5 * way, float(rng.choice([0.0, 0.01]))
        distance, hit, _ = cast([Mesh(surface)], np.array([[0, 0, 0, 1, 0, 0, 0.0]]), start, way, radius)
        gaps = surface.closest(start + np.linspace(0, 1 if hit < 0 else distance - 1e-6, 100)[:, None] * way)[1]
        assert gaps.min() >= radius - 1e-7
        if hit >= 0:
            assert surface.closest(start + distance * way)[1] == pytest.approx(max(radius, surface.skin), abs=1e-7)


def test_deeper_than_the_bound_does_not_count() -> None:
    for depth in (BACK - 1e-3, BACK + 1e-3):
        distance, hit, _ = cast([Plane()], np.array([[0, 0, 0, 1, 0, 0, 0.0]]), [0, 0, 0.01 - depth], DOWN, 0.01)
        assert (distance, hit) == ((pytest.approx(-depth), 0) if depth < BACK else (np.inf, -1))


def test_the_way_out_of_an_object_does_not_count() -> None:
    poses = np.array([[0, 0, 0, 1, 0, 0, 0], [0, 0, 0.3, 1, 0, 0, 0.0]])
    for block in (Box((0.2, 0.2, 0.05)), mesh(*box_mesh(0.2, 0.2, 0.05), 1.0)):
        distance, hit, _ = cast([block, Box((0.2, 0.2, 0.05))], poses, [0, 0, 0.055], -DOWN, 0.01)
        assert (distance, hit) == (pytest.approx(0.185), 1)
