"""Atomic files: written beside the target, synced, renamed, the folder synced."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
from collections.abc import Callable, Iterator

from itouch.platforms import NO_WAIT, OPEN_FLAGS

#: The rights that a new file gets, without those that the user's umask takes away.
NEW = 0o666
#: How much is written at once [bytes]; the process may die between two blocks without any loss.
BLOCK = 16384
#: What is said of a file that is written bit by bit and has no name any more.
GONE = "the file was removed or replaced while it was being written"

Step = Callable[[str], None]


def _nothing(where: str) -> None:
    """Do nothing at a point of the writing; tests pass a function that dies or fails there."""


def write_whole(path: str, data: bytes, *, step: Step = _nothing) -> None:
    """Write a file so that at every instant either the old or the new one is there, whole.

    A device or a pipe, such as ``/dev/stdout``, is never replaced: it is written into.  A file keeps the rights of the
    one that it replaces; a new one has those of the user's new files (``umask``).

    Parameters
    ----------
    path
        The file; of a link, the file that it points to.
    data
        Its whole content.
    step
        Called at each point of the writing, with the name of the point.

    Raises
    ------
    OSError
        If the disk refuses; an earlier file at ``path`` is untouched, and nothing is left beside it.  If it is a pipe
        that nobody reads.
    """
    if not is_replaceable(path):
        _write_into(path, data)
        return
    path = os.path.realpath(path) if os.path.islink(path) else path
    folder = os.path.dirname(path) or "."
    os.makedirs(folder, exist_ok=True)
    step("begin")
    rights = _rights(path)
    handle, temporary = _begin(folder, NEW if rights is None else rights)
    try:
        try:
            _write(handle, data, step)
            step("sync")
            os.fsync(handle)
        finally:
            os.close(handle)
        step("chmod")
        if rights is not None:  # the umask may have taken some away
            os.chmod(temporary, rights)
        step("rename")
        os.replace(temporary, path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        if isinstance(error, OSError) and error.errno and error.filename is None:
            error.filename = path
        raise
    step("folder")
    sync_folder(folder)
    step("done")


@contextlib.contextmanager
def replacing(path: str) -> Iterator[str]:
    """Give the path of a file to write instead of ``path``, which replaces it, whole, when the block ends in order.

    A device or a pipe is never replaced: then it is ``path`` itself.  Rights and links are as of ``write_whole``.

    Raises
    ------
    OSError
        If the disk refuses; an earlier file at ``path`` is untouched then, and nothing is left beside it.
    """
    if not is_replaceable(path):
        yield path
        return
    place = os.path.realpath(path)
    rights = _rights(place)
    try:
        handle, temporary = _begin(os.path.dirname(place), NEW if rights is None else rights)
    except OSError as error:
        error.filename = path  # nobody knows the other one
        raise
    os.close(handle)
    try:
        yield temporary
        handle = os.open(temporary, os.O_RDWR | OPEN_FLAGS)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
        if rights is not None:
            os.chmod(temporary, rights)
        os.replace(temporary, place)
    except BaseException as error:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        # an error of writing names no file
        if isinstance(error, OSError) and error.errno and error.filename in (None, temporary):
            error.filename = path
        raise
    sync_folder(os.path.dirname(place))


def _rights(path: str) -> int | None:
    """Return the rights of a file, None if there is none."""
    try:
        return stat.S_IMODE(os.stat(path).st_mode)
    except OSError:
        return None


def _begin(folder: str, rights: int) -> tuple[int, str]:
    """Return a new file in a folder, open, with at most these rights from its first instant, and its path."""
    while True:
        path = os.path.join(folder, f".itouch-{secrets.token_hex(4)}.part")
        with contextlib.suppress(FileExistsError):
            return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | OPEN_FLAGS, rights), path


def is_replaceable(path: str) -> bool:
    """Tell whether another file may be moved to a path: it, or what a link there points to, is a file or nothing."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except OSError:
        return True


def _write_into(path: str, data: bytes) -> None:
    """Write into a device or a pipe, as far as one can; a pipe without a reader is not waited for."""
    handle = os.open(path, os.O_WRONLY | NO_WAIT | OPEN_FLAGS)
    try:
        if hasattr(os, "set_blocking"):
            os.set_blocking(handle, True)
        _write(handle, data, _nothing)
    finally:
        os.close(handle)


def _write(handle: int, data: bytes, step: Step) -> None:
    view = memoryview(data)
    while view:
        step("block")
        view = view[os.write(handle, view[:BLOCK]) :]


def sync_folder(folder: str) -> None:
    """Sync a folder, so that a rename in it survives a loss of power."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except PermissionError:  # Windows does not open folders, and makes renames durable by itself
        return
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
