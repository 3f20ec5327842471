"""What is said of a mesh file, against manifold3d: which bodies are closed, how large they are, and which overlap."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
from meshfiles import BOX, Faces, Floats, ply
from random_meshes import KINDS

from itouch.contact.meshfile import LoadedMesh, MeshFile, load_source
from itouch.contact.meshfile.volume import signed_volumes

CLOSED = [kind for kind in KINDS if kind != "terrain"]


@pytest.fixture(autouse=True)
def _no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ITOUCH_MESH_CACHE", "off")


def body(vertices: Floats, faces: Faces) -> manifold3d.Manifold:
    return manifold3d.Manifold(manifold3d.Mesh(vertices.astype(np.float32), faces.astype(np.uint32)))


def loaded(vertices: Floats, faces: Faces) -> LoadedMesh:
    return load_source(MeshFile.of("a.ply", ply(vertices, faces)))


def used(mesh: LoadedMesh) -> tuple[Floats, Faces]:
    return mesh.surface.vertices, mesh.surface.faces


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", CLOSED)
def test_what_we_call_solid_is_a_body_of_the_same_volume(kind: str, seed: int) -> None:
    vertices, faces = KINDS[kind](np.random.default_rng(seed))
    mesh = loaded(vertices, faces)
    assert mesh.surface.is_solid and mesh.facts.open_edges == 0
    oracle = body(*used(mesh))
    assert oracle.status() == manifold3d.Error.NoError
    points, corners = used(mesh)
    volume = signed_volumes(points, corners, np.zeros(len(corners), np.int64))[0] / 6.0
    assert volume == pytest.approx(oracle.volume(), rel=1e-4)
    assert mesh.facts.parts >= len(oracle.decompose()) >= 1


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", CLOSED)
def test_a_hole_and_turned_faces_are_found_by_both_and_turned_faces_are_mended(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, faces = KINDS[kind](rng)
    holed = np.delete(faces, rng.integers(len(faces)), axis=0)
    assert body(vertices, holed).status() == manifold3d.Error.NotManifold
    assert loaded(vertices, holed).facts.open_edges == 3
    turned = faces.copy()
    some = rng.choice(len(faces), 3, replace=False)
    turned[some] = turned[some][:, ::-1]
    assert body(vertices, turned).status() == manifold3d.Error.NotManifold
    mesh = loaded(vertices, turned)
    assert mesh.facts.turned_faces == 3 and mesh.surface.is_solid
    assert body(*used(mesh)).status() == manifold3d.Error.NoError


@pytest.mark.parametrize("seed", range(40))
def test_boxes_reach_into_one_another_where_they_share_volume(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = (
        BOX[0],
        BOX[0] * rng.uniform(0.5, 1.0, 3) + rng.uniform(-1.0, 1.0, 3) * rng.choice([0.3, 1.2]) * (1.0, 0.5, 0.25),
    )
    shared = (body(first, BOX[1]) ^ body(second, BOX[1])).volume()
    facts = loaded(np.vstack([first, second]), np.vstack([BOX[1], BOX[1] + len(first)])).facts
    assert facts.parts == 2
    if shared == 0.0:
        assert facts.overlapping == 0
    elif shared > 0.02:
        assert facts.overlapping == 1
