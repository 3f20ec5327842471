"""Small mesh files of every format, written by hand."""

from __future__ import annotations

import base64
import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray
from probing import box_mesh

Floats = NDArray[np.float64]
Faces = NDArray[Any]


def stl(vertices: Floats, faces: Faces, *, header: bytes = b"made by hand", count: int | None = None) -> bytes:
    """Binary STL, with another count if wanted."""
    rows = b"".join(b"\0" * 12 + t.astype("<f4").tobytes() + b"\0\0" for t in vertices[faces])
    return header.ljust(80) + struct.pack("<I", len(faces) if count is None else count) + rows


def stl_text(vertices: Floats, faces: Faces) -> bytes:
    lines = ["solid made by hand"]
    for triangle in vertices[faces]:
        corners = [f"   vertex {x!r} {y!r} {z!r}" for x, y, z in triangle.tolist()]
        lines += [" facet normal 0 0 0", "  outer loop", *corners, "  endloop", " endfacet"]
    return "\n".join([*lines, "endsolid made by hand", ""]).encode()


def obj(vertices: Floats, faces: Faces) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    return "\n".join(
        ["# by hand", "mtllib none.mtl", *lines, *(f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist())]
    ).encode()


def off(vertices: Floats, faces: Faces) -> bytes:
    lines = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    return "\n".join(["OFF # by hand", f"{len(vertices)} {len(faces)} 0", *lines, ""]).encode()


def ply(vertices: Floats, faces: Faces, *, binary: bool = True, count: int | None = None) -> bytes:
    kind = "binary_little_endian" if binary else "ascii"
    head = [
        "ply", f"format {kind} 1.0", f"element vertex {len(vertices) if count is None else count}", "property double x",
        "property double y", "property double z", f"element face {len(faces)}",
        "property list uchar int vertex_indices", "end_header", "",
    ]  # fmt: skip
    if not binary:
        lines = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()] + [
            f"3 {a} {b} {c}" for a, b, c in faces.tolist()
        ]
        return ("\n".join(head) + "\n".join(lines) + "\n").encode()
    rows = b"".join(b"\x03" + f.astype("<i4").tobytes() for f in faces)
    return "\n".join(head).encode() + vertices.astype("<f8").tobytes() + rows


def gltf_document(
    vertices: Floats, faces: Faces, nodes: list[dict[str, Any]] | None = None
) -> tuple[dict[str, Any], bytes]:
    """A glTF and its buffer: one mesh, placed by nodes."""
    content = vertices.astype("<f4").tobytes() + faces.astype("<u4").tobytes()
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(content)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 12 * len(vertices)},
            {"buffer": 0, "byteOffset": 12 * len(vertices), "byteLength": 12 * len(faces)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3 * len(faces), "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": nodes or [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    return document, content


def glb_of(document: dict[str, Any], content: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    content += b"\0" * (-len(content) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(content), 0x004E4942) + content
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def glb(vertices: Floats, faces: Faces) -> bytes:
    return glb_of(*gltf_document(vertices, faces))


def gltf(vertices: Floats, faces: Faces) -> bytes:
    document, content = gltf_document(vertices, faces)
    document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(content).decode()
    return json.dumps(document).encode()


#: Name -> (end of the file's name, writer).
WRITERS = {
    "binary STL": ("stl", stl),
    "text STL": ("stl", stl_text),
    "OBJ": ("obj", obj),
    "binary PLY": ("ply", ply),
    "text PLY": ("ply", lambda v, f: ply(v, f, binary=False)),
    "OFF": ("off", off),
    "GLB": ("glb", glb),
    "glTF": ("gltf", gltf),
}

CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0.5, 0), (-1, 0.5, 0.25)]
#: Faces of several sizes over CORNERS, and how many triangles they are.
POLYGONS = {
    "triangles": ([(0, 1, 2), (0, 2, 3)], 2),
    "quads": ([(0, 1, 2, 3), (0, 3, 5, 5)], 3),
    "mixed": ([(0, 1, 2, 3), (1, 4, 2), (0, 3, 5)], 4),
    "a pentagon": ([(0, 1, 4, 2, 3), (0, 3, 5)], 4),
}


def polygon_file(kind: str, faces: list[tuple[int, ...]]) -> tuple[str, bytes]:
    """A file of polygons: its name's end, and its content."""
    rows = [" ".join(map(str, corner)) for corner in CORNERS]
    counted = [f"{len(f)} {' '.join(map(str, f))}" for f in faces]
    if kind == "OFF":
        return "off", "\n".join([f"OFF {len(rows)} {len(faces)} 0", *rows, "# faces", *counted, ""]).encode()
    if kind == "OBJ":
        lines = ["f " + " ".join(str(i + 1) for i in f) for f in faces]
        return "obj", "\n".join([*(f"v {row}" for row in rows), *lines]).encode()
    order = {"text PLY": "", "PLY, little end first": "<", "PLY, great end first": ">"}[kind]
    form = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = [
        "ply", f"format {form} 1.0", "comment by hand", f"element vertex {len(rows)}", "property float x",
        "property float y", "property float z", f"element face {len(faces)}", "property list uchar int vertex_indices",
        "end_header", "",
    ]  # fmt: skip
    if not order:
        return "ply", "\n".join(head).encode() + "\n".join([*rows, *counted]).encode()
    body = [struct.pack(f"{order}3f", *corner) for corner in CORNERS]
    body += [struct.pack(f"{order}B{len(f)}i", len(f), *f) for f in faces]
    return "ply", "\n".join(head).encode() + b"".join(body)


BOX = box_mesh(0.5, 0.25, 0.125)
