"""The proxy on its own: the forces, their accuracy, and that it never locks."""

import numpy as np
import pytest
from probing import Floats, box_mesh, grid, random_pose, rotation

from itouch.contact import Box, Mesh, Plane, Proxy, Surface
from itouch_evidence.contact.contact_workload import Work, standard

K = 1000.0
SMOOTH = [("hf", "10k"), ("hf", "100k"), ("ico", "10k"), ("ico", "100k")]


def forces(work: Work, friction: tuple[float, float]) -> tuple[Floats, Floats, Proxy]:
    """Sizes of the forces along a path, and the sizes that are right without friction."""
    surface = Surface(work.vertices, work.faces)
    proxy = Proxy(surface, radius=work.radius, stiffness=K, static_friction=friction[0], dynamic_friction=friction[1])
    size = np.linalg.norm(np.concatenate([[proxy.reset(work.hips[0])], proxy.follow(work.hips[1:])]), axis=1)
    return size, K * np.maximum(work.radius - surface.closest(work.hips)[1], 0.0), proxy


@pytest.mark.parametrize(("kind", "size"), SMOOTH)
@pytest.mark.parametrize("friction", [(0.0, 0.0), (0.5, 0.3)])
def test_on_a_brisk_path_it_never_locks_and_free_space_is_free(
    kind: str, size: str, friction: tuple[float, float]
) -> None:
    felt, right, _ = forces(standard(kind, size, 4000, 1.0, 0.02), friction)
    assert felt.max() < 2 * right.max()
    assert not felt[right == 0].any()
    assert (felt[right > 0.01] > 0).all()
    if friction[0] == 0:
        assert np.percentile(np.abs(felt - right), 99) < 0.01


@pytest.mark.parametrize(("kind", "size"), SMOOTH[:3])
@pytest.mark.parametrize("friction", [(0.0, 0.0), (0.5, 0.3)])
def test_a_point_never_locks_either(kind: str, size: str, friction: tuple[float, float]) -> None:
    work = standard(kind, size, 4000, 1.0, 0.0)
    felt, _, proxy = forces(work, friction)
    surface = proxy.geometry.world  # depth by the analytic surface, to the facets' error of about 0.1 mm
    assert surface.shape[0] == 1
    depth = K * np.maximum(-depth_of(kind, work.hips), 0.0)
    assert felt.max() < 1.3 * depth.max()
    assert felt[depth == 0].max() < 0.3


def depth_of(kind: str, hips: Floats) -> Floats:
    """Height of points above the smooth surface (the height field's along z, at most its slope's factor too big)."""
    if kind == "ico":
        return np.linalg.norm(hips, axis=1) - 0.5
    from itouch_evidence.contact.contact_workload import height

    return hips[:, 2] - height(hips[:, 0], hips[:, 1])


@pytest.mark.parametrize("scale", [1e-3, 0.1, 10.0])
def test_an_unknown_surface_in_any_place_and_scale(scale: float, rng: np.random.Generator) -> None:
    def rise(x: Floats, y: Floats) -> Floats:
        return 0.04 * np.sin(9 * x * y + 3 * x) + 0.02 * np.cos(11 * y)

    vertices, faces = grid(60)
    vertices[:, 2] = rise(vertices[:, 0], vertices[:, 1])
    turn = np.arange(2000) * 1e-3
    x, y = 0.4 * np.sin(3 * turn), 0.4 * np.cos(2.3 * turn)
    radius = 0.03
    hips = np.stack([x, y, rise(x, y) + radius + 0.015 * np.sin(5 * turn)], axis=1)
    pose = random_pose(rng, scale)
    matrix = rotation(pose[3:]).T
    work = Work(
        "unknown", vertices * scale @ matrix + pose[:3], faces, hips * scale @ matrix + pose[:3], radius * scale
    )
    felt, right, _ = forces(work, (0.0, 0.0))
    assert (right > 0).mean() > 0.3
    assert np.percentile(np.abs(felt - right), 99) < 1e-3 * K * radius * scale
    assert not felt[right == 0].any()


@pytest.mark.parametrize("radius", [0.0, 0.002, 0.008])
@pytest.mark.parametrize("way", [(0.02, 0.0, -0.004), (0.015, 0.012, -0.002)])
def test_over_the_edge_of_a_mesh_it_goes_as_over_that_of_the_box(
    radius: float, way: tuple[float, float, float]
) -> None:
    half = (0.03, 0.025, 0.02)
    start = np.array((0.02, 0.016, half[2] + radius - 0.001))
    for steps in (11, 23, 70, 230):
        hips = np.vstack([start + (0.0, 0.0, 0.005), start + np.outer(np.linspace(0.0, 1.0, steps), way)])
        box, mesh = (Proxy(shape, radius=radius).follow(hips) for shape in (Box(half), Surface(*box_mesh(*half))))
        np.testing.assert_allclose(mesh, box, atol=1e-3)  # a point stays off a mesh by its skin


def test_follow_is_step_after_step_and_goes_on_from_where_it_is() -> None:
    work = standard("hf", "10k", 600, 1.0, 0.02)
    surface = Surface(work.vertices, work.faces)
    one, other = (Proxy(surface, radius=0.02, static_friction=0.5, dynamic_friction=0.3) for _ in range(2))
    stepped = np.array([one.step(hip) for hip in work.hips])
    followed = np.concatenate([other.follow(work.hips[:250]), other.follow(work.hips[250:])])
    np.testing.assert_array_equal(stepped, followed)
    np.testing.assert_array_equal(one.position, other.position)


def test_position_normal_and_contact() -> None:
    proxy = Proxy(Plane(), radius=0.01, stiffness=500.0)
    np.testing.assert_array_equal(proxy.step([0, 0, 0.1]), 0)
    assert not proxy.in_contact
    np.testing.assert_array_equal(proxy.normal, 0)
    np.testing.assert_allclose(proxy.step(np.array([0.1, 0, 0.004])), [0, 0, 3.0])
    assert proxy.in_contact
    np.testing.assert_allclose(proxy.position, [0.1, 0, 0.01])
    np.testing.assert_allclose(proxy.normal, [0, 0, 1])


def test_the_first_step_is_a_reset_and_a_reset_forgets() -> None:
    box = Surface(*box_mesh(0.5, 0.4, 0.1))
    first, second = Proxy(box, radius=0.01), Proxy(box, radius=0.01)
    inside = [0.0, 0.0, 0.05]
    np.testing.assert_array_equal(first.step(inside), second.reset(inside))
    np.testing.assert_allclose(first.position, [0, 0, 0.11], atol=1e-9)
    first.step([0.0, 0.0, -0.09])
    np.testing.assert_allclose(first.position, [0, 0, 0.11], atol=1e-9)
    first.reset([0.0, 0.0, -0.09])
    np.testing.assert_allclose(first.position, [0, 0, -0.11], atol=1e-9)


def test_reset_in_front_of_an_open_surface_comes_out_and_behind_it_stays() -> None:
    sheet = Surface(*grid(10))
    proxy = Proxy(sheet, radius=0.05)
    proxy.reset([0.01, 0.02, 0.03])
    np.testing.assert_allclose(proxy.position, [0.01, 0.02, 0.05], atol=1e-9)
    proxy.reset([0.01, 0.02, -0.03])
    np.testing.assert_array_equal(proxy.position, [0.01, 0.02, -0.03])
    two_sided = Proxy(Surface(*grid(10), two_sided=True), radius=0.05)
    two_sided.reset([0.01, 0.02, -0.03])
    np.testing.assert_allclose(two_sided.position, [0.01, 0.02, -0.05], atol=1e-9)


def test_surfaces_and_shapes_together() -> None:
    proxy = Proxy([Surface(*grid(10)), Box((0.1, 0.6, 0.1)), Mesh(Surface(*box_mesh(0.05, 0.05, 0.3)))], radius=0.02)
    proxy.step([0.3, 0.1, 0.1])
    proxy.step([0.08, 0.1, -0.01])
    np.testing.assert_allclose(proxy.step([0.09, 0.1, 0.01]), K * np.array([0.03, 0, 0.01]), atol=1e-6)
    np.testing.assert_allclose(proxy.position, [0.12, 0.1, 0.02], atol=1e-8)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"radius": -1.0}, "radius"),
        ({"stiffness": float("nan")}, "stiffness"),
        ({"static_friction": -0.1}, "static"),
        ({"static_friction": 0.1, "dynamic_friction": 0.2}, "dynamic"),
    ],
)
def test_numbers_out_of_range_are_refused(arguments: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Proxy(Plane(), **arguments)


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="surfaces is empty"):
        Proxy([])
    proxy = Proxy(Plane())
    with pytest.raises(ValueError, match=r"hips has shape \(3,\)"):
        proxy.follow([1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match=r"hip has shape \(2,\)"):
        proxy.step([1.0, 2.0])


@pytest.mark.parametrize(("kind", "size"), [("hf", "10k"), ("ico", "10k")])
@pytest.mark.parametrize("radius", [0.0, 0.02])
def test_a_closed_loop_gives_back_no_more_energy_than_the_steps_allow(kind: str, size: str, radius: float) -> None:
    """Work of the spring along a loop, by the rule of the rectangle: at most half of the sum of |dF| |dx|."""
    work = standard(kind, size, 4000, 0.5, radius)
    there = work.hips[:1500]
    loop = np.concatenate([there, there[::-1]])
    proxy = Proxy(Surface(work.vertices, work.faces), radius=radius, stiffness=K)
    proxy.reset(loop[0])
    force = proxy.follow(loop)
    given = np.einsum("ni,ni->", force[:-1], np.diff(loop, axis=0))
    turned = np.linalg.norm(np.diff(force, axis=0), axis=1) * np.linalg.norm(np.diff(loop, axis=0), axis=1)
    assert given <= 0.5 * turned.sum() + 1e-9
