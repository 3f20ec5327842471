"""Rigid bodies: gravity, pushes, torques, friction, restores to the bit, and what cannot be one."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from itouch.contact import Box, Capsule, Cylinder, Mesh, Plane, Shape, Sphere, Surface
from itouch.contact import layout as at
from itouch.dynamics import Bodies, Body, BodyError, bodies, build_bodies
from itouch.dynamics.bodies import FREE, MOVED, STILL
from itouch.dynamics.mujoco_link import push_bodies
from itouch_evidence.contact.contact_workload import icosphere

T, G = 1e-3, (0.0, 0.0, -9.81)
UP = (1.0, 0.0, 0.0, 0.0)


class World:
    """Bodies with all that changes."""

    def __init__(self, *bodies: Body, gravity: tuple[float, float, float] = G) -> None:
        self.bodies: Bodies = build_bodies(bodies, gravity, T)
        self.physics = self.bodies.make()
        self.state = np.zeros(self.bodies.state_size)
        self.physics.start(self.state)
        self.poses = np.array([body.pose for body in bodies], float)
        self.twists, self.forces = np.zeros((len(bodies), 6)), np.zeros((len(bodies), 6))

    def run(self, steps: int) -> World:
        for _ in range(steps):
            self.physics.step(self.state, self.forces, self.poses, self.twists)
        return self


def free(shape: Shape, place: tuple[float, float, float] = (0.0, 0.0, 1.0), **more: object) -> Body:
    return Body(shape, (*place, *UP), FREE, **{"mass": 0.2, **more})  # type: ignore[arg-type]


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.0), (0.2, 0.0, -0.3)])
def test_a_body_that_attracts_the_finger_is_pulled_by_the_same_force(force: tuple[float, float, float]) -> None:
    result, forces = np.zeros(at.RESULT_SIZE), np.zeros((2, 6))
    poses = np.array([(0.0, 0.0, 0.0, *UP), (0.1, 0.0, 0.0, *UP)])
    result[at.RESULT_NEAREST] = 1
    result[at.RESULT_NEAREST_POINT : at.RESULT_NEAREST_POINT + 3] = 0.11, 0.0, 0.02
    push_bodies(np.array(force), result, poses, forces)
    assert forces[0].tolist() == [0.0] * 6
    assert forces[1] == pytest.approx([-f for f in force] + list(np.cross((0.01, 0.0, 0.02), np.negative(force))))


def test_a_free_body_falls() -> None:
    world = World(free(Sphere(0.01))).run(100)
    assert world.poses[0, 2] == pytest.approx(1 - 9.81 * 0.1**2 / 2, abs=6e-4)
    assert world.twists[0, 2] == pytest.approx(-0.981, rel=1e-9)


def test_a_push_beside_the_middle_turns_it_by_its_inertia() -> None:
    world = World(free(Box((0.1, 0.1, 0.1)), inertia=(1e-3, 2e-3, 3e-3)), gravity=(0, 0, 0))
    world.forces[0] = (0.5, 0, 0, 0, 0, 0.01)
    world.run(100)
    np.testing.assert_allclose(world.twists[0], [0.25, 0, 0, 0, 0, 0.01 * 0.1 / 3e-3], rtol=1e-6, atol=1e-9)


def test_the_inertia_of_a_shape_is_that_of_its_volume() -> None:
    side, mass, torque = 0.05, 0.3, 0.01
    world = World(free(Box((side / 2,) * 3), mass=mass), gravity=(0, 0, 0))
    world.forces[0, 5] = torque
    world.run(50)
    assert world.twists[0, 5] == pytest.approx(torque * 0.05 / (mass * side**2 / 6), rel=1e-6)


def test_a_turned_body_has_its_twist_in_the_world() -> None:
    body = Body(Box((0.02, 0.03, 0.04)), (0, 0, 0, np.sqrt(0.5), np.sqrt(0.5), 0, 0), FREE, 0.2, (1e-4, 1e-4, 1e-4))
    world = World(body, gravity=(0, 0, 0))
    world.forces[0, 3:] = (0, 0, 1e-3)
    world.run(20)
    np.testing.assert_allclose(world.twists[0, 3:], [0, 0, 1e-3 * 0.02 / 1e-4], rtol=1e-6, atol=1e-9)


def test_damping_is_a_rate() -> None:
    world = World(free(Sphere(0.01), damping=5.0), gravity=(0, 0, 0))
    world.forces[0, 0] = 1.0
    world.run(1)
    start = world.twists[0, 0]
    world.forces[:] = 0
    world.run(200)
    assert world.twists[0, 0] / start == pytest.approx(np.exp(-1.0), rel=0.01)


@pytest.mark.parametrize("axis", range(6))
def test_a_push_acts_along_its_axis_and_damping_is_the_same_about_each(axis: int) -> None:
    inertia = (1e-3, 1.5e-3, 2e-3)
    world = World(free(Box((0.02, 0.03, 0.04)), inertia=inertia, damping=5.0), gravity=(0, 0, 0))
    world.forces[0, axis] = 1.0 if axis < 3 else 0.01
    world.run(1)
    start = np.zeros(6)
    start[axis] = T / 0.2 if axis < 3 else 0.01 * T / inertia[axis - 3]
    np.testing.assert_allclose(world.twists[0], start, rtol=1e-6, atol=1e-12)
    world.forces[:] = 0
    world.run(200)
    np.testing.assert_allclose(world.twists[0], start * np.exp(-1.0), rtol=0.01, atol=1e-12)


def test_a_push_at_the_centre_of_mass_turns_nothing_wherever_the_frame_is() -> None:
    corners, faces = icosphere(2, 0.02)
    away, push = np.array((0.01, 0.02, 0.03)), np.array((1.0, -2.0, 0.5))
    world = World(free(Mesh(Surface(corners + away, faces)), damping=5.0), gravity=(0, 0, 0))
    world.forces[0] = (*push, *np.cross(away, push))
    world.run(1)
    np.testing.assert_allclose(world.twists[0], (*(push * T / 0.2), 0, 0, 0), rtol=1e-6, atol=1e-6)
    world.forces[:] = 0
    world.run(200)
    np.testing.assert_allclose(world.twists[0], (*(push * T / 0.2 * np.exp(-1.0)), 0, 0, 0), rtol=0.01, atol=1e-6)


SLENDER = (0.02, 0.005, 0.09)  # long along its last axis: its greatest moment is not the first


def slender_mesh(middle: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * SLENDER + middle
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return Mesh(Surface(corners, [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]))


@pytest.mark.parametrize("inertia", [None, (1e-4, 2e-4, 1.5e-4)])
def test_a_mesh_moves_alike_and_keeps_its_momentum_wherever_the_origin_of_its_file_is(
    inertia: tuple[float, float, float] | None,
) -> None:
    push, turn = np.array((3.0, -1.0, 2.0)), np.array((0.01, 0.02, -0.015))
    tracks = []
    for middle in ((0.0, 0.0, 0.0), (0.5, -0.2, 0.3)):
        world = World(free(slender_mesh(middle), tuple(-np.array(middle)), inertia=inertia), gravity=(0, 0, 0))
        track = []
        for i in range(300):
            w, u = world.poses[0, 3], world.poses[0, 4:]
            arm = middle + 2 * np.cross(u, np.cross(u, middle) + w * np.array(middle))
            spin = world.twists[0, 3:]
            track.append((*(world.poses[0, :3] + arm), *(world.twists[0, :3] + np.cross(spin, arm)), *spin))
            world.forces[0] = (*push, *(turn + np.cross(arm, push))) if i < 20 else (0.0,) * 6
            world.run(1)
        tracks.append(np.array(track))
        np.testing.assert_allclose(tracks[-1][21:, 3:6], np.tile(push * 20 * T / 0.2, (279, 1)), rtol=1e-5)
        assert np.abs(tracks[-1][21:, 6:]).max(axis=0).min() > 1.0
    np.testing.assert_allclose(tracks[1], tracks[0], rtol=1e-4, atol=1e-5)


def test_a_state_of_an_earlier_program_goes_on_where_it_was() -> None:
    """It had MuJoCo's coordinates at the origin of a mesh's file; that of this program is left as it is, to the bit."""
    world = World(free(slender_mesh((0.1, -0.05, 0.02))), free(Box((0.01,) * 3), (1.0, 0.0, 1.0)), gravity=(0, 0, 0))
    world.forces[:] = (0.02, 0.0, 0.03, 2e-4, 1e-4, 3e-4)
    world.run(50)
    world.forces[:] = 0.0
    world.run(1)
    stored = world.state.copy()
    world.physics.take_over(world.state, world.poses)
    assert world.state.tobytes() == stored.tobytes()
    model, data, kind = world.physics._model, world.physics._data, mujoco.mjtState.mjSTATE_INTEGRATION
    mujoco.mj_setState(model, data, stored, kind)
    data.qpos.reshape(-1, 7)[:, :3], data.qvel.reshape(-1, 6)[:, :3] = world.poses[:, :3], world.twists[:, :3]
    earlier = np.empty_like(stored)
    mujoco.mj_getState(model, data, earlier, kind)
    assert np.abs(earlier - stored).max() > 0.05
    world.physics.take_over(earlier, world.poses)
    np.testing.assert_allclose(earlier, stored, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("axis", range(3))
def test_the_turning_of_a_mesh_is_damped_as_that_of_the_box_which_it_is(axis: int) -> None:
    starts = []
    for shape in (Box(SLENDER), slender_mesh()):
        world = World(free(shape, damping=5.0), gravity=(0, 0, 0))
        world.forces[0, 3 + axis] = 1e-4
        world.run(1)
        start = world.twists[0].copy()
        world.forces[:] = 0
        world.run(200)
        np.testing.assert_allclose(world.twists[0], start * np.exp(-1.0), rtol=0.01, atol=1e-7)
        starts.append(start)
    np.testing.assert_allclose(starts[1], starts[0], rtol=1e-5, atol=1e-9)


def test_a_mesh_that_is_askew_in_its_file_turns_as_the_box_which_it_is() -> None:
    turned, rotation = np.array((0.5, -0.3, 0.6, 0.55)), np.zeros(9)
    turned /= np.linalg.norm(turned)
    mujoco.mju_quat2Mat(rotation, turned)
    faces = slender_mesh().surface.faces
    askew = Mesh(Surface(slender_mesh().surface.vertices @ rotation.reshape(3, 3).T, faces))
    box = Body(Box(SLENDER), (0.0, 0.0, 1.0, *turned), FREE, 0.2, damping=5.0)
    ends = []
    for world in (World(box, gravity=(0, 0, 0)), World(free(askew, damping=5.0), gravity=(0, 0, 0))):
        world.forces[0, 3:] = 1e-3, -2e-3, 1.5e-3
        world.run(20)
        world.forces[:] = 0
        ends.append(world.run(100).twists[0, 3:].copy())
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-3, atol=1e-6)
    assert np.abs(ends[0]).min() > 0.01


@pytest.mark.parametrize(
    ("shape", "height"),
    [
        (Box((0.02, 0.03, 0.01)), 0.01),
        (Sphere(0.015), 0.015),
        (Cylinder(0.02, 0.01), 0.01),
        (None, None),
    ],
)
@pytest.mark.parametrize("ground", [Plane(), Box((0.5, 0.5, 0.1))])
def test_what_lies_on_the_ground_stays_there(shape: Shape | None, height: float | None, ground: Shape) -> None:
    shape = shape or Mesh(Surface(*icosphere(2, 0.02)))  # made in the test, as making a mesh compiles
    top = 0.0 if isinstance(ground, Plane) else 0.1
    world = World(Body(ground, (0, 0, 0, *UP)), free(shape, (0.02, 0.01, top + 0.03))).run(1500)
    if height is not None:
        assert world.poses[1, 2] == pytest.approx(top + height, abs=5e-5)
    assert 0.01 < world.poses[1, 2] - top < 0.03 or height == 0.01
    assert np.abs(world.twists[1, :3]).max() < (5e-3 if height is not None else 0.1)  # what is almost a ball rolls


@pytest.mark.parametrize("said", [{"friction": 0.5}, {}])
def test_friction_holds_up_to_its_coefficient(said: dict[str, float]) -> None:
    """A half is what bodies have of which nothing is said."""
    for push, moves in ((0.45, False), (0.55, True)):
        world = World(Body(Plane(), (0, 0, 0, *UP), **said), free(Box((0.05, 0.05, 0.01)), (0, 0, 0.01), **said))
        world.run(100)
        world.forces[1, 0] = push * 0.2 * 9.81
        world.run(500)
        assert (world.poses[1, 0] > 5e-3) == moves


def test_a_moved_body_takes_others_along() -> None:
    world = World(
        Body(Plane(), (0, 0, 0, *UP)), Body(Box((0.01, 0.05, 0.05)), (-0.05, 0, 0.05, *UP), MOVED),
        free(Box((0.01, 0.01, 0.01)), (0, 0, 0.01)),
    )  # fmt: skip
    for k in range(500):
        world.poses[1, 0] = -0.05 + 0.2e-3 * k
        world.run(1)
    assert world.poses[2, 0] > world.poses[1, 0] + 0.018


def test_steps_go_on_from_their_state_to_the_same_bits() -> None:
    def make() -> World:
        return World(
            Body(Plane(), (0, 0, 0, *UP)), free(Box((0.02, 0.02, 0.02)), (0, 0, 0.021)), free(Capsule(0.01, 0.02), (0.002, 0, 0.08)),
            free(Mesh(Surface(*icosphere(1, 0.02))), (0, 0.001, 0.13)),
        )  # fmt: skip

    straight = make().run(700)
    broken, again = make().run(330), make()
    again.run(5)  # a workplace that has done something else
    again.state[:], again.poses[:], again.twists[:] = broken.state, broken.poses, broken.twists
    again.run(370)
    for name in ("state", "poses", "twists"):
        np.testing.assert_array_equal(getattr(again, name), getattr(straight, name))


def test_a_plane_and_a_flat_mesh_are_no_bodies() -> None:
    with pytest.raises(BodyError, match="plane") as caught:
        build_bodies([Body(Sphere(0.1), (0, 0, 0, *UP)), free(Plane())], G, T)
    assert caught.value.index == 1
    flat = Mesh(Surface([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    with pytest.raises(BodyError) as caught:
        build_bodies([Body(Plane(), (0, 0, 0, *UP)), free(flat)], G, T)
    assert caught.value.index == 1


@pytest.mark.parametrize(
    ("message", "index"),
    [
        ("Error: mass and inertia of moving bodies must be larger than mjMINVAL, name 'o3'", 3),
        ("Error: mesh volume is too small: m1", 2),  # it is named otherwise: then the first free one
        ("Error: mesh volume is too small, mesh 'm1'", 1),
        ("Error: something else", 2),
    ],
)
def test_an_impossible_inertia_names_its_object(message: str, index: int) -> None:
    kinds = (STILL, MOVED, FREE, FREE)
    assert bodies._which(message, [Body(Sphere(0.01), (0, 0, 0, *UP), kind) for kind in kinds]) == index
