"""The operator's window on a screen: its keys, and a whole session beside it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from windows import drive, scripts_of

sys.path.insert(0, str(Path(__file__).parents[1] / "study"))
from run_scene import write_study

SCRIPTS = scripts_of("operator_window")


def test_the_window_on_a_screen(screen: Mapping[str, str], tmp_path: Path) -> None:
    said = drive(SCRIPTS, [], screen, tmp_path)
    assert said == dict.fromkeys(SCRIPTS, "")


def test_a_session_is_seen_by_the_operator(screen: Mapping[str, str], tmp_path: Path) -> None:
    """The command opens the window, and the rows are made beside it; without a screen it says so."""
    answers, study = tmp_path / "answers.txt", write_study(tmp_path, repetitions=1)
    answers.write_text("wood\nsteel\ncork\n")
    words = [sys.executable, "-m", "itouch_tools.cli", "study", "run", str(study), "--participant", "P1", "--operator"]
    words += ["--answers", str(answers)]
    bare = {name: value for name, value in screen.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(words, capture_output=True, text=True, env=bare, timeout=600)
    assert done.returncode == 2
    assert "no window" in done.stderr and "Traceback" not in done.stderr
    done = subprocess.run(words, capture_output=True, text=True, env=dict(screen), timeout=600)
    assert done.returncode == 0, done.stderr
    assert "all done: 3 new trials" in done.stdout
    assert not any(word in done.stdout for word in ("wood", "steel", "cork"))
