"""Force shading: facets feel smooth, creases and everything else stay."""

import numpy as np
import pytest
from probing import box_mesh, mesh, random_pose

from itouch.contact import Box, Capsule, Cylinder, Proxy, Shape, Sphere, Surface
from itouch.contact.force_shading import vertex_normals
from itouch_evidence.contact.contact_workload import icosphere


def directions(count: int) -> np.ndarray:
    turn = np.linspace(0, 2, count)
    return np.stack([np.cos(turn) * np.cos(0.3), np.sin(turn) * np.cos(0.3), np.full(count, np.sin(0.3))], axis=1)


@pytest.mark.parametrize("radius", [0.0, 0.02])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_coarse_sphere_feels_round(radius: float, friction: float) -> None:
    surface = Surface(*icosphere(2))
    forces = {}
    for shading in (False, True):
        proxy = Proxy(surface, radius=radius, static_friction=friction, dynamic_friction=friction, shading=shading)
        paths = directions(900) * (0.49 + radius)
        forces[shading] = np.array([proxy.step(hip) for hip in paths])
        push = np.einsum("ni,ni->n", forces[shading], np.array([proxy.normal] * 900))
        assert push.shape == (900,)
    np.testing.assert_allclose(*(np.linalg.norm(f, axis=1) for f in forces.values()), rtol=1e-9)
    if friction == 0.0:
        turn = {}
        for shading, force in forces.items():
            unit = force / np.linalg.norm(force, axis=1, keepdims=True)
            turn[shading] = np.arccos(np.clip(np.einsum("ni,ni->n", unit, directions(900)), -1, 1)).max()
        assert turn[False] > np.radians(5)
        assert turn[True] < np.radians(1)


def test_the_shaded_force_stays_in_the_cone_about_the_shaded_normal() -> None:
    rng = np.random.default_rng(3)
    vertices, faces = icosphere(2)
    vertices = vertices * (1 + 0.2 * np.sin(5 * vertices[:, :1]))
    proxy = Proxy(Surface(vertices, faces), radius=0.01, static_friction=0.4, dynamic_friction=0.3, shading=True)
    hip = np.array([0.0, 0.0, 0.6])
    touched = 0
    for _ in range(600):
        hip = hip + rng.normal(size=3) * 0.004 - 0.3 * (np.linalg.norm(hip) - 0.47) * hip
        force, normal = proxy.step(hip), proxy.normal
        push = force @ normal
        touched += proxy.in_contact
        assert np.linalg.norm(force - push * normal) <= 0.4 * push * (1 + 1e-6) + 1e-9
    assert touched > 200


def test_the_corners_of_a_cube_are_creases() -> None:
    surface = mesh(*box_mesh(0.1, 0.1, 0.1), 1.0).surface
    proxy = Proxy(surface, radius=0.005, shading=True)
    proxy.step([0.02, 0.03, 0.2])
    np.testing.assert_allclose(proxy.step([0.02, 0.03, 0.1])[:2] / 5.0, 0.0, atol=0.71)
    plain = Proxy(surface, radius=0.005)
    plain.step([0.02, 0.03, 0.2])
    np.testing.assert_allclose(plain.step([0.02, 0.03, 0.1]), [0, 0, 5.0], atol=1e-9)


def test_vertex_normals_of_a_sphere_are_radial_even_for_triangles_that_share_no_vertices() -> None:
    vertices, faces = icosphere(3)
    soup = vertices[faces].reshape(-1, 3)
    normals = vertex_normals(soup, np.arange(len(soup)).reshape(-1, 3))
    assert np.degrees(np.arccos(np.einsum("ni,ni->n", normals, soup / 0.5).min())) < 0.5


def test_shading_turns_with_the_object() -> None:
    from probing import rotation

    from itouch.contact import Friction, Geometry, Mesh
    from itouch.contact import layout as at
    from itouch.contact.step import step

    rng = np.random.default_rng(1)
    geometry = Geometry.build([Mesh(Surface(*icosphere(1)))], [Friction(shading=True)])
    found = []
    for pose in (np.array([0, 0, 0, 1.0, 0, 0, 0]), random_pose(rng, 1.0)):
        memory, result = geometry.new_memory(), geometry.new_result()
        turn, place = rotation(pose[3:]), pose[:3]
        for far in (0.6, 0.5):
            hip = turn @ (far * directions(3)[1]) + place
            step(
                geometry.world,
                geometry.mesh,
                pose[None].copy(),
                np.zeros((1, 6)),
                np.ones(1),
                hip,
                0.02,
                0.0,
                memory,
                result,
            )
        found.append(turn.T @ result[at.RESULT_NORMAL : at.RESULT_NORMAL + 3])
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


@pytest.mark.parametrize(
    "shape",
    [Box((0.02, 0.03, 0.01)), Sphere(0.02), Capsule(0.01, 0.02), Cylinder(0.02, 0.01)],
    ids=lambda s: type(s).__name__,
)
def test_a_primitive_beside_a_mesh_is_not_shaded(shape: Shape) -> None:
    """It has no vertex normals: the code of its face, edge or vertex is the number of no triangle."""
    far = Surface(icosphere(2)[0] + 5.0, icosphere(2)[1])
    shaded, plain = (Proxy([shape, far], radius=0.005, shading=shading) for shading in (True, False))
    ways = [np.array(way, float) for way in np.ndindex(3, 3, 3) if way != (1, 1, 1)]
    for way in ways:
        start = (way - 1.0) * 0.05
        for proxy in (shaded, plain):
            proxy.reset(start)
        for share in (0.6, 0.3, 0.1):
            np.testing.assert_array_equal(shaded.step(share * start), plain.step(share * start))
            np.testing.assert_array_equal(shaded.normal, plain.normal)
        assert plain.in_contact
