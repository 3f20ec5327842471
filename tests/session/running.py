"""Running scenes tick by tick, through faults, here and in a new process."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

from shipped import SCENES

import itouch


def _runs_by_itself(path: Path) -> bool:
    """Whether a scene has a finger that moves, and only twins: the promise of bytes does not cover hardware."""
    scene = itouch.load(path)
    return bool(scene.operators) and all(device.twin for device in scene.devices)


RUNNABLE = sorted(path.stem for path in SCENES.glob("*.xml") if _runs_by_itself(path))


def advance(session: itouch.Session, ticks: int) -> None:
    """Run to a tick; a fault's safe sequence counts, and the session goes on without what has failed."""
    while int(session.state["tick"]) < ticks:
        try:
            session.tick()
        except itouch.DeviceFaultError:
            continue


def digest(session: itouch.Session) -> str:
    return hashlib.sha256(session.state.tobytes()).hexdigest()


def in_a_new_process(saved: Path, ticks: int, again: Path | None = None) -> str:
    """Restore a session in a new process, run to a tick, perhaps save it; return the digest of its State."""
    here = str(Path(__file__).parent)
    code = f"""
import sys
sys.path[:0] = [{here!r}, {str(Path(here).parent)!r}]
import itouch
from running import advance, digest
session = itouch.restore({str(saved)!r})
advance(session, {ticks})
print(digest(session))
if {str(again or "")!r}:
    session.save({str(again or "")!r})
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.split()[-1]
