"""How large a mesh may be."""

from __future__ import annotations

from itouch.contact.meshfile.faults import MeshError

#: Greatest number of triangles in a file.
MAX_FACES = 4_000_000
#: Greatest number of vertices that a file may announce.
MAX_VERTICES = 3 * MAX_FACES


def too_many_faces(shown: str, count: int) -> MeshError:
    """Say that a file has, or says that it has, too many triangles."""
    sentence = f"'{shown}' has {count} triangles or more; the most is {MAX_FACES}"
    advice = "simplify it: a finger feels nothing finer than a tenth of a millimetre"
    return MeshError("mesh-too-large", sentence, advice)
