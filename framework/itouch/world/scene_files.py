"""The files that a scene names besides XML: read once, from its folder or from a session, and kept for sessions."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from itouch.contact.meshfile.faults import MeshError
from itouch.scene import Scene

if TYPE_CHECKING:
    from itouch.contact.meshfile import MeshFile


#: Greatest size of all files of a scene together [bytes]; they are kept in memory for sessions.
MOST_BYTES = 1 << 30


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A file that a scene names, complete in itself.

    Attributes
    ----------
    file
        Its name as the scene has it, relative to the scene's folder.
    data
        Its content; for a glTF that refers to other files, the same glTF with their content embedded.
    digest
        SHA-256 of ``data``, hexadecimal.
    """

    file: str
    data: bytes = field(repr=False)
    digest: str


class SceneFiles:
    """Reads the files of one scene, each once."""

    __slots__ = ("_known", "_scene")

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._known: dict[str, SceneFile] = {}

    def mesh(self, file: str) -> MeshFile:
        """Read a mesh file.

        Raises
        ------
        MeshError
            If it is missing, outside the scene's folder, too large, or of another format.
        """
        from itouch.contact.meshfile.mesh_bytes import MeshFile, read_mesh_file

        if file in self._known:
            known = self._known[file]
            return MeshFile(file, known.data, known.digest)
        if self._scene.files is not None:
            found = MeshFile.of(file, self._given(file))
        else:
            path = os.path.join(self._scene.folder, file)
            found = read_mesh_file(path, folder=self._scene.folder, name=file)
        self._keep(SceneFile(file, found.data, found.digest))
        return found

    def read(self, file: str, most: int) -> bytes:
        """Read any other file, of at most ``most`` bytes.

        Raises
        ------
        MeshError
            If it is missing, outside the scene's folder, or too large.
        """
        from itouch.contact.meshfile.mesh_bytes import read_inside

        if file not in self._known:
            if self._scene.files is not None:
                data = self._given(file)
            else:
                root = os.path.realpath(self._scene.folder)
                data = read_inside(os.path.join(root, file), root, file, most)
            self._keep(SceneFile(file, data, hashlib.sha256(data).hexdigest()))
        return self._known[file].data

    def all(self) -> tuple[SceneFile, ...]:
        """Return the files that were read, sorted by name."""
        return tuple(self._known[name] for name in sorted(self._known))

    def _keep(self, found: SceneFile) -> None:
        total = sum(len(other.data) for other in self._known.values()) + len(found.data)
        if total > MOST_BYTES:
            sentence = f"the files of the scene take more than {MOST_BYTES >> 20} MiB together"
            raise MeshError("mesh-too-large", sentence, "leave some out, or make them smaller")
        self._known[found.file] = found

    def _given(self, file: str) -> bytes:
        files = self._scene.files or {}
        if file not in files:
            raise MeshError("no-such-file", f"the session does not hold '{file}'", "it was written by another program")
        return files[file]


def contents(files: Iterable[SceneFile]) -> dict[str, bytes]:
    """Return file name -> content, as ``itouch.scene.loads(..., files=...)`` takes it."""
    return {file.file: file.data for file in files}
