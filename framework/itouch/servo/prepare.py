"""Building the engine for a run; what must be compiled first is compiled on several processors, with a message."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from itouch import shipped
from itouch.platforms import cores, lives
from itouch.schema.terminal import VERBOSITY
from itouch.schema.wait_notices import waiting

if TYPE_CHECKING:
    from itouch.plugin.discovery import Catalog
    from itouch.recording import Recording
    from itouch.session import Session
    from itouch.session.replaying import Replay

#: After what time [s] a start that had to compile a kernel is helped, and how often [s] that is checked.
_PATIENCE, _LOOK = 1.6, 0.3
#: How many processes help at most: each begins elsewhere in the list, and uses what the others have done.
_COMPANIONS = 3
#: How the names begin of folders in which processes say what they compile; the id of the one that made it follows.
_FOLDER = "itouch-compiling-"
#: From what share on the time that compiling has taken so far tells how long the rest will take.
_TELLS = 0.1


class _Companion:
    """Processes that compile the steps from the last one backwards, while this one begins with the first.

    They are started only if needed.
    """

    def __init__(self, words: list[str]) -> None:
        self._words = words
        self._processes: list[subprocess.Popen[bytes]] = []
        self._folder: Path | None = None
        self._over = threading.Event()
        self._before = _compiled()  # a process may have built sessions before this one
        self._watch = threading.Thread(target=self._look, name="itouch-companion", daemon=True)

    def _look(self) -> None:
        """Start the processes once compiling takes long; one that only loads gets no help, however long it takes."""
        sweep()
        wait = _PATIENCE
        while not self._over.wait(wait):
            if _compiled() > self._before:
                self._start()
                self._tell()
                return
            wait = _LOOK

    def _start(self) -> None:
        if not VERBOSITY.quiet:
            if why := shipped.left_out():
                print(f"preparing: {why}", file=sys.stderr, flush=True)
            print("preparing: compiling the kernels that this needs for the first time, later starts load them ...",
                  file=sys.stderr, flush=True)  # fmt: skip
        count = min(cores() - 1, _COMPANIONS)
        if count < 1:
            return
        with contextlib.suppress(OSError):  # no room for a folder, or no more processes: this one compiles all
            self._begin(count)

    def _begin(self, count: int) -> None:
        """Start as many processes as this.

        Raises
        ------
        OSError
            If they have no folder, or the system does not start them.
        """
        self._folder = Path(tempfile.mkdtemp(prefix=f"{_FOLDER}{os.getpid()}-"))
        sys.modules["itouch.compiling"].compile_together(self._folder)
        command = [sys.executable, "-m", "itouch.servo.compile_ahead", *self._words]
        command += ["--parent", str(os.getpid()), "--together", str(self._folder)]
        nothing = subprocess.DEVNULL
        for place in range(count):
            part = ["--part", str(place / count)]
            self._processes.append(subprocess.Popen([*command, *part], stdin=nothing, stdout=nothing, stderr=nothing))

    def _tell(self) -> None:
        """Show how far it is until all is compiled."""
        begun = time.monotonic()
        with waiting("compiling") as wait:
            while not self._over.wait(_LOOK):
                done, needed, now = sys.modules["itouch.compiling"].progress()
                if needed is None:
                    wait.part(None, f"{done} so far, now {now}" if now else f"{done} so far")
                    continue
                share = done / needed
                left = (time.monotonic() - begun) * (1.0 - share) / max(share, 0.01)
                told = f", {left:.0f} s more" if share > _TELLS else ""
                wait.part(share, f"{done} of {needed} kernels{told}")

    def __enter__(self) -> _Companion:
        self._watch.start()
        return self

    def _end(self) -> None:
        self._over.set()
        self._watch.join()  # so that no process is started after this

    def __exit__(self, *exception: object) -> None:
        self._end()
        for process in self._processes:  # what is not compiled by now is not needed
            process.kill()
            process.wait()
        if self._folder is not None:
            sys.modules["itouch.compiling"].compile_together(None)
            shutil.rmtree(self._folder, ignore_errors=True)


def sweep(kind: str = _FOLDER) -> None:
    """Remove temporary folders ``kind`` + process number + "-..." of processes that are no more, as they were killed.

    By default they are those in which starts say what they compile.
    """
    with contextlib.suppress(OSError):
        for place in Path(tempfile.gettempdir()).glob(f"{kind}*-*"):
            owner = place.name.removeprefix(kind).partition("-")[0]
            if owner.isdecimal() and not lives(int(owner)) and _is_own(place):
                shutil.rmtree(place, ignore_errors=True)


def _is_own(place: Path) -> bool:
    """Tell whether a folder, and no link to one, belongs to this user."""
    with contextlib.suppress(OSError):
        status = place.lstat()
        return stat.S_ISDIR(status.st_mode) and (not hasattr(os, "geteuid") or status.st_uid == os.geteuid())
    return False


def _compiled() -> int:
    """Return how many kernels this process has had to compile so far."""
    compiling = sys.modules.get("itouch.compiling")
    return compiling.KernelCache.missed if compiling is not None else 0


def prepare(scene: str, *, seed: int, twin: str | None, rig: str | None, opens: bool = True) -> Session:
    """Build an engine from a scene, or restore one from a session, with ``opens`` as in ``itouch.restore``.

    Raises
    ------
    SceneError, SessionError
        If the file is wrong.
    """
    words = [scene, *(["--twin", twin] if twin else []), *(["--rig", rig] if rig else [])]
    with _Companion(words):
        from itouch.plugin.discovery import Catalog
        from itouch.session import Session, is_session, load_scene, restore

        if is_session(scene):
            return restore(scene, opens=opens)
        catalog = Catalog()
        return Session.of(load_scene(scene, rig=rig, twin=twin, catalog=catalog), catalog=catalog, seed=seed)


def prepare_replay(recording: Recording, *, catalog: Catalog | None = None, compares: bool = True) -> Replay:
    """Build a replay of a recording, with ``catalog`` and ``compares`` as in ``Replay``.

    Raises
    ------
    RecordingError, SessionError
        If the recording does not hold its session, or that can't be built here.
    """
    from itouch.session.replaying import Replay

    with _Companion([recording.path]):
        return Replay(recording, catalog=catalog, compares=compares)


def prepare_text(
    scene: str, *, shown: str, seed: int, folder: str = ".", files: Mapping[str, bytes] | None = None
) -> Session:
    """Build an engine from the text of a canonical scene; the files that it names are in ``folder``, or given.

    Raises
    ------
    SceneError
        If it is wrong.
    """
    from itouch.plugin.discovery import Catalog
    from itouch.scene import loads
    from itouch.session import build

    catalog = Catalog()
    description = replace(loads(scene.encode(), catalog, shown=shown, files=files), folder=folder)
    return build(description, seed=seed, catalog=catalog)
