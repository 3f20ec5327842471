"""Building an engine from a scene file, and saving and restoring it: a session is scene + State, nothing else."""

from __future__ import annotations

import os
from dataclasses import replace

from itouch.loop import Clock, Engine
from itouch.plugin import Record
from itouch.plugin.bases import Bases, keeping
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, load
from itouch.schema import Problem, SceneError
from itouch.schema.diagnostics import did_you_mean
from itouch.session import layout
from itouch.session.document import to_xml
from itouch.session.errors import SessionError
from itouch.session.open import read_session
from itouch.session.plausible import check_plausible
from itouch.session.snapshot import Snapshot, SnapshotWriter, write_snapshot
from itouch.world import Model

Path = str | os.PathLike[str]


class Session(Engine):
    """An engine that can be saved, and restored to go on as if it had not stopped."""

    def __init__(
        self,
        model: Model,
        *,
        seed: int = 0,
        clock: Clock | None = None,
        catalog: Catalog | None = None,
        bases: Bases | None = None,
    ) -> None:
        self._bases, self._catalog, self._whole = bases or Bases(), catalog or Catalog(), bases is not None
        self._notes: tuple[str, ...] = ()
        self._writer: SnapshotWriter | None = None
        with keeping(self._bases):
            super().__init__(model, seed=seed, clock=clock)

    @classmethod
    def of(cls, scene: Scene, *, catalog: Catalog, seed: int = 0, clock: Clock | None = None) -> Session:
        """Build a session from a scene; what eigen-solves make is kept for its snapshots."""
        bases = Bases()
        with keeping(bases):
            return cls(Model.of(scene, catalog), seed=seed, clock=clock, catalog=catalog, bases=bases)

    @property
    def notices(self) -> tuple[str, ...]:
        """What is rendered otherwise than the scene says, and what was done to restore it."""
        return (*super().notices, *self._notes)

    def _snapshots(self) -> SnapshotWriter:
        if self._writer is None:
            if not self._whole:  # the model was compiled elsewhere: note what its solves made
                with keeping(self._bases):
                    Model.of(self.model.scene, self._catalog)
            self._writer = SnapshotWriter(self.model, self.state, self._bases, self._catalog)
        return self._writer

    def pack(self) -> bytes:
        """Return the bytes of a snapshot."""
        return self._snapshots().pack(self.state, self.ledger.dump())

    def save(self, path: Path) -> None:
        """Write a snapshot: never half a file, the old one stays until the new one is whole.

        Raises
        ------
        SessionError
            If it can't be written.
        """
        write_snapshot(path, self.pack())

    def snapshot(self) -> Snapshot:
        """Return what a snapshot of now would hold."""
        record = Record.__array__(self.state, copy=True).reshape(1)
        manifest = self._snapshots().manifest(self.state)
        files = {file.file: file.data for file in self.model.files}
        return Snapshot(self.model.scene, record, manifest, self.ledger.dump(), dict(self._bases.used), files)

    def to_xml(self) -> str:
        """Return the whole session as one XML document, which ``restore`` reads back to the same bytes."""
        return to_xml(self.snapshot())

    def take_up(self, snapshot: Snapshot) -> None:
        """Go on from a snapshot of the same scene.

        Raises
        ------
        SessionError
            If its State can't be mapped to this program's, or can't be one.
        """
        stored, said = layout.adopt(snapshot.state, self.state, snapshot.manifest.get("plugins", {}))
        before = self.state.tobytes()
        self.adopt(stored)
        try:
            check_plausible(self.model, self.state)
            self.ledger.load(snapshot.ledger)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            self.adopt(before)
            raise SessionError(f"the session can't be taken up: {error}") from error
        self._notes = tuple(said)
        stated = snapshot.manifest.get("model")
        if stated and stated != self._snapshots().manifest(self.state)["model"]:
            self._notes += (
                "the scene compiles to other numbers here than where the session was saved (another version or "
                "machine): it goes on, but not byte for byte",
            )


def load_scene(
    path: Path, *, rig: Path | None = None, twin: str | None = None, catalog: Catalog | None = None
) -> Scene:
    """Load a scene file.

    Parameters
    ----------
    path
        The file.
    rig
        A file whose devices replace those of the scene.
    twin
        ``"all"``, ``"none"``, or names of devices separated by commas that shall run as twins.
    catalog
        The plugins; default: those of this environment.

    Raises
    ------
    SceneError
        With all problems.
    """
    scene = load(path, catalog or Catalog(), rig=rig)
    return scene if twin is None else choose_twins(scene, twin)


def choose_twins(scene: Scene, twin: str) -> Scene:
    """Return the scene with its devices' twins switched as ``--twin`` says.

    Raises
    ------
    SceneError
        If a name is not that of a device.
    """
    names = [device.name for device in scene.devices]
    wanted = [name.strip() for name in twin.split(",")]
    if twin not in ("all", "none"):
        unknown = [name for name in wanted if name not in names]
        if unknown:
            advice = did_you_mean(unknown[0], [*names, "all", "none"], "possible are")
            raise SceneError(
                [Problem("unknown-name", f"--twin: there is no device named '{unknown[0]}'", None, advice)]
            )
    devices = []
    for device in scene.devices:
        on = device.twin if twin not in ("all", "none") else twin == "all" and (device.twin or True)
        changed = replace(device, twin=on or device.name in wanted)
        place = scene.places.of(device)
        if place is not None:
            names_of = ("name", "plugin", "twin")
            spots = {name: spot for name in names_of if (spot := scene.places.of(device, name)) is not None}
            scene.places.put(changed, place, spots)
        devices.append(changed)
    return replace(scene, devices=tuple(devices))


def build(
    scene: Path | Scene,
    *,
    seed: int = 0,
    twin: str | None = None,
    rig: Path | None = None,
    clock: Clock | None = None,
    catalog: Catalog | None = None,
) -> Session:
    """Build an engine from a scene or its file.

    Parameters
    ----------
    scene
        A scene, or the path of one.
    seed
        Of all noise; equal seeds give equal runs, byte for byte.
    twin, rig
        As in ``load_scene``.
    clock
        What paces the loop; default: the virtual clock, as fast as it computes.
    catalog
        The plugins; default: those of this environment.

    Raises
    ------
    SceneError
        With all problems of the scene.
    """
    plugins = catalog or Catalog()
    if isinstance(scene, Scene):
        description = scene if twin is None else choose_twins(scene, twin)
    else:
        description = load_scene(scene, rig=rig, twin=twin, catalog=plugins)
    return Session.of(description, catalog=plugins, seed=seed, clock=clock)


def restore(path: Path, *, clock: Clock | None = None, catalog: Catalog | None = None) -> Session:
    """Restore a session from a snapshot or its XML; on twins it goes on byte for byte, hardware starts OPEN.

    Raises
    ------
    SessionError
        If the file is not a whole snapshot, or does not fit the plugins of this environment.
    """
    plugins = catalog or Catalog()
    snapshot = read_session(path, plugins)
    bases = Bases(snapshot.bases)
    try:
        with keeping(bases):
            model = Model.of(snapshot.scene, plugins)
            session = Session(model, seed=snapshot.seed, clock=clock, catalog=plugins, bases=bases)
    except SceneError as error:
        raise SessionError(f"the scene in '{os.fspath(path)}' can't be compiled here:\n\n{error}") from error
    except ValueError as error:
        raise SessionError(f"'{os.fspath(path)}' can't be restored: {error}") from error
    session.take_up(snapshot)
    return session
