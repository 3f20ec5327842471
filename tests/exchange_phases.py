"""The phases of a touch of hardware behind exchanges, in step: found once a run of the tests, for all who begin there."""

from __future__ import annotations

import os
import pickle
import time
from pathlib import Path

import pytest
from shipped import SCENES

from itouch import platforms
from itouch_evidence.faults.behind_wires import Pair, stored

#: States of a host and its world by the name of the phase.
Phases = dict[str, tuple[bytes, bytes]]
_FOUND: Phases = {}


def wired() -> Pair:
    """Return a host of the four materials and its world: the display is exchanged with every 20 ms, in step."""
    return Pair(SCENES / "four_materials.xml", 20, threads=False, slots=2)


def wired_phases(factory: pytest.TempPathFactory) -> Phases:
    """Return the States in which such a pair is before each phase; of several workers one finds them, the others wait."""
    if not _FOUND:
        own = factory.getbasetemp()
        folder = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
        _FOUND.update(_read(folder / "wired-touch"))
    return _FOUND


def _read(path: Path) -> Phases:
    with path.open("a+b") as file:
        while True:
            try:
                platforms.claim(file.fileno())
                break
            except BlockingIOError:
                time.sleep(0.05)
        file.seek(0)
        if content := file.read():
            found: Phases = pickle.loads(content)
            return found
        pair = wired()
        found = stored(pair)
        pair.close()
        pickle.dump(found, file)
    return found
