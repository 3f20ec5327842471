"""The bytes of a mesh file: read inside one folder, bounded in size, and self-contained."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable
from dataclasses import dataclass, field

from itouch.contact.meshfile.faults import MeshError
from itouch.contact.meshfile.gltf import embedded
from itouch.platforms import reading_advice

#: The file formats that are read, by the file name's extension.
KINDS = ("stl", "obj", "ply", "glb", "gltf", "off")
#: Greatest size of a file, and of all that it refers to together [bytes].
MAX_BYTES = 320 << 20

_PACKED = ((b"PK\x03\x04", "a zip archive"), (b"PK\x05\x06", "a zip archive"), (b"\x1f\x8b", "compressed by gzip"),
           (b"BZh", "compressed by bzip2"), (b"\xfd7zXZ", "compressed by xz"), (b"7z\xbc\xaf", "a 7z archive"),
           (b"\x28\xb5\x2f\xfd", "compressed by zstd"))  # fmt: skip


# Without O_NONBLOCK a named pipe would block the program until somebody writes into it; with O_NOFOLLOW a link that
# replaces the file after its path was resolved is not followed.
_GUARDED = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)


@dataclass(frozen=True, slots=True)
class MeshFile:
    """The whole content of a mesh file, with all that it needs from other files embedded.

    Attributes
    ----------
    file
        Its name as the scene gives it; the extension tells the format.
    data
        The content. For a glTF that refers to other files: the same glTF with their content embedded.
    digest
        SHA-256 of ``data``, hexadecimal.
    """

    file: str
    data: bytes = field(repr=False)
    digest: str

    @classmethod
    def of(cls, file: str, data: bytes) -> MeshFile:
        """Make it from bytes, such as those in a snapshot.

        Raises
        ------
        MeshError
            If the name's extension is not in KINDS.
        """
        kind_of(file)
        return cls(file, data, hashlib.sha256(data).hexdigest())

    @property
    def kind(self) -> str:
        """Which of KINDS it is."""
        return kind_of(self.file)


def kind_of(file: str) -> str:
    """Return a file's format, by its name.

    Raises
    ------
    MeshError
        If it is not in KINDS.
    """
    kind = os.path.splitext(file)[1].lower().removeprefix(".")
    if kind not in KINDS:
        listed = ", ".join(f".{known}" for known in KINDS)
        packed = kind in ("zip", "gz", "bz2", "xz", "7z", "zst", "tar", "tgz", "rar")
        advice = "unpack it first" if packed else f"convert it to one of {listed}"
        ends = f"ends in '.{kind}'" if kind else "has no ending"
        raise MeshError("mesh-format", f"'{file}' {ends}; mesh files are {listed}", advice)
    return kind


def read_mesh_file(path: str | os.PathLike[str], *, folder: str | None = None, name: str = "") -> MeshFile:
    """Read a mesh file, and the files that a glTF refers to.

    Parameters
    ----------
    path
        The file.
    folder
        Folder in which all files must be, after links are resolved; default: the file's own folder.
    name
        What to call it in messages and in the result; default: the path as given.

    Raises
    ------
    MeshError
        If it is missing, no regular file, empty, too large, compressed, outside ``folder``, or of another format.
    """
    shown = name or os.fspath(path)
    kind = kind_of(shown)
    root = os.path.realpath(folder if folder is not None else os.path.dirname(os.fspath(path)) or ".")
    data = read_inside(os.fspath(path), root, shown, MAX_BYTES)
    if not data:
        raise MeshError("mesh-empty", f"'{shown}' is empty", "is the file complete?")
    for magic, what in _PACKED:
        if data.startswith(magic):
            raise MeshError("mesh-format", f"'{shown}' is {what}, not a .{kind} file", "unpack it first")
    if kind == "gltf":
        data = embedded(data, shown, _beside(os.fspath(path), root, MAX_BYTES - len(data)))
    return MeshFile.of(shown, data)


def _beside(path: str, root: str, budget: int) -> Callable[[str], bytes]:
    """Return a function that reads files beside ``path``, at most ``budget`` bytes in all."""
    left = [budget]

    def fetch(uri: str) -> bytes:
        data = read_inside(os.path.join(os.path.dirname(path), uri), root, uri, left[0])
        left[0] -= len(data)
        return data

    return fetch


def read_inside(path: str, root: str, shown: str, most: int) -> bytes:
    """Read a regular file of at most ``most`` bytes that is, with links resolved, in the real folder ``root`` or below.

    Raises
    ------
    MeshError
        If it is missing, elsewhere, an address of the network, no regular file, or larger.
    """
    if "://" in shown:
        raise MeshError("outside-folder", f"'{shown}' is an address, not a file", "meshes are read from files only")
    try:
        real = os.path.realpath(path)
        if real != root and not real.startswith(root.rstrip(os.sep) + os.sep):
            advice = "copy it into the folder of the scene, or below it"
            raise MeshError("outside-folder", f"'{shown}' lies outside the scene's folder", advice)
        handle = os.open(real, os.O_RDONLY | _GUARDED)
        try:
            size = _size(os.fstat(handle), shown)
            data = b"" if size > most else _whole(handle, size)
        finally:
            os.close(handle)
    except (OSError, ValueError) as error:
        if isinstance(error, MeshError):
            raise
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        advice = "paths are relative to the file that names them"
        raise MeshError("no-such-file", f"cannot read '{shown}': {reason}", reading_advice(error, advice)) from None
    if size > most:
        sentence = f"'{shown}' is larger than {most / (1 << 20):.4g} MiB, the most that it may take"
        raise MeshError("mesh-too-large", sentence, "make it smaller, or save it in a binary format")
    return data


def _size(status: os.stat_result, shown: str) -> int:
    if not stat.S_ISREG(status.st_mode):
        what = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
        raise MeshError("no-such-file", f"'{shown}' is {what}, not a regular file", "check the path")
    return status.st_size


def _whole(handle: int, size: int) -> bytes:
    """Read ``size`` bytes, or fewer if the file ends before."""
    parts = []
    while size > 0 and (part := os.read(handle, min(size, 1 << 24))):
        parts.append(part)
        size -= len(part)
    return b"".join(parts)
