"""glTF 2.0 and its binary form GLB: the triangles of the scene, placed by its nodes; nothing else is read.

They are read here and not by trimesh, because an untrusted file must be checked before it is followed: counts against
the bytes that are there, nodes against cycles, references against the folder. Once all that is checked, little is left
for another reader; and trimesh 5.2 leaves out fans, sparse values, normalized integers and nodes without a scene.
Materials, images and extensions stay unread.
The format: Khronos Group, glTF 2.0 Specification, 2021.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from itouch.contact.meshfile.accessors import Accessors, item
from itouch.contact.meshfile.faults import MeshError
from itouch.contact.meshfile.size_limits import MAX_FACES, MAX_JSON_VALUES, MAX_NODES, too_many_faces

Floats = NDArray[np.float64]
Faces = NDArray[np.int64]
Primitive = tuple[Floats, Faces]

_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_GEOMETRY = ("asset", "buffers", "bufferViews", "accessors", "meshes", "nodes", "scenes", "scene", "extensionsRequired")
_COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_BROKEN = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError, struct.error)


def embedded(data: bytes, shown: str, fetch: Callable[[str], bytes]) -> bytes:
    """Return a .gltf with the buffers from other files embedded in it; without such files, return it as it is.

    Raises
    ------
    MeshError
        If it is damaged, or ``fetch`` refuses a file.
    """
    try:
        document = _document(data)
        outside = [b for b in document.get("buffers", ()) if "uri" in b and not b["uri"].startswith("data:")]
        for buffer in outside:
            content = fetch(unquote(buffer["uri"]))
            buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(content).decode()
        if not outside:
            return data
        return json.dumps({key: document[key] for key in _GEOMETRY if key in document}, sort_keys=True).encode()
    except _BROKEN as error:
        raise _damaged(shown, error) from None


def read_gltf(data: bytes, shown: str, *, binary: bool) -> tuple[list[Primitive], int]:
    """Return the triangles of each placed primitive in the file's units, and the number of primitives left out.

    Left out are primitives of points or lines.

    Raises
    ------
    MeshError
        If it is damaged, compressed, or has more than MAX_FACES triangles.
    """
    try:
        document, rest = _opened(data) if binary else (_document(data), b"")
        _check_extensions(document, shown)
        accessors = Accessors(document, _buffers(document, rest))
        return _placed(document, accessors, shown)
    except _BROKEN as error:
        raise _damaged(shown, error) from None


def _damaged(shown: str, error: Exception) -> MeshError:
    if isinstance(error, MeshError):
        return error
    reason = f"no '{error.args[0]}'" if isinstance(error, KeyError) and error.args else str(error)
    reason = "it ends too early" if isinstance(error, struct.error) else " ".join(reason.split())
    return MeshError("mesh-damaged", f"'{shown}' is not a valid glTF file: {reason[:120]}", "export it again")


def _document(data: bytes) -> dict[str, Any]:
    values = data.count(b",") + data.count(b"[") + data.count(b"{")
    if values > MAX_JSON_VALUES:
        raise ValueError(f"its JSON holds {values} values; the limit is {MAX_JSON_VALUES}")
    document = json.loads(data.decode("utf-8-sig"))
    if not isinstance(document, dict):
        raise ValueError("its outermost value is not an object")
    version = str(document["asset"]["version"])
    if version.split(".")[0] != "2":
        raise ValueError(f"it is version {version}; 2.0 can be read")
    return document


def _opened(data: bytes) -> tuple[dict[str, Any], bytes]:
    """Split a GLB into its JSON and its binary chunk."""
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF" or version != 2:
        raise ValueError("it does not begin as a GLB of version 2")
    if length > len(data):
        raise ValueError(f"it says that it has {length} bytes, and has {len(data)}")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise ValueError(f"a chunk of {size} bytes does not fit into it")
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    return _document(chunks[_JSON_CHUNK]), chunks.get(_BINARY_CHUNK, b"")


def _check_extensions(document: dict[str, Any], shown: str) -> None:
    found = [name for name in _COMPRESSED if name in document.get("extensionsRequired", ())]
    if found:
        sentence = f"'{shown}' is compressed by {found[0]}, which is not read"
        raise MeshError("mesh-format", sentence, "export it without compression")


def _buffers(document: dict[str, Any], rest: bytes) -> list[bytes]:
    found = []
    for index, buffer in enumerate(document.get("buffers", ())):
        uri = buffer.get("uri")
        if uri is None:
            content = rest if index == 0 else b""
        elif uri.startswith("data:") and ";base64," in uri[:200]:
            content = base64.b64decode(uri.split(";base64,", 1)[1], validate=True)
        else:
            raise ValueError(f"a buffer is in another file, '{uri[:60]}'; only a .gltf may refer to files")
        if len(content) < int(buffer["byteLength"]):
            raise ValueError(f"buffer {index} has {len(content)} bytes and should have {buffer['byteLength']}")
        found.append(content)
    return found


def _placed(document: dict[str, Any], accessors: Accessors, shown: str) -> tuple[list[Primitive], int]:
    meshes: dict[int, list[Primitive]] = {}
    placed: list[Primitive] = []
    left_out = faces = 0
    for index, matrix in placed_meshes(document):
        if index not in meshes:
            primitives = item(document["meshes"], index)["primitives"]
            meshes[index] = list(_primitives(primitives, accessors))
            left_out += sum(p.get("mode", _TRIANGLES) < _TRIANGLES for p in primitives)
        faces += sum(len(corners) for _, corners in meshes[index])
        if faces > MAX_FACES:
            raise too_many_faces(shown, faces)
        mirrored = np.linalg.det(matrix[:3, :3]) < 0.0
        for vertices, corners in meshes[index]:
            moved = vertices @ matrix[:3, :3].T + matrix[:3, 3]
            placed.append((moved, corners[:, ::-1] if mirrored else corners))
    return placed, left_out


def _primitives(primitives: list[dict[str, Any]], accessors: Accessors) -> Iterator[Primitive]:
    faces = 0
    for primitive in primitives:
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            continue
        positions = accessors.read(primitive["attributes"]["POSITION"], columns=3)
        if "indices" in primitive:
            order = accessors.read(primitive["indices"], columns=1)[:, 0].astype(np.int64)
        else:
            order = np.arange(len(positions))
        faces += len(order)
        if faces > 3 * MAX_FACES:
            raise ValueError(f"a mesh has more than {MAX_FACES} triangles")
        corners = _corners(order, mode)
        if corners.size and (corners.min() < 0 or corners.max() >= len(positions)):
            raise ValueError(f"a triangle names vertex {int(corners.max())} of {len(positions)}")
        # Primitives often share one long list of vertices: keep only those that this one uses.
        used, compact = np.unique(corners, return_inverse=True)
        yield positions[used].astype(np.float64), compact.reshape(-1, 3)


def _corners(order: NDArray[np.int64], mode: int) -> Faces:
    if mode == _TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    count = max(0, len(order) - 2)
    first, second, third = order[:count], order[1 : count + 1], order[2 : count + 2]
    if mode == _FAN:
        return np.stack([np.repeat(order[:1], count), second, third], axis=1)
    odd = np.arange(count) % 2 == 1  # every second triangle of a strip is wound the other way
    return np.stack([first, np.where(odd, third, second), np.where(odd, second, third)], axis=1)


def placed_meshes(document: dict[str, Any]) -> Iterator[tuple[int, Floats]]:
    """Yield each placed mesh's index with the matrix (4, 4) from its frame to the scene's, parents before children.

    Without a scene every root node is placed; without nodes every mesh is placed once, in its own frame.

    Raises
    ------
    ValueError, KeyError, TypeError
        If the nodes do not form trees, or a node's transform is not valid.
    """
    nodes = document.get("nodes", [])
    if len(nodes) > MAX_NODES:
        raise ValueError(f"it has {len(nodes)} nodes; the limit is {MAX_NODES}")
    if not nodes:
        yield from ((index, np.eye(4)) for index in range(len(document.get("meshes", []))))
        return
    stack = [(root, np.eye(4)) for root in reversed(_roots(document, nodes))]
    met: set[int] = set()
    while stack:
        index, above = stack.pop()
        node = item(nodes, index)
        if index in met:
            raise ValueError(f"node {index} has two parents, or is its own")
        met.add(index)
        matrix = above @ _matrix(node)
        if "mesh" in node:
            yield int(node["mesh"]), matrix
        stack += [(child, matrix) for child in reversed(node.get("children", []))]


def _roots(document: dict[str, Any], nodes: list[dict[str, Any]]) -> list[int]:
    if document.get("scenes"):
        return list(item(document["scenes"], document.get("scene", 0)).get("nodes", []))
    children = {child for node in nodes for child in node.get("children", ())}
    return [index for index in range(len(nodes)) if index not in children]


def _matrix(node: dict[str, Any]) -> Floats:
    """Return a node's own transform: T R S, or the matrix that the file gives column by column."""
    if "matrix" in node:
        matrix = np.array(node["matrix"], np.float64).reshape(4, 4).T
    else:
        matrix = np.eye(4)
        matrix[:3, :3] = _rotation(node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
        matrix[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)), np.float64).reshape(1, 3)
        matrix[:3, 3] = np.array(node.get("translation", (0.0, 0.0, 0.0)), np.float64).reshape(3)
    if not np.isfinite(matrix).all():
        raise ValueError("a node's transform is not finite")
    return matrix


def _rotation(quaternion: Any) -> Floats:
    """Return the matrix of a quaternion x y z w."""
    x, y, z, w = np.array(quaternion, np.float64).reshape(4)
    size = x * x + y * y + z * z + w * w
    if not 0.0 < size < np.inf:
        raise ValueError("a node's rotation is not a quaternion")
    s = 2.0 / size
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
    )
