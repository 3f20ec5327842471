"""Building the engine for a run.  What must be compiled is compiled by two processes, and that is said."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from itouch.schema.terminal import MANNER

if TYPE_CHECKING:
    from itouch.session import Session

#: A start that has not ended after this time [s], and has not found a kernel on disk, is helped; how often is looked.
_PATIENCE, _LOOK = 1.6, 0.3
_LONGEST = 120.0


class _Companion:
    """A second process that compiles contact and twins while this one compiles the modalities; started if needed."""

    def __init__(self, words: list[str]) -> None:
        self._words = words
        self._process: subprocess.Popen[bytes] | None = None
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._look, name="itouch-companion", daemon=True)

    def _look(self) -> None:
        """Wait until something is compiled for long; a start that only loads is not helped, however long it takes."""
        wait = _PATIENCE
        while not self._over.wait(wait):
            compiling = sys.modules.get("itouch.compiling")
            if compiling is not None and compiling.KernelCache.missed:
                self._start()
                return
            wait = _LOOK

    def _start(self) -> None:
        if not MANNER.quiet:
            print("preparing: compiling the kernels that this needs for the first time, later starts load them ...",
                  file=sys.stderr, flush=True)  # fmt: skip
        command = [sys.executable, "-m", "itouch.servo.compile_ahead", *self._words, "--parent", str(os.getpid())]
        nothing = subprocess.DEVNULL
        self._process = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing)

    def __enter__(self) -> _Companion:
        self._watch.start()
        return self

    @property
    def started(self) -> bool:
        """Whether this is a first start."""
        return self._process is not None

    def wait(self) -> None:
        """Wait until the companion has compiled its part; whatever became of it, this process compiles the rest."""
        self._end()
        if self._process is not None:
            try:
                self._process.wait(_LONGEST)
            except subprocess.TimeoutExpired:
                self._process.kill()

    def _end(self) -> None:
        self._over.set()
        self._watch.join()  # so that no process is started after this

    def __exit__(self, *exception: object) -> None:
        self._end()
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.wait()


def prepare(scene: str, *, seed: int, twin: str | None, rig: str | None) -> Session:
    """Build an engine from a scene, or restore one from a session.

    Raises
    ------
    SceneError, SessionError
        If the file is wrong.
    """
    words = [scene, *(["--twin", twin] if twin else []), *(["--rig", rig] if rig else [])]
    with _Companion(words) as companion:
        from itouch.plugin.discovery import Catalog
        from itouch.session import Session, is_session, load_scene, restore

        if is_session(scene):
            companion.wait()
            return restore(scene)
        from itouch.loop.warm_up import warm_up_modalities
        from itouch.world import Model

        catalog = Catalog()
        model = Model.of(load_scene(scene, rig=rig, twin=twin, catalog=catalog), catalog)
        if companion.started:
            warm_up_modalities(model)
        companion.wait()
        return Session(model, seed=seed)


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
