"""Layers, texture, stick-slip, viscosity, vibration and attraction: their laws, and that they give out no energy."""

from __future__ import annotations

import numpy as np
import pytest
from probing import Floats, random_pose, rotation

from itouch.contact import Box, Friction, Geometry
from itouch.contact.effects import EFFECTS_MEMORY, carved, render_effects
from itouch.contact.step import step
from itouch.contact.surface_effects import Effects, Texture, effects_table
from itouch.plugin import Bound

K, PERIOD, RADIUS, TOP = 1000.0, 1e-3, 0.005, 0.105
STILL = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


class Finger:
    """A probe over a cube of side 0.2 m with effects; places and forces are in the cube's frame."""

    def __init__(self, effects: Effects, friction: tuple[float, float] = (0.0, 0.0), pose: Floats = STILL) -> None:
        self.geometry = Geometry.build([Box((0.1, 0.1, 0.1))], [Friction(*friction)])
        found = effects_table([effects])
        assert found is not None
        self.table, self.samples = found
        self.pose, self.turn = pose[None].copy(), rotation(pose[3:])
        self.contact, self.result = self.geometry.new_memory(), self.geometry.new_result()
        self.memory, self.extra = np.zeros(EFFECTS_MEMORY), np.zeros(3)
        self.old: Floats | None = None
        self.stiffness, self.place, self.velocity = np.array([K]), np.zeros(3), np.zeros(3)
        self.render = Bound(
            render_effects, self.table, self.samples, self.geometry.world, self.pose, np.zeros((1, 6)), self.stiffness,
            self.place, self.velocity, PERIOD, self.memory, self.result, self.extra,
        )  # fmt: skip

    def __call__(self, hip: Floats) -> Floats:
        place = self.turn @ np.asarray(hip, float) + self.pose[0, :3]
        self.place[:], self.velocity[:] = place, 0.0 if self.old is None else (place - self.old) / PERIOD
        self.old, world, still = place, self.geometry.world, np.zeros((1, 6))
        step(world, None, self.pose, still, self.stiffness, place, RADIUS, 0.05, self.contact, self.result)
        self.render.run()  # as in a tick, where the same is compiled
        return np.asarray(self.turn.T @ (self.result[:3] + self.extra))

    @property
    def spring(self) -> Floats:
        return np.asarray(self.turn.T @ self.result[:3])


def poses() -> list[Floats]:
    return [STILL, random_pose(np.random.default_rng(5), 0.3)]


@pytest.mark.parametrize("pose", poses(), ids=["upright", "turned"])
def test_layers_add_up_on_the_way_in(pose: Floats) -> None:
    finger = Finger(Effects(layers=((1e-3, 200.0), (2e-3, 500.0))), pose=pose)
    for depth, force in ((0.0, 0.0), (0.5e-3, 0.1), (1e-3, 0.2), (2e-3, 0.7), (3e-3, 1.2), (5e-3, 3.2)):
        np.testing.assert_allclose(finger(np.array([0, 0, TOP - depth])), [0, 0, force], atol=1e-9)


def test_a_layer_is_never_stiffer_than_what_is_rendered() -> None:
    finger = Finger(Effects(layers=((1e-3, 5000.0),)))
    finger(np.array([0, 0, TOP]))
    np.testing.assert_allclose(finger(np.array([0, 0, TOP - 5e-4])), [0, 0, 0.5], atol=1e-9)


def wave(count: int = 128) -> Floats:
    """One period each way, 0 to 1."""
    x = np.sin(2 * np.pi * (np.arange(count) + 0.5) / count)
    return np.asarray(0.5 + 0.25 * (x[None, :] + x[:, None]))


@pytest.mark.parametrize("axis", [-1, 2])
@pytest.mark.parametrize("pose", poses(), ids=["upright", "turned"])
def test_a_texture_is_the_gradient_of_its_energy(axis: int, pose: Floats) -> None:
    depth, pitch = 5e-4, 1e-4
    finger = Finger(Effects(texture=Texture(wave(), depth, pitch, axis)), pose=pose)
    rng = np.random.default_rng(2)
    local, up = np.array([STILL]), (0.0, 0.0, 1.0)

    def energy(hip: Floats) -> float:
        cut, _ = carved(finger.table, 0, finger.samples, (hip[0], hip[1], 0.1), up)
        return 0.5 * K * max(TOP - hip[2] - cut, 0.0) ** 2

    assert local.shape == (1, 7)
    for _ in range(60):
        hip = np.array([*rng.uniform(-0.02, 0.02, 2), TOP - rng.uniform(6e-4, 3e-3)])
        small = 1e-8
        gradient = [(energy(hip + small * e) - energy(hip - small * e)) / (2 * small) for e in np.eye(3)]
        finger(hip)
        np.testing.assert_allclose(finger(hip), -np.array(gradient), atol=2e-4)


def test_a_texture_lies_upright_on_the_top_and_repeats() -> None:
    heights = np.zeros((4, 4))
    heights[0, 3] = 1.0  # upper right
    finger = Finger(Effects(texture=Texture(heights, 1e-4, 1e-3, 2)))
    for x, y in ((1.5e-3, 1.5e-3), (5.5e-3, -2.5e-3)):
        cut, slope = carved(finger.table, 0, finger.samples, (x, y, 0.1), (0.0, 0.0, 1.0))
        assert cut == pytest.approx(0.0, abs=1e-12)
        assert slope[2] == 0.0
    assert carved(finger.table, 0, finger.samples, (-1.5e-3, 1.5e-3, 0.1), (0.0, 0.0, 1.0))[0] == pytest.approx(1e-4)


def test_nothing_is_felt_above_the_carved_surface() -> None:
    finger = Finger(Effects(texture=Texture(np.zeros((8, 8)), 1e-3, 1e-3)), friction=(0.5, 0.4))
    finger(np.array([0, 0, TOP]))
    np.testing.assert_array_equal(finger(np.array([1e-4, 0, TOP - 0.9e-3])), 0.0)
    np.testing.assert_allclose(finger(np.array([1e-4, 0, TOP - 1.5e-3])), [-0.1, 0, 0.5], atol=1e-9)


def test_stick_slip_holds_and_lets_go() -> None:
    finger = Finger(Effects(stick_slip=(500.0, 0.4)))
    finger(np.array([0, 0, TOP - 2e-3]))
    finger(np.array([0, 0, TOP - 2e-3]))
    pulls = [finger(np.array([x, 0, TOP - 2e-3]))[0] for x in np.arange(0, 4e-3, 1e-5)]
    assert min(pulls) == pytest.approx(-0.4, abs=0.006)
    drops = np.flatnonzero(np.diff(pulls) > 0.2)
    np.testing.assert_allclose(np.diff(drops) * 1e-5, 0.4 / 500, atol=2.1e-5)
    light = [finger(np.array([x, 0, TOP - 1e-4]))[0] for x in np.arange(0, 4e-3, 1e-5)]
    assert min(light) >= -0.1 - 1e-9  # never more than the normal force


def test_viscosity_opposes_the_motion_along_the_surface() -> None:
    finger = Finger(Effects(viscosity=3.0))
    for i in range(5):
        force = finger(np.array([1e-4 * i, 0, TOP - 1e-3]))
    np.testing.assert_allclose(force, [-0.3, 0, 1.0], atol=1e-9)


def test_a_tap_rings_in_proportion_to_the_impact_and_never_pulls() -> None:
    peaks = []
    for step_in in (1e-5, 2e-5):
        finger = Finger(Effects(tap=(0.1, 200.0, 0.01)))
        hips = np.concatenate([np.arange(TOP + 1e-3, TOP - 2e-4, -step_in), np.full(80, TOP - 2e-4)])
        forces = np.array([finger(np.array([0, 0, z]))[2] for z in hips])
        ring = forces - K * np.maximum(TOP - hips, 0)
        peaks.append(np.abs(ring).max())
        assert np.abs(ring[-1]) < 1e-4 * peaks[-1] + 1e-3 * peaks[-1]
        assert forces.min() >= 0.0
    assert peaks[1] == pytest.approx(2 * peaks[0], rel=0.25)


def test_the_steady_vibration_has_its_amplitude_and_frequency() -> None:
    finger = Finger(Effects(vibration=(0.2, 50.0)))
    finger(np.array([0, 0, TOP]))
    forces = np.array([finger(np.array([0, 0, TOP - 1e-3]))[2] for _ in range(201)])[1:]
    assert np.ptp(forces) == pytest.approx(0.4, rel=0.01)
    assert np.argmax(np.abs(np.fft.rfft(forces - forces.mean()))) == 10  # 50 Hz in 0.2 s


def test_a_magnet_pulls_within_its_range_only_and_gives_back_what_it_took() -> None:
    finger = Finger(Effects(magnet=(0.8, 0.02)))
    heights = np.linspace(TOP + 0.03, TOP, 2001)
    forces = np.array([finger(np.array([0, 0, z]))[2] for z in heights])
    assert not forces[heights > TOP + 0.02].any()
    assert forces.min() == pytest.approx(-0.8, rel=1e-3)
    assert (np.diff(forces[heights < TOP + 0.019]) < 0).all()
    work_in = np.trapezoid(forces, heights)
    back = np.array([finger(np.array([0, 0, z]))[2] for z in heights[::-1]])
    assert work_in + np.trapezoid(back, heights[::-1]) == pytest.approx(0.0, abs=1e-9)


PASSIVE = {
    "layers": Effects(layers=((1e-3, 200.0), (1e-3, 500.0))),
    "texture": Effects(texture=Texture(wave(), 4e-4, 1e-4)),
    "stick-slip": Effects(stick_slip=(400.0, 0.4)),
    "viscosity": Effects(viscosity=1.0),
    "all": Effects(Texture(wave(), 4e-4, 1e-4), ((1e-3, 300.0),), (300.0, 0.3), 0.5),
}


@pytest.mark.parametrize("name", PASSIVE)
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_closed_loops_through_a_surface_return_no_energy(name: str, friction: float) -> None:
    rng = np.random.default_rng(11)
    for _ in range(4):
        finger = Finger(PASSIVE[name], (friction, 0.8 * friction))
        phase, size = rng.uniform(0, 2 * np.pi, 3), rng.uniform(1e-3, 4e-3)
        turn = np.linspace(0, 2 * np.pi, 8001)
        path = np.stack(
            [
                size * np.sin(turn + phase[0]),
                size * np.sin(2 * turn + phase[1]),
                TOP - 1e-3 + 2e-3 * np.sin(turn + phase[2]),
            ],
            1,
        )
        forces = np.array([finger(hip) for hip in np.concatenate([path[:-1], path])])[-len(path) :]
        given = np.einsum("ni,ni->", (forces[1:] + forces[:-1]) / 2, np.diff(path, axis=0))
        assert given <= 2e-6  # of about 1 mJ that goes in and out


def test_effects_go_on_from_their_memory(rng: np.random.Generator) -> None:
    effects = Effects(
        Texture(wave(), 4e-4, 1e-4), ((1e-3, 300.0),), (300.0, 0.3), 0.5, (0.2, 0.01), (0.1, 80.0), (0.2, 150.0, 0.02)
    )
    path = np.cumsum(rng.normal(size=(400, 3)) * 3e-4, axis=0) * [1, 1, 0.3] + [0, 0, TOP]
    straight = Finger(effects, (0.4, 0.3))
    whole = [straight(hip) for hip in path]
    first, second = Finger(effects, (0.4, 0.3)), Finger(effects, (0.4, 0.3))
    for hip in path[:200]:
        first(hip)
    second.contact[:], second.memory[:], second.old = first.contact, first.memory, first.old
    np.testing.assert_array_equal([second(hip) for hip in path[200:]], whole[200:])


def test_without_effects_there_is_no_table() -> None:
    assert effects_table([Effects(), Effects()]) is None
