"""How large a mesh file may be: triangles, vertices, values."""

from __future__ import annotations

from itouch.contact.meshfile.faults import MeshError

#: Greatest number of triangles in a file.
MAX_FACES = 4_000_000
#: Greatest number of vertices that a file may declare.
MAX_VERTICES = 3 * MAX_FACES
#: The same for text formats, whose parsers take about a hundred bytes per vertex.
MAX_TEXT_VERTICES = 4_000_000
#: Greatest number of values in the JSON of a glTF, and greatest number of its nodes.
MAX_JSON_VALUES, MAX_NODES = 4_000_000, 100_000


def too_many_vertices(shown: str, count: int, most: int = MAX_VERTICES) -> MeshError:
    """Return the error for a file that has, or declares, too many vertices."""
    sentence = f"'{shown}' has {count} vertices or more; the limit is {most}"
    return MeshError("mesh-too-large", sentence, "join vertices that are given twice, or save it in a binary format")


def too_many_faces(shown: str, count: int) -> MeshError:
    """Return the error for a file that has, or declares, too many triangles."""
    sentence = f"'{shown}' has {count} triangles or more; the limit is {MAX_FACES}"
    advice = "simplify it: a finger feels nothing finer than a tenth of a millimetre"
    return MeshError("mesh-too-large", sentence, advice)
