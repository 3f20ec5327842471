"""Opens files that a user names: regular files only, so that no pipe or device can block the program."""

from __future__ import annotations

import errno
import os
import re
import stat
from typing import BinaryIO

from itouch.platforms import NO_WAIT, OPEN_FLAGS

#: How much of a file tells what it is [bytes], and what may stand before the first character of a document.
_HEAD, _BLANK = 256, b"\xef\xbb\xbf \t\r\n"
#: How stored files begin (a snapshot is a zip, with the name of a member after a header of 30 bytes), and end by name.
_BEGINS = {
    "session": re.compile(
        rb"PK\x03\x04.{26}((scene\.xml|state\.npy|(manifest|ledger)\.json|bases\.npy)|assets/)", re.DOTALL
    ),
    "recording": re.compile(rb"\x89MCAP"),
}
_ENDS = {"session": ".itouch", "recording": ".mcap"}


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading.

    Raises
    ------
    OSError
        If it cannot be opened, or is a pipe, a device, a socket or a folder.
    """
    handle = os.open(path, os.O_RDONLY | NO_WAIT | OPEN_FLAGS)  # a pipe without a writer is not waited for
    try:
        mode = os.fstat(handle).st_mode
        if not stat.S_ISREG(mode):
            kind = "a folder" if stat.S_ISDIR(mode) else "a pipe, a device or a socket"
            raise OSError(errno.EINVAL, f"it is {kind}, not a file", os.fspath(path))
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def kind_of(head: bytes) -> str:
    """Return what begins like this: ``session`` (a snapshot), ``recording``, or nothing of these."""
    return next((kind for kind, begins in _BEGINS.items() if begins.match(head)), "")


def is_document(head: bytes) -> bool:
    """Tell whether what begins like this is text in XML."""
    return head.lstrip(_BLANK).startswith(b"<")


def stored_kind(path: str | os.PathLike[str]) -> str:
    """Return what the program itself has stored in a file: ``session`` (a snapshot), ``recording``, or nothing.

    The content says it, whatever the name; of a file that cannot be read, or whose beginning is damaged, the ending of
    its name does.
    """
    try:
        with open_regular(path) as stream:
            head = stream.read(_HEAD)
    except OSError:
        head = b""
    kind = kind_of(head)
    if kind:
        return kind
    name = os.fspath(path).lower()
    return "" if is_document(head) else next((k for k, end in _ENDS.items() if name.endswith(end)), "")
