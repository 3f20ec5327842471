"""What is repaired in a mesh, what is only told, and that repairs change nothing that can be felt."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshfiles import obj, off, ply, stl
from probing import Floats, box_mesh, grid, winding

from itouch.contact.meshfile import LoadedMesh, MeshError, MeshFile, MeshFinding, load_source
from itouch.contact.meshfile.repair import repaired
from itouch_evidence.contact.contact_workload import icosphere

BALL = icosphere(2, 0.05)


@pytest.fixture(autouse=True)
def _no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ITOUCH_MESH_CACHE", "off")


def load(vertices: Floats, faces: Floats, sides: str | None = None, scaled: bool = False) -> LoadedMesh:
    return load_source(MeshFile.of("mesh.ply", ply(vertices, np.asarray(faces))), sides=sides, scaled=scaled)


def told(mesh: LoadedMesh) -> dict[str, MeshFinding]:
    return {finding.code: finding for finding in mesh.findings}


def joined(*parts: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    firsts = np.cumsum([0, *(len(v) for v, _ in parts)])
    return np.concatenate([v for v, _ in parts]), np.concatenate(
        [f + n for (_, f), n in zip(parts, firsts, strict=False)]
    )


def test_a_sound_mesh_is_left_as_it_is() -> None:
    vertices, faces, facts = repaired(BALL[0], BALL[1].astype(np.int64), "a.ply")
    np.testing.assert_array_equal(vertices, BALL[0])
    np.testing.assert_array_equal(faces, BALL[1])
    assert (facts.edges, facts.open_edges, facts.closed_parts, facts.overlapping) == (480, 0, 1, 0)
    assert not load(*BALL).findings


def test_vertices_given_more_than_once_are_joined() -> None:
    soup = BALL[0][BALL[1]].reshape(-1, 3)
    mesh = load(soup, np.arange(len(soup)).reshape(-1, 3))
    assert mesh.facts.joined_vertices == 3 * 320 - 162
    assert mesh.surface.is_solid
    assert "798 vertices" in told(mesh)["mesh-joined"].sentence
    text = MeshFile.of("mesh.stl", stl(*BALL))
    assert not load_source(text).findings  # an STL has no other way


def test_minus_zero_is_zero() -> None:
    vertices, faces = box_mesh(0.1, 0.1, 0.1)
    vertices = vertices + 0.1
    soup = vertices[faces].reshape(-1, 3)
    soup[::2][soup[::2] == 0.0] = -0.0
    assert load(soup, np.arange(36).reshape(12, 3)).facts.open_edges == 0


@pytest.mark.parametrize("size", [1e-3, 0.1, 9.0])
def test_seams_that_rounding_has_opened_are_sewn(size: float) -> None:
    vertices, faces = BALL[0] * size / 0.1, BALL[1]
    upper = vertices[faces].mean(axis=1)[:, 2] > 0
    rng = np.random.default_rng(1)
    halves = [(vertices + rng.uniform(-5e-7, 5e-7, vertices.shape) * size, faces[side]) for side in (upper, ~upper)]
    mesh = load(*joined(*halves), scaled=True)
    assert mesh.facts.open_edges == 0
    assert mesh.facts.joined_seams > 20
    assert mesh.facts.parts == 1
    assert mesh.surface.is_solid
    assert "along seams" in told(mesh)["mesh-joined"].sentence
    apart = [(vertices + shift * size, faces[side]) for shift, side in ((0.0, upper), (1e-4, ~upper))]
    assert load(*joined(*apart), scaled=True).facts.joined_seams == 0


def test_triangles_twice_and_without_area_are_removed() -> None:
    vertices, faces = BALL
    more = np.concatenate([faces, faces[:5], np.roll(faces[7:9], 1, axis=1), [[3, 3, 4]], [[5, 6, 5]]])
    mesh = load(vertices, more)
    assert (mesh.facts.repeated, mesh.facts.collapsed, mesh.facts.triangles) == (7, 2, 320)
    assert mesh.surface.is_solid
    assert told(mesh)["mesh-repeated"].severity == "note"
    assert "2 triangles without area" in told(mesh)["mesh-degenerate"].sentence


def test_a_back_is_not_a_repetition() -> None:
    vertices, faces = grid(2)
    mesh = load(vertices, np.concatenate([faces, faces[:, ::-1]]), "one")
    assert mesh.facts.repeated == 0
    assert mesh.facts.triangles == 16


def test_a_sliver_is_removed_unless_it_closes_the_surface() -> None:
    vertices, faces = grid(2)
    stray = np.concatenate([vertices, [[5.0, 0, 0], [6, 0, 0], [7, 0, 0]]])
    mesh = load(stray, np.concatenate([faces, [[9, 10, 11]]]), "one")
    assert (mesh.facts.flat, mesh.facts.kept_flat) == (1, 0)
    box, corners = box_mesh(0.1, 0.1, 0.1)
    a, b, c = corners[0]
    middle = len(box)
    box = np.concatenate([box, [(box[a] + box[b]) / 2]])
    split = np.concatenate([corners[1:], [[a, middle, c], [middle, b, c], [a, b, middle]]])
    closed = load(box, split)
    assert (closed.facts.flat, closed.facts.kept_flat, closed.facts.open_edges) == (0, 1, 0)
    assert closed.surface.is_solid


@given(st.lists(st.integers(0, 319), min_size=1, max_size=120, unique=True))
@settings(max_examples=25, deadline=None)
def test_mixed_winding_is_made_one(turned: list[int]) -> None:
    faces = BALL[1].copy()
    faces[turned] = faces[turned][:, ::-1]
    mesh = load(BALL[0], faces)
    assert mesh.surface.is_solid
    assert winding(mesh.surface, np.zeros(3)) == pytest.approx(1.0)
    assert mesh.facts.turned_faces == len(turned)


def test_an_inside_out_ball_is_turned_but_not_a_cavity() -> None:
    vertices, faces = BALL
    inverted = load(vertices, faces[:, ::-1])
    assert inverted.facts.turned_parts == 1
    assert told(inverted)["mesh-inverted"].severity == "note"
    assert winding(inverted.surface, np.zeros(3)) == pytest.approx(1.0)
    hollow = load(*joined((vertices, faces), (vertices * 0.5, faces[:, ::-1])))
    assert (hollow.facts.turned_parts, hollow.facts.overlapping) == (0, 0)
    assert winding(hollow.surface, np.zeros(3)) == pytest.approx(0.0, abs=1e-9)
    assert winding(hollow.surface, np.array([0.0, 0.0, 0.04])) == pytest.approx(1.0)
    beside = load(*joined((vertices, faces), (vertices + 1.0, faces[:, ::-1])))
    assert beside.facts.turned_parts == 1


def test_a_foam_keeps_its_cavities_and_a_heap_of_inverted_parts_is_turned() -> None:
    bubble = (
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 1e-3,
        np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]),
    )
    places = np.stack(np.meshgrid(*[np.linspace(-0.02, 0.02, 7)] * 3), -1).reshape(-1, 3)
    bubbles = [(bubble[0] + place, bubble[1]) for place in places]
    foam = load(*joined(BALL, *bubbles))
    assert (foam.facts.parts, foam.facts.turned_parts, foam.facts.overlapping) == (344, 0, 0)
    heap = load(*joined((BALL[0] + 1.0, BALL[1]), *bubbles))
    assert heap.facts.turned_parts == 343


def test_parts_that_reach_into_one_another_are_told() -> None:
    apart = load(*joined(BALL, (BALL[0] + 0.2, BALL[1])))
    assert (apart.facts.parts, apart.facts.overlapping) == (2, 0)
    over = load(*joined(BALL, (BALL[0] + 0.03, BALL[1]), (BALL[0] - 0.03, BALL[1])))
    assert (over.facts.parts, over.facts.overlapping) == (3, 2)
    assert told(over)["mesh-overlap"].severity == "warning"
    within = load(*joined(BALL, (BALL[0] * 0.5, BALL[1])))
    assert within.facts.overlapping == 1


def test_bars_that_cross_have_no_corner_in_each_other_and_are_told() -> None:
    along, across = box_mesh(0.06, 0.02, 0.02), box_mesh(0.02, 0.06, 0.02)
    flush = load(*joined(along, across))
    assert flush.facts.overlapping == 1
    assert told(flush)["mesh-overlap"].severity == "warning"
    sunk = load(*joined(along, (across[0] + (0.007, 0.003, 0.039), across[1])))
    assert sunk.facts.overlapping == 1
    lying = load(*joined(along, (across[0] + (0.007, 0.003, 0.04 - 1e-9), across[1])))
    assert lying.facts.overlapping == 0


def test_a_ball_in_a_cavity_reaches_into_nothing() -> None:
    vertices, faces = BALL
    rattle = load(*joined(BALL, (vertices * 0.8, faces[:, ::-1]), (vertices * 0.3, faces)))
    assert (rattle.facts.closed_parts, rattle.facts.turned_parts, rattle.facts.overlapping) == (3, 0, 0)
    stuck = load(*joined(BALL, (vertices * 0.8, faces[:, ::-1]), (vertices * 0.3 + 0.65 * vertices[0], faces)))
    assert stuck.facts.overlapping == 1


def test_an_open_surface_is_legitimate_and_a_hole_is_told() -> None:
    sheet = load(*grid(4))
    assert told(sheet)["mesh-open"].severity == "note"
    assert (sheet.facts.open_edges, sheet.facts.open_length) == (16, pytest.approx(4.0))
    torn = load(BALL[0], BALL[1][:-1])
    assert told(torn)["mesh-open"].severity == "warning"
    assert "3 open edges" in told(torn)["mesh-open"].sentence
    assert told(load(BALL[0], BALL[1][:-1], "one"))["mesh-open"].severity == "note"
    both = load(BALL[0], BALL[1][:-1], "two")
    assert both.surface.two_sided
    assert "both sides" in told(both)["mesh-open"].advice


def test_three_triangles_at_an_edge_are_told() -> None:
    vertices, faces = grid(2)
    a, b = faces[0, 0], faces[0, 2]  # a diagonal, with two triangles
    wing = np.concatenate([vertices, [[0.0, 0.0, 1.0]]])
    mesh = load(wing, np.concatenate([faces, [[a, b, 9]]]), "two")
    assert mesh.facts.crowded_edges == 1
    assert told(mesh)["mesh-crowded-edges"].severity == "warning"


def test_a_moebius_band_has_no_front() -> None:
    turns, cells = np.linspace(0, 2 * np.pi, 40, endpoint=False), np.arange(40)
    rows = [
        np.stack([(1 + s * np.cos(turns / 2)) * np.cos(turns), (1 + s * np.cos(turns / 2)) * np.sin(turns), s * np.sin(turns / 2)], 1)
        for s in (-0.2, 0.2)
    ]  # fmt: skip
    low, high = cells, cells + 40
    after_low = np.where(cells == 39, 40, cells + 1)
    after_high = np.where(cells == 39, 0, cells + 41)
    faces = np.concatenate([np.stack([low, after_low, high], 1), np.stack([after_low, after_high, high], 1)])
    mesh = load(np.concatenate(rows), faces)
    assert mesh.facts.one_sided > 0
    assert told(mesh)["mesh-winding"].severity == "warning"
    assert told(load(np.concatenate(rows), faces, "two"))["mesh-winding"].severity == "note"


def test_unused_vertices_may_be_anything() -> None:
    vertices = np.concatenate([BALL[0], [[np.nan, 0, 0], [np.inf, 0, 0]]])
    mesh = load(vertices, BALL[1])
    assert mesh.facts.unused_bad == 2
    assert told(mesh)["mesh-not-finite"].severity == "note"
    assert mesh.surface.bound < 1.0


@pytest.mark.parametrize(("size", "words"), [(60.0, 'millimetres? use scale="0.001"'), (2e-4, "twice")])
def test_suspicious_units_are_told_unless_a_scale_was_given(size: float, words: str) -> None:
    vertices = BALL[0] / 0.1 * size
    finding = told(load(vertices, BALL[1]))["mesh-units"]
    assert finding.severity == "warning"
    assert words in finding.advice
    assert "mesh-units" not in told(load(vertices, BALL[1], scaled=True))


@pytest.mark.parametrize("size", [1e-3, 0.1, 9.9])
def test_sizes_of_a_fingers_world_are_not_suspicious(size: float) -> None:
    assert not load(BALL[0] / 0.1001 * size * 1.001, BALL[1]).findings


def test_too_large_is_refused_even_with_a_scale() -> None:
    with pytest.raises(MeshError, match="150 m long"):
        load(BALL[0] / 0.1 * 150.0, BALL[1], scaled=True)


@given(st.integers(0, 2**31), st.floats(1e-3, 10.0))
@settings(max_examples=20, deadline=None)
def test_mends_leave_the_shape_where_it_is(seed: int, size: float) -> None:
    """A surface with every fault that is repaired feels like the sound one, in any format."""
    rng = np.random.default_rng(seed)
    vertices, faces = BALL[0] / 0.1 * size, BALL[1].astype(np.int64)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    vertices = np.round(vertices @ (q * np.sign(np.linalg.det(q))), 12)
    sound = load(vertices, faces, scaled=True)
    soup = vertices[faces].reshape(-1, 3)
    corners = np.arange(len(soup)).reshape(-1, 3)
    turned = rng.random(len(corners)) < 0.3
    corners = np.where(turned[:, None], corners[:, ::-1], corners)
    corners = np.concatenate([corners, corners[:9], np.tile(corners[:4, :1], 3)])
    corners = rng.permutation(corners)
    writer = [("a.ply", ply), ("a.obj", obj), ("a.off", off)][seed % 3]
    poor = load_source(MeshFile.of(writer[0], writer[1](soup, corners)), scaled=True)
    assert poor.surface.is_solid
    assert poor.facts.triangles == 320
    points = rng.normal(size=(50, 3)) * size
    found, distance, _ = poor.surface.closest(points)
    there, right, _ = sound.surface.closest(points)
    np.testing.assert_allclose(distance, right, rtol=1e-12, atol=1e-13 * size)
    np.testing.assert_allclose(found, there, atol=1e-9 * size)
