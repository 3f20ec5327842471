"""Whether a file is a stored session, told by its content, and opening it: archive, XML document or recording."""

from __future__ import annotations

import os

from itouch.platforms import why_unread
from itouch.plugin.discovery import Catalog
from itouch.schema.regular_files import is_document, kind_of, open_regular, stored_kind
from itouch.session.document import MAX_DOCUMENT, from_xml
from itouch.session.session_error import SessionError
from itouch.session.snapshot import Snapshot, read_snapshot

Path = str | os.PathLike[str]


def is_session(path: Path) -> bool:
    """Tell whether a file holds a session, by its content: a snapshot, a recording or a document with a ``<session>``.

    A damaged snapshot or recording is known by its name's ending.  From a recording, a session goes on at its last
    whole State.
    """
    if stored_kind(path):
        return True
    try:
        with open_regular(path) as stream:
            head = stream.read(256)
            size = os.fstat(stream.fileno()).st_size  # reading up to the limit would reserve that much memory
            return is_document(head) and b"<session " in head + stream.read(min(size, MAX_DOCUMENT))
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
            document = is_document(head)
            data = head + stream.read(MAX_DOCUMENT + 1 - len(head)) if document else b""
    except OSError as error:
        raise SessionError(f"cannot read '{name}': {why_unread(error)}") from error
    if kind_of(head) == "recording":
        from itouch.session.from_recordings import last_snapshot

        return last_snapshot(name, catalog)
    if not document:
        return read_snapshot(name, catalog)
    if len(data) > MAX_DOCUMENT:
        raise SessionError(f"'{name}' is larger than {MAX_DOCUMENT >> 20} MiB")
    return from_xml(name, data, catalog)
