"""Stick, slide and let go."""

import numpy as np
import pytest
from probing import Probe, box_mesh, grid, mesh, random_pose

from itouch.contact import Box, Plane, Shape
from itouch.contact import layout as at


@pytest.fixture(params=["plane", "mesh"])
def ground(request: pytest.FixtureRequest) -> Shape:
    """Return a wide ground of either kind; a mesh is made in the test, as making one compiles."""
    return Plane() if request.param == "plane" else mesh(*grid(30, 2.0), 1.0, two_sided=True)


def test_what_a_contact_does_along_the_surface_is_one_of_three() -> None:
    assert len({at.SLIP_NONE, at.SLIP_STICK, at.SLIP_SLIDE}) == 3


@pytest.mark.parametrize("radius", [0.0, 0.03])
def test_it_sticks_up_to_the_static_cone_and_then_slides_at_the_dynamic_one(ground: Shape, radius: float) -> None:
    rng = np.random.default_rng(3)
    probe = Probe(ground, radius=radius, friction=(0.5, 0.3), pose=random_pose(rng, 1.0))
    depth = 0.01
    start = probe([0.003, 0.005, radius + 0.02])[:2]
    probe([*start, radius - depth])
    for pull in np.linspace(0, 0.0049, 20):
        proxy = probe([start[0] + pull, start[1], radius - depth])
        np.testing.assert_allclose(proxy[:2], start, atol=1e-9)
        assert probe.slip == at.SLIP_STICK
    for pull in np.linspace(0.0052, 0.2, 60):
        proxy = probe([start[0] + pull, start[1], radius - depth])
        assert probe.slip == at.SLIP_SLIDE
        assert start[0] + pull - proxy[0] == pytest.approx(0.3 * depth, rel=2e-3)
        assert probe.in_cone(0.5)
    held = probe([start[0] + 0.199, start[1], radius - depth])
    assert probe.slip == at.SLIP_STICK
    np.testing.assert_array_equal(probe([start[0] + 0.198, start[1], radius - depth]), held)


def test_where_a_finger_lands_there_it_sticks() -> None:
    probe = Probe(Plane(), radius=0.01, friction=(0.5, 0.3))
    probe([0.0, 0.0, 0.02])
    np.testing.assert_allclose(probe([0.002, 0.0, 0.006]), [0.002 * 10 / 14, 0, 0.01], atol=1e-12)


@pytest.mark.parametrize("kind", ["box", "mesh"])
def test_a_free_hip_beside_the_object_feels_nothing(kind: str) -> None:
    shape: Shape = Box((0.1, 0.1, 0.1)) if kind == "box" else mesh(*box_mesh(0.1, 0.1, 0.1), 1.0)
    probe = Probe(shape, radius=0.02, friction=(2.0, 2.0), stiffness=1000.0)
    probe([0.09, 0, 0.2])
    probe([0.09, 0, 0.11])
    assert probe.contacts > 0
    for x in np.linspace(0.09, 0.125, 40):
        probe([x, 0, 0.11])
    assert probe.contacts == 0
    assert not probe.force.any()


@pytest.mark.parametrize("radius", [0.0, 0.002, 0.008])
@pytest.mark.parametrize("depth", [0.001, 0.012, 0.035])
@pytest.mark.parametrize("speed", [2e-4, 1e-3])
def test_a_mesh_of_a_box_lets_go_where_the_box_does(radius: float, depth: float, speed: float) -> None:
    half = np.array((0.03, 0.025, 0.02))
    above = half[2] + radius
    down = np.append(np.arange(above + 0.002, above - depth, -speed), above - depth)
    aside = np.arange(speed, 0.08, speed)
    hips = np.full((len(down) + len(aside), 3), (0.00413, 0.00307, down[-1]))
    hips[: len(down), 2] = down
    hips[len(down) :, :2] += np.outer(aside, (0.9, 0.4))
    held = []
    for shape in (Box((0.03, 0.025, 0.02)), mesh(*box_mesh(*half), 1.0)):
        probe = Probe(shape, radius=radius, friction=(0.8, 0.8), stiffness=1000.0)
        forces = [(probe(hip), probe.force)[1].copy() for hip in hips]
        held.append(np.linalg.norm(forces, axis=1) > 1e-3)  # a mesh holds a point off by its skin
    outside = np.linalg.norm(np.maximum(np.abs(hips) - half, 0.0), axis=1) > radius + 1e-6
    assert held[0].any()
    np.testing.assert_array_equal(held[1], held[0])
    assert not held[1][outside & (np.abs(hips[:, 2]) < half[2])].any()


@pytest.mark.parametrize("radius", [0.0, 0.004])
def test_a_finger_beside_a_sheet_that_it_was_pressed_through_feels_nothing(radius: float) -> None:
    probe = Probe(mesh(*grid(4, 0.04), 1.0, two_sided=True), radius=radius, friction=(2.0, 2.0), stiffness=1000.0)
    probe([0.0, 0.0, 0.02])
    probe([0.0, 0.0, -0.03])
    for x in np.linspace(0.0, 0.03, 31):
        probe([x, 0.0, -0.03])
    assert not probe.force.any()


@pytest.mark.parametrize("seed", range(6))
def test_the_force_is_always_in_the_cone_on_a_rough_mesh(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, faces = grid(12)
    vertices[:, 2] = rng.normal(size=len(vertices)) * 0.03
    friction = rng.uniform(0.1, 1.5)
    probe = Probe(
        mesh(vertices, faces, 1.0), radius=float(rng.choice([0.0, 0.01, 0.05])), friction=(friction, friction / 2)
    )
    hip, pace = np.array([0.0, 0.0, 0.2]), np.zeros(3)
    for _ in range(300):
        pace = 0.95 * pace + rng.normal(size=3) * 0.004
        hip = np.clip(hip + pace, [-0.4, -0.4, -0.1], [0.4, 0.4, 0.1])
        probe(hip)
        assert probe.in_cone(friction)


def test_the_mean_of_two_frictions_by_their_shares() -> None:
    wall = Box((0.1, 1.0, 1.0))
    probe = Probe([Plane(), wall], radius=0.01, friction=(0.4, 0.4))
    probe.poses[1, 0] = 0.1
    probe([-0.05, 0, 0.05])
    probe([-0.006, 0.0, 0.006])
    probe([-0.006, 0.0, 0.006])
    depth = np.hypot(0.004, 0.004)
    for y in np.linspace(0, 0.05, 40):
        proxy = probe([-0.006, y, 0.006])
    assert y - proxy[1] == pytest.approx(0.4 * depth, rel=2e-3)
