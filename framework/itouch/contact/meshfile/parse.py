"""From the bytes of a mesh file to triangles, by trimesh for most formats."""

from __future__ import annotations

import io
import logging
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.contact.meshfile.faults import MeshError
from itouch.contact.meshfile.gltf import read_gltf
from itouch.contact.meshfile.mesh_bytes import MeshFile
from itouch.contact.meshfile.ply import read_header, read_polygons
from itouch.contact.meshfile.polygons import fans
from itouch.contact.meshfile.preflight import checked, pieces
from itouch.contact.meshfile.size_limits import MAX_FACES, too_many_faces

#: What Python says of a word that is no number.
_NO_NUMBER = re.compile(r"(?:invalid literal for int\(\) with base 10|could not convert string to float): b?'([^']*)'")
_LOADERS = {"stl": "load_stl", "ply": "load_ply", "off": "load_off", "obj": "load_obj"}


@dataclass(frozen=True, slots=True)
class Triangles:
    """Triangles as a file has them, in its units.

    Attributes
    ----------
    vertices
        (n, 3), not necessarily finite.
    faces
        (m, 3) indices of existing vertices.
    left_out
        How many primitives of points or lines the file also has.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    left_out: int = 0


def parse(source: MeshFile) -> Triangles:
    """Read the triangles of a mesh file; several parts are joined into one list.

    Raises
    ------
    MeshError
        If it is damaged, too large, or has no triangles.
    """
    left_out = 0
    if source.kind in ("glb", "gltf"):
        parts, left_out = read_gltf(source.data, source.file, binary=source.kind == "glb")
    else:
        parts = list(_loaded(source.data, source.kind, source.file))
    count = sum(len(faces) for _, faces in parts)
    if count == 0:
        raise MeshError("mesh-empty", f"'{source.file}' holds no triangles", "points and lines can't be touched")
    if count > MAX_FACES:
        raise too_many_faces(source.file, count)
    firsts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    faces = np.concatenate([faces + first for (_, faces), first in zip(parts, firsts, strict=False)])
    return Triangles(vertices, faces, left_out)


@contextmanager
def _unlogged() -> Iterator[None]:
    """Keep trimesh from logging tracebacks of errors that it recovers from, such as normals that cannot be read."""
    log, nowhere = logging.getLogger("trimesh"), logging.NullHandler()
    before, log.propagate = log.propagate, False
    log.addHandler(nowhere)
    try:
        yield
    finally:
        log.removeHandler(nowhere)
        log.propagate = before


def _loaded(data: bytes, kind: str, shown: str) -> Iterator[tuple[NDArray[np.float64], NDArray[np.int64]]]:
    loader: Any = getattr(import_module(f"trimesh.exchange.{kind}"), _LOADERS[kind])
    more = {"skip_materials": True} if kind == "obj" else {}
    try:
        for piece in pieces(checked(data, kind, shown), kind):
            with warnings.catch_warnings(), _unlogged():
                warnings.simplefilter("error")  # NumPy only warns of a number that cannot be read
                loaded = loader(io.BytesIO(piece), **more) if kind != "ply" else _ply(loader, piece)
            for part in loaded["geometry"].values() if "geometry" in loaded else [loaded]:
                if part.get("faces") is not None and len(part["faces"]):
                    yield _part(part)
    except MeshError:
        raise
    except Exception as error:  # on untrusted bytes a parser may raise anything
        reason = _plainly(error)
        sentence = f"'{shown}' is not a valid {kind.upper()} file: {reason}"
        raise MeshError("mesh-damaged", sentence, "is it complete? export it again") from None


def _plainly(error: Exception) -> str:
    """Return what a parser's error means to people; what it says itself where that is not known."""
    said = " ".join(str(error).split())[:120]
    if isinstance(error, IndexError) or "out of bounds" in said:
        return "a face names a corner that the file does not have, or a line is too short"
    if found := _NO_NUMBER.search(said):
        return f"'{found.group(1)}' stands where a number must be"
    if "unmatched data" in said:
        return "a word stands where a number must be"
    if any(word in said for word in ("reshape", "broadcast", "inhomogeneous", "buffer size")):
        return "it has more or fewer numbers than it says"
    return said if said and isinstance(error, ValueError) else "what it holds contradicts itself"


def _ply(loader: Any, data: bytes) -> dict[str, Any]:
    """Read a PLY by trimesh; read one with polygons of several sizes, which trimesh takes for damaged, without it."""
    try:
        loaded: dict[str, Any] = loader(io.BytesIO(data), skip_materials=True)
        return loaded
    except Exception:
        header = read_header(data)
        if not header.order:
            raise
        vertices, faces = read_polygons(data, header)
        return {"vertices": vertices, "faces": faces}


def _part(part: dict[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    vertices, faces = np.asarray(part["vertices"], np.float64), np.asarray(part["faces"]).astype(np.int64)
    if faces.ndim == 2 and faces.shape[1] > 3:
        faces = fans(np.full(len(faces), faces.shape[1]), faces.ravel())
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise ValueError("its vertices or faces have not three columns")
    if faces.min() < 0 or faces.max() >= len(vertices):
        wrong = int(faces.min()) if faces.min() < 0 else int(faces.max())
        raise ValueError(f"a face names vertex {wrong} of {len(vertices)}")
    return vertices, faces
