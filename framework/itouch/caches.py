"""Cache folders for what can be made again: located, kept bounded, and written so that no reader sees half a file."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

from itouch.platforms import NO_WAIT, OPEN_FLAGS

#: Flags of opening an entry: a pipe under its name is not waited for, and a link is not followed.
_GUARDED = os.O_RDONLY | NO_WAIT | OPEN_FLAGS | getattr(os, "O_NOFOLLOW", 0)
_OFF = ("off", "no", "0", "none")
#: Environment variables that name other folders: of compiled kernels, of results, and of mesh files' surfaces.
SWITCHES = ("ITOUCH_KERNELS", "ITOUCH_KEPT", "ITOUCH_MESH_CACHE")
#: After what time [s] half an entry is one that its writer, which was killed, has left: writing takes milliseconds.
_LEFT = 3600.0


def folder(name: str, switch: str) -> Path | None:
    """Return the folder that caches one kind of entry, or None if that cache is switched off.

    Parameters
    ----------
    name
        Name of the folder inside the user's cache folder.
    switch
        Name of an environment variable: its value is the full path of another folder, or ``off``.  A relative path
        does not count (`relative_switches`): each folder in which the program is started would get a cache of its own.
    """
    given = os.environ.get(switch, "")
    if given.lower() in _OFF:
        return None
    if os.path.isabs(given):
        return Path(given)
    if sys.platform == "darwin":
        root = Path("~/Library/Caches").expanduser()
    elif sys.platform == "win32":
        root = Path(os.environ.get("LOCALAPPDATA") or "~/AppData/Local").expanduser()
    else:
        xdg = os.environ.get("XDG_CACHE_HOME", "")
        root = Path(xdg) if os.path.isabs(xdg) else Path("~/.cache").expanduser()
    return root / "itouch-py" / name if root.is_absolute() else None


def relative_switches() -> dict[str, str]:
    """Return the `SWITCHES` whose value does not count, as it is neither a full path nor ``off``, with the value."""
    given = {switch: os.environ.get(switch, "") for switch in SWITCHES}
    return {
        switch: text for switch, text in given.items()
        if text and text.lower() not in _OFF and not os.path.isabs(text)
    }  # fmt: skip


def owned(place: Path) -> bool:
    """Tell whether a folder belongs to this user and nobody else can write into it; on Windows only that it exists."""
    try:
        return _is_own(place.stat())
    except OSError:
        return False


def _is_own(status: os.stat_result) -> bool:
    return sys.platform == "win32" or (status.st_uid == os.geteuid() and not status.st_mode & 0o022)


def opened(place: Path, name: str) -> BinaryIO:
    """Open an entry for reading, if nobody else can have written it.

    Raises
    ------
    OSError
        If it is absent or cannot be opened; if it is a link, a pipe, a socket, a device or a folder; or if others can
        write to it or to its folder.
    """
    path = place / name
    if not owned(place):
        raise PermissionError(errno.EPERM, "others can write to this folder", os.fspath(place))
    handle = os.open(path, _GUARDED)
    try:
        status = os.fstat(handle)
        if not (stat.S_ISREG(status.st_mode) and _is_own(status)):
            raise PermissionError(errno.EPERM, "it is not a file of this user alone", os.fspath(path))
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def put(place: Path, name: str, blocks: Iterable[Any], *, size: int, capacity: int) -> None:
    """Write an entry atomically; if the folder cannot be written, or others can write to it, do nothing.

    Parameters
    ----------
    blocks
        The content, in parts.
    size
        Upper bound of its length [bytes]; an entry larger than ``capacity`` is not kept.
    capacity
        What all entries together may take [bytes]; the least recently used are removed first.
    """
    if size > capacity:
        return
    with contextlib.suppress(OSError):
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not owned(place):  # what lies there would not be read, and removing what others keep there is not ours
            return
        _make_room(place, Path(name).suffix, size, capacity)
        handle, temporary = tempfile.mkstemp(prefix=".", suffix=".part", dir=place)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.writelines(blocks)
            os.replace(temporary, place / name)
        except BaseException:
            os.unlink(temporary)
            raise


def entries(place: Path | None, suffix: str) -> list[tuple[float, int, Path]]:
    """Return when each entry was last used [s], its length [bytes] and its path; with what a killed writer has left."""
    found: list[tuple[float, int, Path]] = []
    with contextlib.suppress(OSError):
        for path in place.iterdir() if place is not None else ():
            if path.suffix in (suffix, ".part"):
                with contextlib.suppress(OSError):  # another process has just removed it
                    status = path.stat()
                    found.append((status.st_mtime, status.st_size, path))
    return found


def clear(place: Path | None, suffix: str) -> int:
    """Remove all entries of a folder; return how many."""
    count = 0
    for _, _, path in entries(place, suffix):
        with contextlib.suppress(OSError):
            path.unlink()
            count += 1
    return count


def _make_room(place: Path, suffix: str, size: int, capacity: int) -> None:
    """Remove what a writer that was killed has left, and the least recently used entries until there is room."""
    found = []
    for entry in entries(place, suffix):
        if entry[2].suffix == ".part" and entry[0] < time.time() - _LEFT:
            with contextlib.suppress(OSError):
                entry[2].unlink()
        else:
            found.append(entry)
    total = sum(length for _, length, _ in found) + size
    for _, length, path in sorted(found):
        if total <= capacity:
            return
        with contextlib.suppress(OSError):
            path.unlink()
        total -= length
