"""From a mesh file to a surface that can be touched: read, checked, repaired, and cached."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

import numpy as np

from itouch.contact.mesh_surface import Surface
from itouch.contact.meshfile import cache
from itouch.contact.meshfile.faults import MeshError, MeshFinding
from itouch.contact.meshfile.findings import check_size, findings
from itouch.contact.meshfile.mesh_bytes import MeshFile, read_mesh_file
from itouch.contact.meshfile.parse import parse
from itouch.contact.meshfile.repair import MeshFacts, check_finite, repaired


@dataclass(frozen=True, slots=True)
class LoadedMesh:
    """A surface loaded from a file.

    Attributes
    ----------
    surface
        The surface to be touched, in metres.
    facts
        What was found and repaired, in numbers.
    findings
        What the user should know of it.
    cached
        Whether the hierarchy came from the cache.
    """

    surface: Surface
    facts: MeshFacts
    findings: tuple[MeshFinding, ...]
    cached: bool


def load_mesh(
    path: str | os.PathLike[str], *, scale: float = 1.0, two_sided: bool = False, use_cache: bool = True
) -> LoadedMesh:
    """Load a mesh file.

    Parameters
    ----------
    path
        An STL, OBJ, PLY, GLB, glTF or OFF file.
    scale
        Length of one unit of the file [m].
    two_sided
        Whether it is touched from both sides.
    use_cache
        Whether a hierarchy that was built before may be used, and this one be cached.

    Raises
    ------
    MeshError
        If it is no mesh that can be touched.
    """
    source = read_mesh_file(path)
    sides = "two" if two_sided else None
    return load_source(source, scale=scale, sides=sides, scaled=scale != 1.0, use_cache=use_cache)


def load_source(
    source: MeshFile, *, scale: float = 1.0, sides: str | None = None, scaled: bool = False, use_cache: bool = True
) -> LoadedMesh:
    """Make a surface from a mesh file's content.

    Parameters
    ----------
    source
        The file's content.
    scale
        Length of one unit of the file [m].
    sides
        "one": touched from the front; "two": from both sides; None: from the front by default, as the user did not say.
    scaled
        Whether the user gave the scale; an unusual size is then intended.
    use_cache
        Whether a hierarchy that was built before may be used, and this one be cached.

    Raises
    ------
    MeshError
        If it is no mesh that can be touched.
    """
    try:
        good = math.isfinite(scale) and scale > 0.0
    except TypeError:
        good = False
    if not good:
        raise MeshError("out-of-range", f"scale is {scale!r}; it must be a finite number above 0")
    if sides not in (None, "one", "two"):
        raise MeshError("bad-value", f"sides is {sides!r}; it must be 'one' or 'two'")
    key = cache.key(source.digest, source.kind, scale)
    kept = cache.read(key) if use_cache else None
    if kept is None:
        surface, facts = _built(source, scale)
        if use_cache:
            cache.write(key, surface, facts)
    else:
        surface, facts = kept
    told = findings(facts, source.file, sides=sides, scaled=scaled)
    return LoadedMesh(surface.seen_from(two_sided=sides == "two"), facts, told, kept is not None)


def _built(source: MeshFile, scale: float) -> tuple[Surface, MeshFacts]:
    triangles = parse(source)
    with np.errstate(over="ignore", invalid="ignore"):
        given = triangles.vertices * scale
    check_finite(given, triangles.faces, source.file)
    used = given[triangles.faces]
    check_size(used.min(axis=(0, 1)), used.max(axis=(0, 1)), source.file)
    vertices, faces, facts = repaired(given, triangles.faces, source.file, left_out=triangles.left_out)
    return Surface(vertices, faces), facts
