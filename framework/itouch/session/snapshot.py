"""Snapshots: the canonical scene, the record of State, the bases, a manifest and the ledger.  No pickle."""

from __future__ import annotations

import json
import os
import queue
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any, Protocol

from numpy.typing import NDArray

from itouch.loop.engine_view import Running
from itouch.plugin import Record
from itouch.plugin.bases import Arrays, Bases
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, write
from itouch.scene.loader import read_text
from itouch.schema import SceneError
from itouch.schema.durable import write_whole
from itouch.schema.quantities import LONGEST
from itouch.session.archive import MAX_MEMBER, ArchiveWriter, read_members
from itouch.session.arrays import load_bases, npy_header, pack_bases, record_from, write_record
from itouch.session.channel_selection import every_problem
from itouch.session.manifest import FORMAT, constant_part, digest
from itouch.session.session_error import ADVICE, SessionError, check_ledger, plainly
from itouch.world import Model

#: Room [bytes] in a ledger for what joins its contacts with the rest, and how many were left out.
_ROOM = 100
#: Called at each loss of data: with its kind (``saving``), and why.
Lost = Callable[[str, str], None]


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The content of a snapshot; ``state`` is one record, shape (1,).

    ``edited``: the scene is not the one that was stored; only a document that people can edit may be so.  ``losses``:
    what of its recording is missing.
    """

    scene: Scene
    state: NDArray[Any]
    manifest: dict[str, Any]
    ledger: dict[str, Any]
    bases: dict[str, Arrays] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)
    edited: bool = False
    losses: tuple[str, ...] = ()

    @property
    def seed(self) -> int:
        """Seed of all noise."""
        return int(self.manifest.get("seed", 0))


class SnapshotWriter:
    """Packs the snapshots of one session; what does not change is packed only once."""

    def __init__(
        self, model: Model, state: Record, bases: Bases, catalog: Catalog, before: Mapping[str, Any] | None = None
    ) -> None:
        self._model = model
        xml = write(model.scene).encode()
        self._constant = constant_part(model, catalog, xml, state.dtype, before)
        members = {"scene.xml": xml}
        if bases.used:
            packed, shapes = pack_bases(bases.used)
            self._constant["bases"] = {"digest": digest(packed), "shapes": shapes}
            members["bases.npy"] = packed
        members |= {f"assets/{file.digest}": file.data for file in model.files}
        self._archive = ArchiveWriter(members)
        self._header = npy_header(state.dtype)
        self._calibrated = [name for name in model.devices if f"{name}.calibration" in state]

    def manifest(self, state: Record) -> dict[str, Any]:
        """Return the manifest for this State."""
        return {
            **self._constant,
            "state": digest(state.tobytes()),
            "tick": int(state["tick"]),
            "seed": int(state["seed"]),
            "calibration": {name: state[f"{name}.calibration"].tolist() for name in self._calibrated},
        }

    def pack(self, state: Record, ledger: Mapping[str, Any]) -> bytes:
        """Return the bytes of the whole file."""
        members = {
            "state.npy": write_record(self._header, state),
            "manifest.json": json.dumps(self.manifest(state)).encode(),
            "ledger.json": _ledger_bytes(ledger),
        }
        return self._archive.pack(members)


def _ledger_bytes(ledger: Mapping[str, Any]) -> bytes:
    """Return a ledger as JSON that a reader takes, without its oldest contacts if they are too many.

    It is made entry by entry: hours of contacts in one call would keep the loop of a session that is saved while it
    runs from running for tens of milliseconds.
    """
    rest = {key: value for key, value in ledger.items() if key not in ("contacts", "left_out")}
    entries = [json.dumps(entry) for entry in ledger["contacts"]]
    first, room = len(entries), MAX_MEMBER - _ROOM - len(json.dumps(rest))
    while first and room >= len(entries[first - 1]) + 2:
        first -= 1
        room -= len(entries[first]) + 2
    left_out = ledger.get("left_out", 0) + first
    after = json.dumps({**rest, **({"left_out": left_out} if left_out else {})})[1:]
    return f'{{"contacts": [{", ".join(entries[first:])}], {after}'.encode()


def write_snapshot(
    path: str | os.PathLike[str], data: bytes, *, writer: Callable[[str, bytes], None] = write_whole
) -> None:
    """Write a packed snapshot to its file.

    Raises
    ------
    SessionError
        If the disk refuses; an earlier file at ``path`` is untouched.
    """
    target = os.fspath(path)
    try:
        writer(target, data)
    except OSError as error:
        raise SessionError(f"cannot save '{target}': {error.strerror or error}") from error


def read_snapshot(path: str | os.PathLike[str], catalog: Catalog) -> Snapshot:
    """Read and check a snapshot.

    Raises
    ------
    SessionError
        If it is missing, truncated, altered, malicious, of a newer format, or its scene does not load here.
    """
    name = os.fspath(path)
    members = read_members(name)
    try:
        manifest, ledger = _document(members["manifest.json"]), _document(members["ledger.json"])
        check_format(name, manifest)
        check_ledger(ledger)
        state = record_from(members["state.npy"])
        bases = _bases(name, manifest, members.get("bases.npy"))
        files = checked_files(name, manifest, {k[7:]: v for k, v in members.items() if k.startswith("assets/")})
    except SessionError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, MemoryError, SyntaxError) as error:
        raise SessionError(f"'{name}' is not a whole snapshot: {plainly(error)}; {ADVICE}") from error
    _check_digest(name, "state", manifest, state.tobytes())
    if manifest.get("format") != "1.0":
        _check_digest(name, "scene", manifest, members["scene.xml"])
    scene = read_scene(name, members["scene.xml"], manifest, files, catalog)
    return Snapshot(scene, state, manifest, ledger, bases, files)


def checked_files(name: str, manifest: Mapping[str, Any], stored: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files that the scene names, such as meshes, from what is stored by digest.

    Raises
    ------
    SessionError
        If one is missing or altered.
    """
    files: dict[str, bytes] = {}
    for file, stated in dict(manifest.get("files", {})).items():
        if stated not in stored or digest(stored[stated]) != stated:
            raise SessionError(f"'{name}' is not a whole snapshot: the scene's file '{file}' is missing or altered")
        files[str(file)] = stored[stated]
    return files


def read_scene(
    name: str, xml: bytes, manifest: Mapping[str, Any], files: Mapping[str, bytes], catalog: Catalog
) -> Scene:
    """Return the scene of a stored session.

    Raises
    ------
    SessionError
        If it does not load here.
    """
    scene, problems = read_text(xml, catalog, shown=f"{name}/scene.xml", files=files)
    if any(problem.severity == "error" for problem in problems):
        error = SceneError(every_problem(scene, catalog, problems))
        raise SessionError(f"the scene in '{name}' does not load here:\n\n{error}") from error
    return replace(scene, source=str(manifest.get("source", "")))


def _document(data: bytes) -> dict[str, Any]:
    found = json.loads(data)
    if not isinstance(found, dict):
        raise ValueError("a document of it is not a JSON object")
    return found


def _bases(name: str, manifest: Mapping[str, Any], data: bytes | None) -> dict[str, Arrays]:
    if data is None:
        return {}
    stated = manifest["bases"]
    if digest(data) != stated["digest"]:
        raise SessionError(f"'{name}' was altered: the digest of its bases does not match")
    return load_bases(data, stated["shapes"])


def _check_digest(name: str, what: str, manifest: Mapping[str, Any], data: bytes) -> None:
    if digest(data) != manifest.get(what):
        raise SessionError(f"'{name}' was altered: the digest of its {what} does not fit")


def check_format(name: str, manifest: Mapping[str, Any]) -> None:
    """Refuse a snapshot that a newer program wrote.

    Raises
    ------
    SessionError
        Naming both versions.
    """
    written = str(manifest["format"])
    parts = [int(part) for part in written.split(".")]
    own = [int(part) for part in FORMAT.split(".")]
    if len(parts) != 2 or parts[0] != own[0] or parts > own:
        raise SessionError(f"'{name}' has snapshot format {written[:40]}; this program reads up to {FORMAT}")


class SnapshotPacker(Protocol):
    """Makes the bytes of a snapshot."""

    def __call__(self, state: Record | None = None, ledger: dict[str, Any] | None = None) -> bytes:
        """Return those of the session now, or of a State and a ledger that were taken before."""


class Saving:
    """Saves a session every ``every`` seconds (`--save-every`) without holding up its loop.

    A tap takes the State, a thread packs and writes it.

    On the virtual clock the loop waits for the thread, so that no snapshot is left out; in real time a snapshot is left
    out if the one before is not on the disk yet.
    """

    def __init__(self, session: Running, pack: SnapshotPacker, lost: Lost, path: str, every: float) -> None:
        self._session, self._pack, self._lost, self._path = session, pack, lost, path
        self._ticks = max(1, round(min(every, LONGEST) / session.model.period))
        self._work: queue.Queue[tuple[bytes, dict[str, Any]] | None] = queue.Queue(1)
        self._thread = threading.Thread(target=self._write, name="saving", daemon=True)
        self.failure = ""

    def __enter__(self) -> Saving:
        self._pack()  # packs now what never changes, not in a tick
        self._thread.start()
        self._session.taps.append(self._tap)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.taps.remove(self._tap)
        self._work.put(None)
        self._thread.join()
        self._tell()

    def _tap(self, tick: int) -> None:
        if self.failure:
            self._tell()
        if (tick + 1) % self._ticks:
            return
        ledger = self._session.statistics.dump()
        taken = self._session.state.tobytes(), {**ledger, "contacts": list(ledger["contacts"])}
        with suppress(queue.Full):  # the one before is not on the disk yet
            self._work.put(taken, block=self._session.clock.pace != "real")

    def _write(self) -> None:
        state = self._session.state.copy()
        while (work := self._work.get()) is not None:
            state.raw[:] = memoryview(work[0])
            try:
                write_snapshot(self._path, self._pack(state, work[1]))
            except SessionError as error:
                self.failure = str(error)

    def _tell(self) -> None:
        """Report a failure as a loss; the session goes on, and so does the saving."""
        if self.failure:
            self._lost("saving", self.failure)
            self.failure = ""
