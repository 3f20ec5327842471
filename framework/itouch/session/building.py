"""Building an engine from a scene file, and restoring one from a session."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace

from itouch.gc_policy import rare_collections
from itouch.loop import Clock
from itouch.plugin.bases import Bases, keeping
from itouch.plugin.discovery import Catalog
from itouch.safety import LOSSES, Trip
from itouch.scene import Scene
from itouch.scene.loader import read_scene
from itouch.schema import ItouchError, Problem, SceneError
from itouch.schema.diagnostics import did_you_mean
from itouch.session.calibration import calibrated
from itouch.session.channel_selection import every_problem
from itouch.session.open import read_session
from itouch.session.session import Session
from itouch.session.session_error import SessionError
from itouch.session.snapshot import Snapshot
from itouch.world import Model


def load_scene(
    path: str | os.PathLike[str],
    *,
    rig: str | os.PathLike[str] | None = None,
    twin: str | None = None,
    catalog: Catalog | None = None,
    records: bool = True,
) -> Scene:
    """Load a scene file.

    Parameters
    ----------
    path
        The file.
    rig
        A file whose devices replace those of the scene.
    twin
        ``"all"``, ``"none"``, or names, separated by commas, of the devices to run as twins.
    catalog
        The plugins; default: those of this environment.
    records
        Whether the calibration records beside the file, or beside the rig's, are put into the scene.

    Raises
    ------
    SceneError
        With all problems.
    """
    catalog = catalog or Catalog()
    scene, problems = read_scene(path, catalog, rig=rig)
    try:
        scene = scene if twin is None else choose_twins(scene, twin)
    except SceneError as error:
        problems += error.problems
    if records:
        scene, unfit = with_records(scene, catalog)
        problems += unfit
    if any(problem.severity == "error" for problem in problems):
        raise SceneError(every_problem(scene, catalog, problems))
    return scene


def with_records(scene: Scene, catalog: Catalog) -> tuple[Scene, Sequence[Problem]]:
    """Return a scene with the calibration records beside it put in, and what is wrong with these."""
    try:
        return calibrated(scene, catalog=catalog), ()
    except SceneError as error:
        return scene, error.problems
    except ItouchError as error:  # their file can't be read
        return scene, [Problem("calibration-stale", str(error))]


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
        scene.places.succeed(changed, device)
        devices.append(changed)
    return replace(scene, devices=tuple(devices))


@rare_collections()
def build(
    scene: str | os.PathLike[str] | Scene,
    *,
    seed: int = 0,
    twin: str | None = None,
    rig: str | os.PathLike[str] | None = None,
    clock: Clock | None = None,
    catalog: Catalog | None = None,
) -> Session:
    """Build an engine from a scene or its file.

    Parameters
    ----------
    scene
        A scene, or the path of its file.
    seed
        Seed of all noise; equal seeds give equal runs, byte for byte.
    twin
        ``"all"``, ``"none"``, or the names of the devices to run as twins, separated by commas; default: the scene's.
    rig
        A file whose devices replace those of the scene.
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


@rare_collections()
def restore(
    path: str | os.PathLike[str], *, clock: Clock | None = None, catalog: Catalog | None = None, opens: bool = True
) -> Session:
    """Restore a session from a snapshot or its XML; on twins it goes on byte for byte, hardware starts OPEN.

    A device that moves when it is opened stays CLOSED until it is enabled, as does one that can't be opened; the
    notices say which.  Without ``opens``, for looking at a session, all hardware stays CLOSED until it is enabled.

    Raises
    ------
    SessionError
        If the file is not a whole snapshot, or does not fit the plugins of this environment.
    """
    plugins = catalog or Catalog()
    session = rebuild(read_session(path, plugins), os.fspath(path), plugins, clock)
    _tell_what_stopped(session)
    if opens:
        session.open_readable()
    return session


def _tell_what_stopped(session: Session) -> None:
    """Say which trips of twins are still latched: a run would go on with safe commands, and nothing would say why.

    Hardware needs no word here, because it can't be enabled before it is re-armed, which says so.
    """
    for runner in session.runners:
        trip, model = runner.latch.trip, runner.model
        if model.twin and trip is not Trip.NONE and not (model.optional and trip in LOSSES):
            when = runner.latch.tripped * session.model.period
            session.tell(
                f"device '{model.name}' was stopped by {trip.label} at {when:.3f} s, before this session "
                "was stored: the devices stay safe until they are re-armed (session.rearm(), or R in a window)"
            )


def rebuild(snapshot: Snapshot, name: str, catalog: Catalog, clock: Clock | None, *, replays: bool = False) -> Session:
    """Return a session that goes on from a snapshot, or, with ``replays``, one for a replay only.

    Raises
    ------
    SessionError
        If it does not fit the plugins of this environment.
    """
    bases = Bases(snapshot.bases)
    try:
        with keeping(bases):
            model = Model.of(snapshot.scene, catalog)
            session = Session(model, seed=snapshot.seed, clock=clock, catalog=catalog, bases=bases)
    except SceneError as error:
        raise SessionError(f"the scene in '{name}' can't be compiled here:\n\n{error}") from error
    except ValueError as error:
        raise SessionError(f"'{name}' can't be restored: {error}") from error
    session.take_up(snapshot, replays=replays)
    if snapshot.losses and not replays:
        session.tell(
            f"'{name}' is damaged or was cut: {snapshot.losses[0]}; the session goes on from the last whole State "
            f"before that, which is of {session.seconds:g} s"
        )
    return session
