"""The interface for others: what comes back, what goes on, and what is refused with the name of the argument."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from probing import box_mesh, grid

from itouch.contact import Box, Capsule, Friction, Mesh, Proxy, Sphere, Surface
from itouch_evidence.contact.contact_workload import icosphere


@cache
def ball() -> Surface:
    """Return a ball, made when a test first needs it, as making it compiles."""
    return Surface(*icosphere(3, 0.05))


def test_closest_of_one_point_and_of_many() -> None:
    point, distance, face = ball().closest([0.0, 0.0, 0.2])
    assert point.shape == (3,)
    assert (np.ndim(distance), np.ndim(face)) == (0, 0)
    points, distances, faces = ball().closest([[0.0, 0.0, 0.2], [0.0, 0.0, 0.01], [0.3, 0.0, 0.0]])
    assert (points.shape, distances.shape, faces.shape) == ((3, 3), (3,), (3,))
    assert (distances >= 0.0).all()  # unsigned: the second is inside
    assert (distances[0], faces[0]) == (distance, face)
    np.testing.assert_array_equal(points[0], point)
    np.testing.assert_allclose(np.linalg.norm(points - [[0, 0, 0.2], [0, 0, 0.01], [0.3, 0, 0]], axis=1), distances)
    assert [a.shape for a in ball().closest(np.zeros((0, 3)))] == [(0, 3), (0,), (0,)]


@pytest.mark.parametrize("kind", [np.float32, np.int64, list, np.asfortranarray])
def test_any_array_of_numbers_will_do(kind: Callable[[object], object]) -> None:
    points = np.array([[1, 2, 3], [0, 0, 1]])
    given = kind(points.tolist()) if kind is list else kind(points)
    np.testing.assert_array_equal(ball().closest(given)[1], ball().closest(points.astype(float))[1])


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_what_is_no_place_has_no_nearest_point(bad: float) -> None:
    nearest, distances, faces = ball().closest([[bad, 0, 0], [0, 0, 1.0]])
    np.testing.assert_array_equal(nearest[0], [bad, 0, 0])
    assert (distances[0], faces[0]) == (np.inf, -1)
    assert faces[1] >= 0
    assert ball().closest([0, bad, 0])[2] == -1


def test_a_surface_tells_what_it_was_made_of() -> None:
    vertices, faces = icosphere(3, 0.05)
    np.testing.assert_array_equal(ball().vertices[ball().faces], vertices[faces])
    assert not ball().vertices.flags.writeable


def test_a_proxy_goes_on_from_where_it_is() -> None:
    path = np.linspace([0.02, 0.0, 0.07], [-0.02, 0.01, 0.045], 60)
    stepped, followed = (Proxy([ball()], radius=0.01, static_friction=0.5, dynamic_friction=0.3) for _ in range(2))
    forces = np.array([stepped.step(hip) for hip in path])
    parts = [followed.follow(path[:20]), followed.follow(path[20:21]), followed.follow(path[21:])]
    np.testing.assert_array_equal(np.concatenate(parts), forces)
    np.testing.assert_array_equal(followed.position, stepped.position)
    assert stepped.in_contact
    assert np.linalg.norm(stepped.normal) == pytest.approx(1.0)
    assert stepped.normal @ forces[-1] > 0.0
    np.testing.assert_allclose(forces[-1], 1000.0 * (stepped.position - path[-1]), rtol=1e-9)


def test_the_first_step_equals_a_reset() -> None:
    inside = [0.0, 0.0, 0.03]
    first, other = Proxy([ball()], radius=0.01), Proxy(ball(), radius=0.01)
    np.testing.assert_array_equal(first.step(inside), other.reset(inside))
    assert np.linalg.norm(first.position) == pytest.approx(0.06, rel=0.02)  # the nearest free point of a solid
    first.step([0.0, 0.0, 0.2])
    assert not first.in_contact
    np.testing.assert_array_equal(first.normal, 0.0)
    np.testing.assert_array_equal(first.position, [0.0, 0.0, 0.2])


def test_a_front_is_felt_and_a_back_only_on_a_two_sided_surface() -> None:
    down, up = np.linspace([0, 0, 0.1], [0, 0, -0.01], 50), np.linspace([0, 0, -0.1], [0, 0, 0.01], 50)
    one, two = Surface(*grid(3)), Surface(*grid(3), two_sided=True)
    assert Proxy([one]).follow(down)[-1][2] == pytest.approx(10.0, rel=1e-4)
    assert (Proxy([one]).follow(up) == 0.0).all()
    assert Proxy([two]).follow(down)[-1][2] == pytest.approx(10.0, rel=1e-4)
    assert Proxy([two]).follow(up)[-1][2] == pytest.approx(-10.0, rel=1e-4)


def test_surfaces_and_shapes_together() -> None:
    corner = Proxy([Surface(*box_mesh(1, 1, 0.1)), Sphere(0.2), Box((0.05, 1, 1))], radius=0.01, stiffness=500.0)
    force = corner.follow(np.linspace([0.4, 0.0, 0.4], [0.05, 0.0, 0.1], 200))[-1]
    assert np.isfinite(force).all()
    assert corner.in_contact


TRIANGLE = np.eye(3), [[0, 1, 2]]
REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "points of two": (lambda: ball().closest([1.0, 2.0]), r"points has shape \(2,\)"),
    "points in a cube": (lambda: ball().closest(np.zeros((2, 2, 3))), "points has shape"),
    "words": (lambda: ball().closest("abc"), "points is not an array of numbers"),
    "ragged points": (lambda: ball().closest([[1, 2, 3], [1, 2]]), "points is not an array"),
    "complex points": (lambda: ball().closest([1j, 0, 0]), "points is not an array of numbers"),
    "flat vertices": (lambda: Surface(np.zeros((3, 2)), [[0, 1, 2]]), "vertices has shape"),
    "NaN vertices": (lambda: Surface(np.eye(3) * np.nan, [[0, 1, 2]]), r"vertices\[0\] is not finite"),
    "vast vertices": (lambda: Surface(np.eye(3) * 1e200, [[0, 1, 2]]), "vertices reach 1e"),
    "complex vertices": (lambda: Surface(np.eye(3) * 1j, [[0, 1, 2]]), "vertices is not an array of numbers"),
    "no faces": (lambda: Surface(np.eye(3), []), "faces is empty"),
    "no faces of three": (lambda: Surface(np.eye(3), np.zeros((0, 3), int)), "faces is empty"),
    "faces of four": (lambda: Surface(np.eye(4)[:, :3], [[0, 1, 2, 3]]), "faces has shape"),
    "ragged faces": (lambda: Surface(np.eye(3), [[0, 1], [0, 1, 2]]), "faces is not an array"),
    "fractions": (lambda: Surface(np.eye(3), [[0.0, 1.0, 2.0]]), "whole numbers"),
    "a vertex that is not there": (lambda: Surface(np.eye(3), [[0, 1, 3]]), "faces names vertex 3"),
    "a vertex from behind": (lambda: Surface(np.eye(3), [[0, 1, -1]]), "faces names vertex -1"),
    "a box of one number": (lambda: Box(1), "half_extents is 1; it needs 3 numbers"),  # type: ignore[arg-type]
    "a box of words": (lambda: Box("abc"), r"half_extents\[0\] is 'a'"),  # type: ignore[arg-type]
    "a ball of a word": (lambda: Sphere("a"), "radius is 'a'; it must be a positive finite number"),  # type: ignore[arg-type]
    "a capsule of None": (lambda: Capsule(0.01, None), "half_length is None"),  # type: ignore[arg-type]
    "friction as a word": (lambda: Friction("a"), "static is 'a'; it must be a finite number"),  # type: ignore[arg-type]
    "a mesh of a word": (lambda: Mesh("a"), "surface is of type str; it must be a Surface"),  # type: ignore[arg-type]
    "no surface": (lambda: Proxy([]), "surfaces is empty"),
    "None": (lambda: Proxy(None), "surfaces is None"),  # type: ignore[arg-type]
    "arrays": (lambda: Proxy([TRIANGLE]), r"surfaces\[0\] is of type tuple"),  # type: ignore[list-item]
    "radius below 0": (lambda: Proxy(ball(), radius=-1e-9), "radius is -1e-09"),
    "radius NaN": (lambda: Proxy(ball(), radius=np.nan), "radius is nan"),
    "radius a word": (lambda: Proxy(ball(), radius="8 mm"), "radius is '8 mm'"),  # type: ignore[arg-type]
    "stiffness": (lambda: Proxy(ball(), stiffness=-1.0), "stiffness is -1.0"),
    "friction": (lambda: Proxy(ball(), static_friction=-0.1), "static_friction is -0.1"),
    "friction the wrong way round": (lambda: Proxy(ball(), static_friction=0.3, dynamic_friction=0.5), "dynamic_friction is 0.5"),
    "a hip of two": (lambda: Proxy(ball()).step([1, 2]), r"hip has shape \(2,\)"),
    "hips in a row": (lambda: Proxy(ball()).step([[0, 0, 0]]), "hip has shape"),
    "a path that is a point": (lambda: Proxy(ball()).follow([0, 0, 0]), "hips has shape"),
    "a reset to a word": (lambda: Proxy(ball()).reset("home"), "hip is not an array of numbers"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused_names_the_argument(name: str) -> None:
    call, words = REFUSED[name]
    with pytest.raises(ValueError, match=words):
        call()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_hip_that_is_no_place_changes_nothing(bad: float) -> None:
    proxy = Proxy(ball(), radius=0.01)
    proxy.reset([0.0, 0.0, 0.1])
    before, where = proxy.step([0.0, 0.0, 0.05]), proxy.position
    for move in (proxy.step, lambda hip: proxy.follow([hip])[0]):
        assert proxy.in_contact
        np.testing.assert_array_equal(move([bad, 0.0, 0.0]), 0.0)
        assert not proxy.in_contact
        np.testing.assert_array_equal(proxy.position, where)
        np.testing.assert_array_equal(proxy.step([0.0, 0.0, 0.05]), before)


def test_it_is_imported_alone() -> None:
    """Without scenes, devices, XML or trimesh."""
    code = """import sys, itouch.contact
heavy = [name for name in ("lxml", "trimesh", "rich", "pyglet", "itouch.scene", "itouch.plugin", "itouch.loop")
         if name in sys.modules]
sys.exit(repr(heavy) if heavy else 0)"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
