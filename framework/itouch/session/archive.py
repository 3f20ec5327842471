"""The archive of a snapshot: a zip with a fixed list of possible members, read within bounds of time and memory."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Mapping

from itouch.platforms import why_unread
from itouch.schema.regular_files import open_regular
from itouch.session.session_error import ADVICE, SessionError, plainly

#: Greatest unpacked size of a member, and of all together [bytes].
MAX_MEMBER, MAX_TOTAL = 64 << 20, 512 << 20
#: Members that every snapshot has; the first format had no others.
MEMBERS = ("scene.xml", "state.npy", "manifest.json", "ledger.json")
#: Members that it may have besides.
_OPTIONAL = re.compile(r"bases\.npy|assets/[0-9a-f]{64}")
_MOST = 4096


class ArchiveWriter:
    """Packs snapshots; members that do not change during a session are packed once."""

    def __init__(self, constant: Mapping[str, bytes]) -> None:
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for name, data in constant.items():
                kind = zipfile.ZIP_DEFLATED if name.endswith((".xml", ".json")) else zipfile.ZIP_STORED
                archive.writestr(name, data, kind)
        self._packed = buffer.getvalue()

    def pack(self, members: Mapping[str, bytes]) -> bytes:
        """Return the archive with these members added."""
        buffer = io.BytesIO()
        buffer.write(self._packed)
        with zipfile.ZipFile(buffer, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for name, data in members.items():
                archive.writestr(name, data)
        return buffer.getvalue()


def read_members(path: str) -> dict[str, bytes]:
    """Return the members of a snapshot; nothing is unpacked to the disk.

    Raises
    ------
    SessionError
        If it is missing, truncated, altered, or malicious.
    """
    try:
        with open_regular(path) as stream:
            if stream.read(2) != b"PK":
                raise SessionError(f"'{path}' is not a snapshot of a session: it does not begin as one")
            stream.seek(0)
            with zipfile.ZipFile(stream) as archive:
                return _members(archive, path)
    except OSError as error:
        raise SessionError(f"cannot read '{path}': {why_unread(error)}") from error
    except SessionError:
        raise
    except Exception as error:  # BadZipFile, zlib.error and what else a mutated archive may raise
        raise SessionError(f"'{path}' is not a whole snapshot: {plainly(error)}; {ADVICE}") from error


def _members(archive: zipfile.ZipFile, path: str) -> dict[str, bytes]:
    infos = archive.infolist()
    names = [info.filename for info in infos]
    if len(infos) > _MOST:
        raise SessionError(f"'{path}' is not a snapshot: it has {len(infos)} members")
    for name in names:
        if name not in MEMBERS and not _OPTIONAL.fullmatch(name):
            raise SessionError(f"'{path}' is not a snapshot: it has a member '{name[:80]}'")
        if names.count(name) > 1:
            raise SessionError(f"'{path}' is not a snapshot: '{name}' is in it twice")
    for name in MEMBERS:
        if name not in names:
            raise SessionError(f"'{path}' is not a whole snapshot: {name} is missing")
    total = sum(info.file_size for info in infos)
    if total > MAX_TOTAL:
        raise SessionError(f"'{path}' would unpack to {total >> 20} MiB")
    return {info.filename: _member(archive, info, path) for info in infos}


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, path: str) -> bytes:
    limit = MAX_TOTAL if info.filename.startswith("assets/") else MAX_MEMBER
    if info.file_size > limit:
        raise SessionError(f"'{path}': {info.filename} would unpack to {info.file_size >> 20} MiB")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise SessionError(f"'{path}' is not a snapshot: {info.filename} is packed in an unknown way")
    with archive.open(info) as stream:
        data = stream.read(info.file_size + 1)
    if len(data) != info.file_size:
        raise SessionError(f"'{path}' is not a whole snapshot: {info.filename} is not as long as it says")
    return data
