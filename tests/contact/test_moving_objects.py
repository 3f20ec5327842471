"""Objects that move: they push, carry and drag, and never jump over the probe."""

import numpy as np
import pytest
from probing import Floats, box_mesh, grid, mesh, random_pose, rotation

from itouch.contact import Box, Cylinder, Friction, Geometry, Plane, Shape, Sphere
from itouch.contact import layout as at
from itouch.contact.object_motion import carry
from itouch.contact.step import step


def turned(axis: Floats, angle: float, place: Floats) -> Floats:
    axis = np.asarray(axis, dtype=float)
    half = angle / 2
    return np.concatenate([place, [np.cos(half)], np.sin(half) * axis / np.linalg.norm(axis)])


class World:
    """Objects with poses of their own."""

    def __init__(self, shapes: list[Shape], radius: float, friction: tuple[float, float] = (0.0, 0.0)) -> None:
        self.geometry = Geometry.build(shapes, [Friction(*friction)] * len(shapes))
        self.memory, self.result, self.radius = self.geometry.new_memory(), self.geometry.new_result(), radius
        self.twists = np.zeros((len(shapes), 6))

    def __call__(self, poses: list[Floats], hip: Floats) -> Floats:
        n = len(poses)
        step(self.geometry.world, self.geometry.mesh, np.array(poses), self.twists, np.ones(n), np.asarray(hip, float),
             self.radius, 0.0, self.memory, self.result)  # fmt: skip
        return self.result[at.RESULT_PROXY : at.RESULT_PROXY + 3].copy()


@pytest.fixture(params=["box", "mesh", "sheet"])
def plate(request: pytest.FixtureRequest) -> Shape:
    """Return a thin plate of either kind; a mesh is made in the test, as making one compiles."""
    if request.param == "box":
        return Box((0.1, 0.1, 0.0005))
    return mesh(*box_mesh(0.1, 0.1, 0.0005), 1.0) if request.param == "mesh" else mesh(*grid(9, 0.2), 1.0, True)


@pytest.mark.parametrize("radius", [0.0, 0.002])
def test_a_plate_that_comes_in_jumps_takes_the_probe_along(plate: Shape, radius: float) -> None:
    world = World([plate], radius)
    for k in range(40):
        height = 0.1 - 0.005 * k
        place = world([turned([1, 0, 0], 0.2 * np.sin(k / 5), np.array([0, 0, height]))], np.zeros(3))
        frame = rotation(turned([1, 0, 0], 0.2 * np.sin(k / 5), np.zeros(3))[3:])
        local = frame.T @ (place - [0, 0, height])
        assert local[2] <= -radius + 1e-9 or abs(local[1]) > 0.1


@pytest.mark.parametrize("kind", ["cylinder", "mesh"])
def test_a_turntable_drags_the_finger_until_it_slides(kind: str) -> None:
    table: Shape = Cylinder(0.1, 0.01) if kind == "cylinder" else mesh(*grid(9, 0.2), 1.0)
    world = World([table], 0.002, friction=(0.5, 0.4))
    world.twists[0, 5] = 2.0
    top = 0.01 if isinstance(table, Cylinder) else 0.0
    for k in range(400):
        pose = turned([0, 0, 1], 2.0 * k * 1e-3, np.zeros(3))
        world([pose], np.array([0.05, 0, top + 0.001]))
        if k == 2:  # sticks: the proxy has gone with the table
            assert world.result[at.RESULT_SLIP] == at.SLIP_STICK
            np.testing.assert_allclose(world.result[at.RESULT_PROXY + 1], 0.05 * 2.0 * 2e-3, rtol=1e-3)
    assert world.result[at.RESULT_SLIP] == at.SLIP_SLIDE
    np.testing.assert_allclose(world.result[:3], [0, 0.4e-3, 1e-3], atol=5e-6)
    np.testing.assert_allclose(world.result[at.RESULT_SURFACE_VELOCITY :][:3], [0, 0.1, 0], atol=1e-3)


def test_a_finger_between_a_table_and_what_comes_down_slips_out_or_stays_on_the_table() -> None:
    world = World([Sphere(0.1), Plane()], 0.005)
    ground = np.array([0, 0, 0, 1, 0, 0, 0.0])
    for height in np.linspace(0.2, 0.11, 60):
        place = world([np.array([0, 0, height, 1, 0, 0, 0]), ground], np.array([0.001, 0, 0.006]))
        assert place[2] >= 0.005 - 1e-9
        assert np.linalg.norm(place - [0, 0, height]) >= 0.105 - 1e-9


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["box", "mesh"])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_only_the_motion_between_probe_and_object_counts(seed: int, kind: str, friction: float) -> None:
    rng = np.random.default_rng(seed)
    shape: Shape = Box((0.1, 0.15, 0.2)) if kind == "box" else mesh(*box_mesh(0.1, 0.15, 0.2), 1.0)
    still, moving = (World([shape], 0.02, friction=(friction, 0.6 * friction)) for _ in range(2))
    hip, pace = np.array([0.0, 0, 0.23]), np.zeros(3)
    start, spin, drift = random_pose(rng, 0.2), rng.normal(size=3), rng.normal(size=3) * 2e-3
    for k in range(150):
        pace = 0.95 * pace + rng.normal(size=3) * 2e-3
        # With friction it matters where the finger lands, and that is where the object has gone when the finger comes.
        wide, high = (0.05, 0.215) if friction else (0.3, 0.3)
        hip = np.clip(hip + pace, [-wide, -wide, 0.18], [wide, wide, high])
        pose = np.concatenate([start[:3] + k * drift, turned(spin, 0.004 * k, np.zeros(3))[3:]])
        matrix = rotation(pose[3:])
        one = still([np.array([0, 0, 0, 1, 0, 0, 0.0])], hip)
        other = matrix.T @ (moving([pose], matrix @ hip + pose[:3]) - pose[:3])
        np.testing.assert_allclose(other, one, atol=1e-6)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, -0.48, 0.64)])
def test_an_object_on_a_device_has_the_speed_and_the_rate_of_turn_of_what_carries_it(
    axis: tuple[float, float, float],
) -> None:
    rate, speed, period = 2.0, np.array([0.1, -0.2, 0.3]), 1e-3
    still = np.array([0, 0, 0, 1, 0, 0, 0.0])
    poses, twists = np.zeros((1, 7)), np.zeros((1, 6))
    for k in range(2):
        reading = turned(np.array(axis), 1.0 + k * period * rate, k * period * speed)
        carry(0, still, reading, still, period, 1.0, k == 0, poses, twists)
    np.testing.assert_allclose(poses[0], reading, atol=1e-12)
    np.testing.assert_allclose(twists[0], [*speed, *(rate * np.array(axis))], rtol=1e-6)
