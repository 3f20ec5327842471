"""Sessions from recordings: a recording holds the scene, its files and bases, and a whole State from time to time."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from itouch.loop.run_statistics import RunStatistics
from itouch.plugin.discovery import Catalog
from itouch.recording import Recording, RecordingError, read
from itouch.session.arrays import load_bases, record_from
from itouch.session.session_error import SessionError, plainly
from itouch.session.snapshot import Snapshot, checked_files, read_scene

#: Greatest State that a recording may hold [bytes].
_MAX_STATE = 64 << 20


def snapshot_at(recording: Recording, letter: Mapping[str, Any], catalog: Catalog) -> Snapshot:
    """Return a recorded State (a message of the recording) as a snapshot, with all that belongs to its session.

    Raises
    ------
    SessionError, RecordingError
        If the recording lacks some of it, or the session does not load here.
    """
    said = recording.session
    try:
        manifest = dict(said["manifest"])
        stored = load_bases(base64.b64decode(said["bases"]), manifest.get("bases", {}).get("shapes", {}))
        data = {k[6:]: v for k, v in recording.attachments.items() if k.startswith("files/")}
        digests = dict(manifest.get("files", {}))
        files = checked_files(recording.path, manifest, {digests[n]: v for n, v in data.items() if n in digests})
        scene = read_scene(recording.path, str(said["scene"]).encode(), manifest, files, catalog)
        state = state_of(letter)
    except (ValueError, KeyError, TypeError, AttributeError, zlib.error) as error:
        raise RecordingError(f"'{recording.path}' does not hold a whole session: {plainly(error)}") from error
    return Snapshot(scene, state, manifest, RunStatistics().dump(), stored, files, losses=_damage(recording))


def _damage(recording: Recording) -> tuple[str, ...]:
    """Return what says that the file itself is not whole; samples that were lost while recording are no damage."""
    return () if recording.whole else recording.losses


def last_snapshot(path: str, catalog: Catalog) -> Snapshot:
    """Return the last whole State of a recording from which a session can go on, however the recording ended.

    Raises
    ------
    SessionError
        If the recording can't be read, or holds no such State.
    """
    try:
        recording = read(path)
        letters = [letter for letter in recording.states if letter.get("reason") != "fault"]
        if not letters:
            raise SessionError(f"'{path}' holds no State to go on from")
        return snapshot_at(recording, letters[-1], catalog)
    except RecordingError as error:
        raise SessionError(str(error)) from error


def state_of(letter: Mapping[str, Any]) -> NDArray[Any]:
    """Return the State in a message, one record of shape (1,).

    Raises
    ------
    ValueError
        If it holds none.
    """
    unpacker = zlib.decompressobj()
    data = unpacker.decompress(base64.b64decode(str(letter["npy"])), _MAX_STATE)
    return record_from(data)
