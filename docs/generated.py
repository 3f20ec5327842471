"""Pictures of scenes for the docs, made by the program. Pages that it writes: reference_pages.py."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

HERE = Path(__file__).parent
SCENES = HERE.parent / "scenes"
VIEWER = HERE.parent / "framework" / "itouch_tools" / "viewer"
#: File name -> words of the command that makes the picture.
PICTURES = {
    "free": ("four_materials_hurried.xml", "--at", "14.5s", "--for", "14.6s"),
    "contact": ("four_materials_hurried.xml", "--at", "11s", "--for", "11.1s"),
    "approach": ("four_materials_hurried.xml", "--at", "7.2s", "--for", "7.3s"),
    "fault": ("faults.xml",),
    "gallery-first_touch": ("first_touch.xml", "--at", "1.2s", "--for", "1.3s"),
    "gallery-metamer": ("metamer.xml", "--at", "8s", "--for", "8.1s"),
    "gallery-mesh": ("mesh.xml", "--at", "2s", "--for", "2.1s"),
    "gallery-moving": ("moving.xml", "--at", "2s", "--for", "2.1s"),
    "gallery-two_fingers": ("two_fingers.xml", "--at", "1.5s", "--for", "1.6s"),
    "gallery-texture": ("texture.xml", "--at", "1.5s", "--for", "1.6s"),
    "gallery-texture_and_sound": ("texture_and_sound.xml", "--at", "5s", "--for", "5.1s"),
}


def drawn_by_commands() -> list[Callable[[], None]]:
    """Return what has to be done to have all pictures that commands make; each may run beside the others."""
    out = HERE / "_generated"
    out.mkdir(exist_ok=True)
    drawn = max(path.stat().st_mtime for path in VIEWER.glob("*.py"))
    jobs: list[Callable[[], None]] = []
    for name, (scene, *words) in PICTURES.items():
        picture = out / f"{name}.png"
        if not picture.exists() or picture.stat().st_mtime <= max(drawn, (SCENES / scene).stat().st_mtime):
            jobs.append(partial(_itouch_py, "run", str(SCENES / scene), "--screenshot", str(picture), *words))
    replay = out / "replay.png"
    if not replay.exists() or replay.stat().st_mtime < drawn:
        jobs.append(partial(_draw_replay, replay))
    return jobs


def _draw_replay(picture: Path) -> None:
    """Record a run and draw the window that plays it, in a process of its own: OpenGL wants its own thread."""
    with tempfile.TemporaryDirectory() as folder:
        recording = f"{folder}/four.mcap"
        scene = str(SCENES / "four_materials_hurried.xml")
        _itouch_py("run", scene, "--headless", "--for", "24s", "--record", recording)
        code = f"import sys; sys.path.insert(0, {str(HERE)!r}); import generated, pathlib; "
        code += f"generated.draw_played({recording!r}, pathlib.Path({str(picture)!r}))"
        subprocess.run([sys.executable, "-c", code], check=True)


def _itouch_py(*words: str) -> None:
    """Run a command.

    Raises
    ------
    RuntimeError
        If it fails.
    """
    command = [sys.executable, "-m", "itouch_tools.cli", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):  # 1: the scene of faults
        raise RuntimeError(f"{' '.join(command)}:\n{done.stderr}")


def draw_played(recording: str, picture: Path) -> None:
    """Draw the window that plays a recording, as it stands in the middle of a contact."""
    from itouch.recording import read
    from itouch_tools.viewer.context import write_png
    from itouch_tools.viewer.offscreen import Offscreen
    from itouch_tools.viewer.played_session import Playback
    from itouch_tools.viewer.recording_seek import SeekableRecording

    reel = SeekableRecording(read(recording))
    playback = Playback(reel)
    playback.pause()
    playback.seek(20.0)
    for _ in range(300):
        playback.advance(0.05, playback.curves)
        if playback.line.known.mean() > 0.7:
            break
        reel.work(1.0)  # in one go: a picture waits for nobody
    shots = Offscreen(playback.model)
    shots.picture.ring = playback.curves
    write_png(picture, shots.shoot(playback.state, playback.status))
    shots.close()
