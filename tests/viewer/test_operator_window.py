"""The operator's window on a screen: its keys, and a whole session beside it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from windows import drive

sys.path.insert(0, str(Path(__file__).parents[1] / "study"))
from run_scene import write_study

PREPARE = """
from types import SimpleNamespace
from pyglet.window import key
from itouch_tools.viewer.study_screens import LIGHT
from itouch_tools.viewer.participant_window import AskingWindow
from itouch_tools.viewer.operator_window import OperatorWindow
face = SimpleNamespace(cue="contact", question="", choices=(), left=2.0, force=None, window=None, trial=3, trials=9, void=1, message="")
window = OperatorWindow(look=LIGHT)
lines = [("arm: enabled", True), ("table: fault", False)]
def picture():
    window.show(face, lines)
    window.switch_to()
    return window._frame.read().copy()
"""
SCRIPTS = {
    "keys": """
        window.on_key_press(key.N, 0)
        window.on_text("n")  # the letter that began it
        for letter in "no air": window.on_text(letter)
        window.on_key_press(key.BACKSPACE, 0)
        window.on_key_press(key.P, 0)  # a letter now
        assert not window.paused and not window.stopped
        window.on_key_press(key.ENTER, 0)
        assert window.notes() == ["no ai"] and window.notes() == []
        window.on_key_press(key.N, 0)
        window.on_key_press(key.ESCAPE, 0)
        assert window.notes() == [] and not window.stopped
        window.on_key_press(key.P, 0)
        assert window.paused
        window.on_key_press(key.P, 0)
        assert not window.paused
        window.on_key_press(key.ESCAPE, 0)
        assert window.stopped
    """,
    "the switch is held while Space is down and the window has the keys": """
        window.on_key_press(key.SPACE, 0)
        assert window.held
        window.on_key_release(key.SPACE, 0)
        assert not window.held
        window.on_key_press(key.SPACE, 0)
        window.on_deactivate()
        assert not window.held
        window.on_key_press(key.SPACE, 0)
        window.on_close()
        assert not window.held and window.stopped
        window.on_key_press(key.N, 0)
        window.on_key_press(key.SPACE, 0)  # a letter of the note
        assert not window.held
    """,
    "it shows what changes, beside the participant's": """
        before = picture()
        other = AskingWindow()
        other.show_face(face)
        assert (picture() == before).all()
        lines[1] = ("table: enabled", True)
        after = picture()
        assert (after != before).any()
        window.on_key_press(key.P, 0)
        assert (picture() != after).any()
        other.close()
    """,
}


def test_the_window_on_a_screen(screen: Mapping[str, str], tmp_path: Path) -> None:
    said = drive(PREPARE, SCRIPTS, [], screen, tmp_path)
    assert said == dict.fromkeys(SCRIPTS, "")


def test_a_session_is_seen_by_the_operator(screen: Mapping[str, str], tmp_path: Path) -> None:
    """The command opens the window, and the rows are made beside it; without a screen it says so."""
    answers, study = tmp_path / "answers.txt", write_study(tmp_path, repetitions=1)
    answers.write_text("wood\nsteel\ncork\n")
    words = [sys.executable, "-m", "itouch_tools.cli", "study", "run", str(study), "--participant", "P1", "--operator"]
    words += ["--answers", str(answers)]
    bare = {name: value for name, value in screen.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(words, capture_output=True, text=True, env=bare, timeout=300)
    assert done.returncode == 2
    assert "no window" in done.stderr and "Traceback" not in done.stderr
    done = subprocess.run(words, capture_output=True, text=True, env=dict(screen), timeout=300)
    assert done.returncode == 0, done.stderr
    assert "all done: 3 new trials" in done.stdout
    assert not any(word in done.stdout for word in ("wood", "steel", "cork"))
