"""glTF by our reader and by trimesh's: the same triangles where both read a file, and what trimesh reads otherwise.

The second part is why our reader stays.  A case that fails there tells that trimesh reads it now: weigh it again.
"""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh
from meshfiles import Floats, glb_of, gltf_document

from itouch.contact.meshfile import MeshError, MeshFile
from itouch.contact.meshfile.parse import parse

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
FACES = np.array([[0, 1, 2], [1, 3, 2]])


def ours(data: bytes) -> Floats:
    found = parse(MeshFile.of("a.glb", data))
    return found.vertices[found.faces]


def theirs(data: bytes) -> Floats:
    mesh = trimesh.load_scene(io.BytesIO(data), file_type="glb", skip_materials=True, process=False).to_mesh()
    return np.zeros((0, 3, 3)) if mesh is None or mesh.vertices is None else np.asarray(mesh.triangles)


def sorted_triangles(triangles: Floats) -> Floats:
    """Each triangle from its first corner by coordinates, its winding kept; then all in order."""
    rounded = np.round(triangles, 5) + 0.0
    turned = [np.roll(one, -min(range(3), key=lambda k, one=one: tuple(one[k])), axis=0) for one in rounded]
    return np.array(sorted(turned, key=lambda one: tuple(one.ravel())))


def random_node(rng: np.random.Generator, meshes: int) -> dict[str, Any]:
    node: dict[str, Any] = {"mesh": int(rng.integers(meshes))} if rng.random() < 0.6 else {}
    if rng.random() < 0.2:
        matrix = np.eye(4)
        matrix[:3] = rng.normal(size=(3, 4))
        return node | {"matrix": matrix.T.ravel().tolist()}
    if rng.random() < 0.7:
        node["translation"] = rng.normal(size=3).tolist()
    if rng.random() < 0.7:
        quaternion = rng.normal(size=4)
        node["rotation"] = (quaternion / np.linalg.norm(quaternion)).tolist()
    if rng.random() < 0.7:
        node["scale"] = (rng.uniform(0.3, 3.0, 3) * rng.choice([-1.0, 1.0], 3)).tolist()
    return node


@pytest.mark.parametrize("seed", range(30))
def test_random_trees_of_nodes_stand_where_trimesh_puts_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    document, content = gltf_document(
        rng.normal(size=(20, 3)), rng.permuted(np.tile(np.arange(20), (8, 1)), axis=1)[:, :3]
    )
    document["meshes"] *= 2
    document["meshes"][1] = {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}] * 2}
    nodes = [random_node(rng, 2) for _ in range(12)]
    roots = [0]
    for index in range(1, 12):  # each under one that came before, or a root
        parent = int(rng.integers(-1, index))
        if parent < 0:
            roots.append(index)
        else:
            nodes[parent].setdefault("children", []).append(index)
    nodes[0]["mesh"] = 0
    data = glb_of(document | {"nodes": nodes, "scenes": [{"nodes": []}, {"nodes": roots}], "scene": 1}, content)
    np.testing.assert_allclose(sorted_triangles(ours(data)), sorted_triangles(theirs(data)), atol=3e-5)


Change = Callable[[dict[str, Any], bytes], bytes | None]


def fan(document: dict[str, Any], _: bytes) -> None:
    document["meshes"][0]["primitives"][0]["mode"] = 6
    document["accessors"][1]["count"] = 4


def sparse(document: dict[str, Any], content: bytes) -> bytes:
    views = [(len(content), 4), (len(content) + 4, 12)]
    document["bufferViews"] += [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in views]
    indices, values = {"bufferView": 2, "componentType": 5123}, {"bufferView": 3}
    document["accessors"][0]["sparse"] = {"count": 1, "indices": indices, "values": values}
    return content + struct.pack("<H2x3f", 3, 2.0, 2.0, 0.0)


def quantized(document: dict[str, Any], content: bytes) -> bytes:
    document["extensionsRequired"] = ["KHR_mesh_quantization"]
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(content), "byteLength": 32, "byteStride": 8})
    document["accessors"][0].update(bufferView=2, componentType=5122, normalized=True)
    return content + (np.pad(SQUARE, ((0, 0), (0, 1))) * 32767).astype("<i2").tobytes()


def no_scene(document: dict[str, Any], _: bytes) -> None:
    del document["scenes"], document["scene"]


def mesh_at_a_camera(document: dict[str, Any], _: bytes) -> None:
    document["nodes"][0]["camera"] = 0
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.01}}]


def changed(change: Change) -> bytes:
    document, content = gltf_document(SQUARE, FACES)
    content = change(document, content) or content
    document["buffers"][0]["byteLength"] = len(content)
    return glb_of(document, content)


def test_trimesh_allocates_what_a_small_file_announces_and_ours_refuses_it() -> None:
    """The page says it of 400 bytes and 60 million vertices; here a million, as memory goes with them."""
    document: dict[str, Any] = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 4, "uri": "data:application/octet-stream;base64,AAAAAA=="}],
        "bufferViews": [{"buffer": 0, "byteLength": 4}],
        "accessors": [
            {"componentType": 5126, "count": 1_000_000, "type": "VEC3"},
            {"componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
    }  # fmt: skip
    data = json.dumps(document, separators=(",", ":")).encode()
    found = trimesh.load_scene(io.BytesIO(data), file_type="gltf", process=False)
    assert [len(mesh.vertices) for mesh in found.geometry.values()] == [1_000_000]
    document["accessors"][0]["count"] = 60_000_000
    data = json.dumps(document, separators=(",", ":")).encode()
    assert len(data) <= 400
    with pytest.raises(MeshError, match="60000000 items; the limit is"):
        parse(MeshFile.of("a.gltf", data))


@pytest.mark.parametrize(
    ("change", "corner"),
    [
        (fan, (1, 1, 0)),
        (sparse, (2, 2, 0)),
        (quantized, (1, 1, 0)),
        (no_scene, (1, 1, 0)),
        (mesh_at_a_camera, (1, 1, 0)),
    ],
)
def test_what_trimesh_leaves_out_or_reads_otherwise_is_read(change: Change, corner: tuple[float, ...]) -> None:
    data = changed(change)
    mine = ours(data)
    assert len(mine) == 2
    np.testing.assert_allclose(mine.max(axis=(0, 1)), corner)
    other = theirs(data)
    assert len(other) == 0 or not np.allclose(other.max(axis=(0, 1)), corner)
