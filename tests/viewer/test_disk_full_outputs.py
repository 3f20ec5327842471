"""Pictures, films and sounds for which the disk has no room: what was there stays, and nothing is left beside it."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from graphics import need_graphics
from program import program
from shipped import SCENES

#: Most bytes of a file that the program may write: fewer than any of the outputs has.
ROOM = 1500


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("kept") / "run.mcap"
    done = program("run", str(SCENES / "first_touch.xml"), "--headless", "--for", "1.2s", "--record", str(path))
    assert done.returncode == 0, done.stderr
    return path


@pytest.mark.parametrize(
    ("command", "option", "name"),
    [
        ("replay", "--film", "a.mp4"), ("replay", "--film", "a.gif"), ("replay", "--screenshot", "a.png"),
        ("replay", "--wav", "a.wav"), ("export", "--layout", "a.json"),
    ],
)  # fmt: skip
def test_what_finds_no_room_on_the_disk_leaves_what_was_there(
    kept: Path, tmp_path: Path, command: str, option: str, name: str
) -> None:
    if option in ("--film", "--screenshot"):
        need_graphics()
    (tmp_path / name).write_bytes(b"the old one")
    words = [command, str(kept), option, name, *(("--size", "320x240") if option == "--film" else ())]
    done = subprocess.run(
        [sys.executable, "-B", "-m", "itouch_tools.cli", *words], cwd=tmp_path, capture_output=True, text=True,
        env={key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, ROOM)),
    )  # fmt: skip
    assert done.returncode == 2 and f"cannot write '{name}': File too large" in done.stderr, done.stderr
    assert (tmp_path / name).read_bytes() == b"the old one"
    assert [path.name for path in tmp_path.iterdir()] == [name]
