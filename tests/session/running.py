"""Running scenes tick by tick, through faults, here and in a new process."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections.abc import Sequence
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


def in_a_new_process(saved: Sequence[Path], ticks: int) -> list[str]:
    """Restore sessions in one new process, one after the other; return digests of their States, or what went wrong."""
    here = str(Path(__file__).parent)
    code = f"""
import sys, traceback
sys.path[:0] = [{here!r}, {str(Path(here).parent)!r}]
import itouch
from running import advance, digest
for path in {[str(path) for path in saved]!r}:
    try:
        session = itouch.restore(path)
        advance(session, {ticks})
        print("at the end:", digest(session))
    except Exception as error:
        print("at the end:", repr(traceback.format_exc()[-1500:]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    return [line.split(":", 1)[1].strip() for line in done.stdout.splitlines() if line.startswith("at the end:")]
