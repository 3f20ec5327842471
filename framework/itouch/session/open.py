"""Opening a stored session by what its file is: archive, XML document or recording."""

from __future__ import annotations

import os

from itouch.plugin.discovery import Catalog
from itouch.schema.files import open_regular
from itouch.session.document import MAX_DOCUMENT, from_xml
from itouch.session.errors import SessionError
from itouch.session.snapshot import Snapshot, read_snapshot

Path = str | os.PathLike[str]

#: The first bytes of a recording.
_RECORDING = b"\x89MCAP"


def is_session(path: Path) -> bool:
    """Tell whether a file is a stored session: a snapshot or recording by its name, or a document with a ``<session>``.

    From a recording, a session goes on at its last whole State.
    """
    name = os.fspath(path)
    if name.endswith((".itouch", ".mcap")):
        return True
    if not name.endswith(".xml"):
        return False
    try:
        with open_regular(name) as stream:
            return b"<session " in stream.read(MAX_DOCUMENT)
    except OSError:
        return False


def read_session(path: Path, catalog: Catalog) -> Snapshot:
    """Read a snapshot, the XML document of a session, or the last State of a recording.

    Raises
    ------
    SessionError
        If it is none of them, or not whole.
    """
    name = os.fspath(path)
    try:
        with open_regular(name) as stream:
            head = stream.read(256)
            document = head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")
            data = head + stream.read(MAX_DOCUMENT + 1 - len(head)) if document else b""
    except OSError as error:
        raise SessionError(f"cannot read '{name}': {error.strerror or error}") from error
    if head.startswith(_RECORDING):
        from itouch.session.recorded import last_snapshot

        return last_snapshot(name, catalog)
    if not document:
        return read_snapshot(name, catalog)
    if len(data) > MAX_DOCUMENT:
        raise SessionError(f"'{name}' is larger than {MAX_DOCUMENT >> 20} MiB")
    return from_xml(name, data, catalog)
