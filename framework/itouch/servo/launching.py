"""Launching a session in a servo process of its own."""

from __future__ import annotations

import base64
import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from itouch.platforms import SERVO_PROCESS, keep_standard_numbers
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, write
from itouch.schema.quantities import checked_time
from itouch.servo.guardian_link import Guarded, child_environment
from itouch.servo.handle import Handle
from itouch.servo.shared_memory import ServoError, SharedMemory
from itouch.servo.thread_session import NoGuardian, ThreadProcess
from itouch.session import choose_twins
from itouch.session.outputs import Outputs
from itouch.world.replaced_limits import fitted


def launch(
    scene: str | os.PathLike[str] | Scene,
    *,
    seed: int = 0,
    twin: str | None = None,
    rig: str | os.PathLike[str] | None = None,
    seconds: float | None = None,
    save: str | os.PathLike[str] | None = None,
    name: str | None = None,
    enable: bool = False,
    linger: bool = False,
    realtime: bool = True,
    keep: Outputs | None = None,
) -> Handle:
    """Run a scene or a saved session in real time, in a servo process of its own.

    Parameters
    ----------
    scene
        A scene, or the path of a scene or session.
    seed, twin, rig
        As in ``itouch.build``.
    seconds
        How long to run; None: until the scripted motion ends, or without one until ``stop``.
    save
        Where to save the session at its end.
    name
        The session's name for ``itouch.servo.attach``; default: the scene's file name and the launcher's process id.
    enable
        Let hardware move or heat at once; without it ``Handle.enable`` is needed.  Twins enable by themselves.
    linger
        Stay after a fault, with all devices safe, until somebody re-arms or stops: for programs that show the session
        to a person.  Without it a fault ends the session.
    realtime
        Ask for real-time priority and locked memory.
    keep
        What to keep while it runs: a recording, periodic snapshots.

    Returns
    -------
    Handle
        Of the session, once its engine is built; a rig of twins is then running.

    Raises
    ------
    SceneError, SessionError
        If the scene or session is wrong.
    ServoError
        If the servo process can't be started.
    """
    config = configured(
        scene, seed=seed, twin=twin, rig=rig, seconds=seconds, save=save, enable=enable, linger=linger,
        realtime=realtime, keep=keep,
    )  # fmt: skip
    return start(name or named(config["scene"]), config)


def configured(
    scene: str | os.PathLike[str] | Scene, *, seed: int = 0, twin: str | None = None,
    rig: str | os.PathLike[str] | None = None, seconds: float | None = None,
    save: str | os.PathLike[str] | None = None, enable: bool = False, linger: bool = False, realtime: bool = True,
    keep: Outputs | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Return the configuration that ``launch`` gives to ``start``, from the same parameters.

    A program that lets the servo process serve something else adds to it.

    Raises
    ------
    ValueError
        If the time or the seed is out of range.
    """
    if seconds is not None:
        checked_time("seconds", seconds)
    if not 0 <= seed < 1 << 63:
        raise ValueError(f"seed = {seed!r} is out of range: 0 to 2^63 - 1")
    return _config(scene, twin) | {
        "seed": seed, "rig": None if rig is None else os.fspath(rig), "seconds": seconds, "enable": enable,
        "linger": linger,
        "save": None if save is None else os.fspath(save), "realtime": realtime, "sys_path": sys.path,
        "keep": (keep or Outputs()).dump(),
    }  # fmt: skip


def start(name: str, config: dict[str, Any]) -> Handle:
    """Start a servo process, and return when its engine is built.

    Parameters
    ----------
    name
        The session's name.
    config
        ``serves``: the function that the process runs, as ``MODULE:FUNCTION`` (default: a session of a scene); and
        the entries that this function reads.

    Raises
    ------
    SceneError, SessionError
        If the scene or session is wrong.
    ServoError
        If the servo process can't be started.
    """
    handle = begin(name, config)
    try:
        handle.await_ready()
    except KeyboardInterrupt:  # nobody will ever use it
        handle.close()
        raise
    return handle


def begin(name: str, config: dict[str, Any]) -> Handle:
    """Do what ``start`` does, but return at once: ``Handle.await_ready`` waits until the engine is built.

    Raises
    ------
    ServoError
        If the servo process can't be started.
    """
    keep_standard_numbers()
    try:
        return _start(name, config)
    except OSError as error:  # no more files, processes or memory
        raise ServoError(f"cannot start the session's processes: {error.strerror or error}") from error


def named(scene: str) -> str:
    """Return the name of a session for which none was given."""
    return f"{Path(scene).stem or 'scene'}-{os.getpid()}-{time.monotonic_ns() // 1000 % 10**6}"


def _config(scene: str | os.PathLike[str] | Scene, twin: str | None) -> dict[str, Any]:
    if isinstance(scene, Scene):
        chosen = fitted(scene if twin is None else choose_twins(scene, twin), Catalog())
        files = chosen.files
        return {
            "scene": chosen.source, "scene_xml": write(chosen), "twin": None, "folder": chosen.folder,
            "files": None if files is None else {n: base64.b64encode(data).decode() for n, data in files.items()},
        }  # fmt: skip
    return {"scene": os.fspath(scene), "scene_xml": None, "twin": twin}


def _start(name: str, config: dict[str, Any]) -> Handle:
    segment = SharedMemory.create(name)
    near, far = socket.socketpair()
    if not SERVO_PROCESS:
        return Handle(ThreadProcess(segment, far, config), segment, near, NoGuardian())
    words = [sys.executable, "-P", "-m", "itouch.servo.process", str(segment.handle), name, str(far.fileno())]
    words.append(str(os.getpid()))
    process = None
    try:
        process = subprocess.Popen(
            words, pass_fds=(segment.handle, far.fileno()), stdin=subprocess.DEVNULL, start_new_session=True,
            env=child_environment(),
        )  # fmt: skip
        near.sendall(json.dumps(config).encode() + b"\n")
        return Handle(process, segment, near, Guarded(process.pid, segment, child_environment()))
    except BaseException:
        if process is not None:  # there would be no guardian
            process.kill()
            process.wait()
        near.close()
        segment.close()
        raise
    finally:
        far.close()
