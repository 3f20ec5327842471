"""Snapshots: a zip of the canonical scene, the one record of State, a manifest and the ledger.  No pickle."""

from __future__ import annotations

import hashlib
import io
import json
import os
import tempfile
import zipfile
from dataclasses import dataclass, replace
from importlib import metadata
from typing import Any

import numpy as np

from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, loads, write
from itouch.schema import ItouchError, SceneError

#: Version of the snapshot format.
FORMAT = "1.0"
#: Caps against hostile files: one member, and the whole archive [bytes].
MAX_MEMBER = 64 << 20
_MEMBERS = ("scene.xml", "state.npy", "manifest.json", "ledger.json")


class SessionError(ItouchError):
    """A snapshot that can't be written, read, or used here."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What a snapshot holds."""

    scene: Scene
    state: bytes
    dtype: np.dtype[Any]
    manifest: dict[str, Any]
    ledger: dict[str, Any]

    def check_layout(self, state: Record) -> None:
        """Compare the stored layout with that of this program, field by field.

        Raises
        ------
        SessionError
            Naming the fields that differ.
        """
        if self.dtype == state.dtype:
            return
        old, new = _fields(self.dtype), _fields(state.dtype)
        changed = [f"  - {name}: {kind}" for name, kind in old.items() if new.get(name) != kind]
        changed += [f"  + {name}: {kind}" for name, kind in new.items() if old.get(name) != kind]
        listed = "\n".join(changed) or "  the order of the fields"
        versions = ", ".join(f"{name} {version}" for name, version in self.manifest.get("plugins", {}).items())
        raise SessionError(f"the layout of State has changed since the snapshot ({versions}):\n{listed}")


def _fields(dtype: np.dtype[Any]) -> dict[str, str]:
    return {name: str(dtype[name]) for name in dtype.names or ()}


def write_snapshot(path: str | os.PathLike[str], scene: Scene, state: Record, ledger: dict[str, Any]) -> None:
    """Write a snapshot to a temporary file beside ``path``, sync it, and put it in place.

    Raises
    ------
    SessionError
        If the disk refuses; an earlier file at ``path`` is untouched.
    """
    target = os.fspath(path)
    folder = os.path.dirname(target) or "."
    try:
        os.makedirs(folder, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=".itouch-", dir=folder)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(_archive(scene, state, ledger))
                stream.flush()
                os.fsync(stream.fileno())
            os.chmod(temporary, 0o644)
            os.replace(temporary, target)
        except BaseException:
            os.unlink(temporary)
            raise
        _sync_folder(folder)
    except OSError as error:
        raise SessionError(f"cannot save '{target}': {error.strerror or error}") from error


def _sync_folder(folder: str) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _archive(scene: Scene, state: Record, ledger: dict[str, Any]) -> bytes:
    array = io.BytesIO()
    np.save(array, np.asarray(state).reshape(1), allow_pickle=False)
    xml = write(scene).encode()
    manifest = {
        "format": FORMAT,
        "itouch-py": metadata.version("itouch-py"),
        "plugins": _versions(scene),
        "source": scene.source,
        "layout": hashlib.sha256(repr(state.dtype.descr).encode()).hexdigest(),
        "scene": hashlib.sha256(xml).hexdigest(),
        "state": hashlib.sha256(state.tobytes()).hexdigest(),
        "tick": int(state["tick"]),
        "seed": int(state["seed"]),
    }
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("scene.xml", xml)
        archive.writestr("state.npy", array.getvalue())
        archive.writestr("manifest.json", json.dumps(manifest, indent=1))
        archive.writestr("ledger.json", json.dumps(ledger))
    return buffer.getvalue()


def _versions(scene: Scene) -> dict[str, str]:
    catalog = Catalog()
    versions = {}
    for plugin in sorted({device.plugin for device in scene.devices}):
        if plugin in catalog.device_names:
            versions[plugin] = catalog.found(plugin).version
    return versions


def read_snapshot(path: str | os.PathLike[str], catalog: Catalog) -> Snapshot:
    """Read and check a snapshot.

    Raises
    ------
    SessionError
        If it is missing, cut, altered, hostile, of a newer format, or its scene does not load here.
    """
    name = os.fspath(path)
    members = _read_members(name)
    try:
        manifest, ledger = json.loads(members["manifest.json"]), json.loads(members["ledger.json"])
        _check_format(name, manifest)
        array = np.lib.format.read_array(io.BytesIO(members["state.npy"]), allow_pickle=False, max_header_size=1 << 20)
    except SessionError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise SessionError(f"'{name}' is not a whole snapshot: {error}") from error
    if array.shape != (1,) or array.dtype.names is None or array.dtype.hasobject:
        raise SessionError(f"'{name}' is not a snapshot: its state is not one record")
    if hashlib.sha256(array.tobytes()).hexdigest() != manifest.get("state"):
        raise SessionError(f"'{name}' was altered: the digest of its state does not fit")
    try:
        scene = loads(members["scene.xml"], catalog, shown=f"{name}/scene.xml")
    except SceneError as error:
        raise SessionError(f"the scene in '{name}' does not load here:\n\n{error}") from error
    return Snapshot(
        replace(scene, source=str(manifest.get("source", ""))), array.tobytes(), array.dtype, manifest, ledger
    )


def _check_format(name: str, manifest: dict[str, Any]) -> None:
    written = str(manifest["format"])
    if written.split(".")[0] != FORMAT.split(".")[0] or [int(p) for p in written.split(".")] > [
        int(p) for p in FORMAT.split(".")
    ]:
        raise SessionError(f"'{name}' has snapshot format {written}; this program reads up to {FORMAT}")


def _read_members(name: str) -> dict[str, bytes]:
    try:
        with zipfile.ZipFile(name) as archive:
            return {member: _member(archive, name, member) for member in _MEMBERS}
    except OSError as error:
        raise SessionError(f"cannot read '{name}': {error.strerror or error}") from error
    except SessionError:
        raise
    except Exception as error:  # BadZipFile, zlib.error and what else a mutated archive may raise
        raise SessionError(f"'{name}' is not a whole snapshot: {error}") from error


def _member(archive: zipfile.ZipFile, name: str, member: str) -> bytes:
    info = archive.getinfo(member)
    if info.file_size > MAX_MEMBER:
        raise SessionError(f"'{name}': {member} would unpack to {info.file_size >> 20} MiB")
    with archive.open(info) as stream:
        data = stream.read(MAX_MEMBER + 1)
    if len(data) > MAX_MEMBER:
        raise SessionError(f"'{name}': {member} is larger than it says")
    return data
