"""A probe that wanders among random primitives: never inside, never farther from the HIP than it must be."""

import numpy as np
import pytest
from campaign import seeds
from probing import Floats, random_pose, rotation
from test_distance import measure

from itouch.contact import Box, Capsule, Cylinder, Friction, Geometry, Plane, Shape, Sphere
from itouch.contact import layout as at
from itouch.contact.step import step


def distances(shapes: list[Shape], poses: Floats, p: Floats) -> Floats:
    return np.array(
        [measure(s, rotation(pose[3:]).T @ (p - pose[:3]))[0] for s, pose in zip(shapes, poses, strict=True)]
    )


def random_shape(rng: np.random.Generator, size: float) -> Shape:
    a, b, c = rng.uniform(0.1, 1.0, 3) * size
    kinds: list[Shape] = [Box((a, b, c)), Sphere(a), Plane(), Capsule(a, b), Cylinder(a, b)]
    return kinds[rng.integers(len(kinds))]


@pytest.mark.parametrize("friction", [0.0, 0.6])
@pytest.mark.parametrize("seed", seeds(5, 12))
def test_a_probe_among_random_primitives_stays_outside(seed: int, friction: float) -> None:
    rng = np.random.default_rng(seed)
    size = 10 ** rng.uniform(-3, 1)
    shapes = [random_shape(rng, size) for _ in range(rng.integers(1, 6))]
    geometry = Geometry.build(shapes, [Friction(friction, 0.7 * friction)] * len(shapes))
    poses = np.array([random_pose(rng, 0.7 * size) for _ in shapes])
    radius = float(rng.choice([0.0, 0.02, 0.2])) * size
    memory, result = geometry.new_memory(), geometry.new_result()
    hip, pace = rng.normal(size=3) * 2 * size, np.zeros(3)
    for _ in range(150):
        pace = 0.98 * (pace + rng.normal(size=3) * 0.01 * size - 0.002 * hip)
        hip = hip + pace
        step(geometry.world, None, poses, np.zeros((len(shapes), 6)), np.ones(len(shapes)), hip, radius, 0.1 * size,
             memory, result)  # fmt: skip
        proxy = result[at.RESULT_PROXY : at.RESULT_PROXY + 3]
        gap = distances(shapes, poses, proxy).min() - radius
        assert gap > -1e-9 * size
        check_force(result, friction, size)
        if result[at.RESULT_COUNT] == 0:
            np.testing.assert_array_equal(proxy, hip)
            assert result[at.RESULT_DISTANCE] == pytest.approx(gap if gap <= 0.1 * size else np.inf, abs=1e-9 * size)
        elif friction == 0.0:
            check_nearest(rng, shapes, poses, proxy, hip, radius, size)


def check_force(result: Floats, friction: float, size: float) -> None:
    force, normal = result[:3], result[at.RESULT_NORMAL : at.RESULT_NORMAL + 3]
    push = float(force @ normal)
    assert np.linalg.norm(force - push * normal) <= friction * push * (1 + 1e-6) + 1e-9 * size
    count = int(result[at.RESULT_COUNT])
    shares = result[at.RESULT_CONTACTS :].reshape(at.MAX_CONTACTS, -1)[:count, at.CONTACT_SHARE]
    assert count == 0 or shares.sum() == pytest.approx(1.0)
    assert (np.diff(shares) <= 0).all()


def check_nearest(
    rng: np.random.Generator, shapes: list[Shape], poses: Floats, proxy: Floats, hip: Floats, radius: float, size: float
) -> None:
    """No free place beside the proxy is nearer to the HIP."""
    for _ in range(3):
        beside = proxy + rng.normal(size=3) * 1e-4 * size
        if distances(shapes, poses, beside).min() >= radius:
            assert np.linalg.norm(beside - hip) > np.linalg.norm(proxy - hip) - 1e-7 * size


def test_a_finger_in_the_corner_between_two_boxes_feels_both() -> None:
    geometry = Geometry.build([Box((0.5, 0.5, 0.1)), Box((0.1, 0.1, 0.1))])
    poses = np.array([[0, 0, -0.1, 1, 0, 0, 0], [0.3, 0, 0.1, 1, 0, 0, 0.0]])
    memory, result = geometry.new_memory(), geometry.new_result()
    stiffness = np.array([1000.0, 2000.0])
    for hip in ([0.1, 0, 0.05], [0.196, 0, 0.005], [0.196, 0, 0.005]):
        step(geometry.world, None, poses, np.zeros((2, 6)), stiffness, np.array(hip), 0.008, 0.0, memory, result)
    np.testing.assert_allclose(result[at.RESULT_PROXY : at.RESULT_PROXY + 3], [0.192, 0, 0.008], atol=1e-12)
    contacts = result[at.RESULT_CONTACTS :].reshape(at.MAX_CONTACTS, -1)[: int(result[at.RESULT_COUNT])]
    assert [int(c) for c in contacts[:, at.CONTACT_OBJECT]] == [1, 0]
    np.testing.assert_allclose(contacts[:, at.CONTACT_PENETRATION], [0.004, 0.003], atol=1e-12)
    np.testing.assert_allclose(contacts[:, at.CONTACT_SHARE], [4 / 7, 3 / 7], atol=1e-9)
    np.testing.assert_allclose(contacts[1, at.CONTACT_POINT : at.CONTACT_POINT + 3], [0.192, 0, 0], atol=1e-12)
    mean = 2000 * 4 / 7 + 1000 * 3 / 7
    assert result[at.RESULT_STIFFNESS] == pytest.approx(mean)
    np.testing.assert_allclose(result[:3], mean * np.array([-0.004, 0, 0.003]), atol=1e-9)


def test_the_first_step_starts_at_the_hip_or_at_the_nearest_free_point() -> None:
    geometry = Geometry.build([Box((0.5, 0.4, 0.1))])
    poses = np.array([[0, 0, 0, 1, 0, 0, 0.0]])
    for hip, place in (([0, 0, 0.3], [0, 0, 0.3]), ([0, 0, 0.08], [0, 0, 0.11]), ([0.49, 0, 0], [0.51, 0, 0])):
        memory, result = geometry.new_memory(), geometry.new_result()
        step(geometry.world, None, poses, np.zeros((1, 6)), np.ones(1), np.array(hip), 0.01, 0.0, memory, result)
        np.testing.assert_allclose(result[at.RESULT_PROXY : at.RESULT_PROXY + 3], place, atol=1e-12)


def test_a_hip_that_is_no_number_gives_no_force_and_is_forgotten() -> None:
    geometry = Geometry.build([Plane()])
    poses, memory, result = np.array([[0, 0, 0, 1, 0, 0, 0.0]]), geometry.new_memory(), geometry.new_result()

    def go(*hip: float) -> Floats:
        step(geometry.world, None, poses, np.zeros((1, 6)), np.ones(1), np.array(hip), 0.01, 0.0, memory, result)
        return result.copy()

    go(0.0, 0.0, 0.1)
    before = go(0.0, 0.0, -0.1)
    kept = memory.copy()
    assert not go(0.0, np.nan, 0.0)[:3].any()
    np.testing.assert_array_equal(memory, kept)
    np.testing.assert_array_equal(go(0.0, 0.0, -0.1), before)


def test_a_saved_memory_goes_on_to_the_same_bytes(rng: np.random.Generator) -> None:
    geometry = Geometry.build([Box((0.2, 0.2, 0.2)), Sphere(0.2)], [Friction(0.5, 0.3)] * 2)
    poses = np.array([random_pose(rng, 0.1) for _ in range(2)])
    path = np.cumsum(rng.normal(size=(300, 3)) * 0.01, axis=0) + [0.4, 0, 0]
    memory, result = geometry.new_memory(), geometry.new_result()
    record, saved = [], np.empty(0)
    for i, hip in enumerate(path):
        if i == 150:
            saved = memory.copy()
        step(geometry.world, None, poses, np.zeros((2, 6)), np.ones(2), hip, 0.02, 0.1, memory, result)
        record.append(result.tobytes())
    for i, hip in enumerate(path[150:]):
        step(geometry.world, None, poses, np.zeros((2, 6)), np.ones(2), hip, 0.02, 0.1, saved, result)
        assert result.tobytes() == record[150 + i]
