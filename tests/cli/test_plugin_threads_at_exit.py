"""A plugin's thread that goes on for ever does not keep the program from its end."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from shipped import SCENES
from third_party_plugins import install

PLUGIN = """
import threading, time
from dataclasses import dataclass
from itouch.plugin import Modality

@dataclass(frozen=True, slots=True)
class Nothing:
    "Nothing to set."

class Listens(Modality):
    "Listens to something for ever."
    Params = Nothing
    def compile(self, name, params, world):
        threading.Thread(target=time.sleep, args=(900.0,), name="listener", daemon={daemon}).start()
        return params
    def reset(self, model, state):
        pass
    def update(self, model, state, period):
        pass
"""
PROGRAM = "from itouch_tools.cli import main; raise SystemExit(main())"


def run(folder: Path, daemon: bool) -> subprocess.CompletedProcess[str]:
    code = PLUGIN.format(daemon=daemon)
    install(folder, "listens", "[itouch.modalities]\nlistens.here = listens:Listens\n", code=code)
    text = (SCENES / "first_touch.xml").read_text(encoding="utf-8")
    text = text.replace("<itouch ", '<itouch xmlns:listens="urn:itouch:plugin:listens" ', 1)
    text = text.replace("</interaction>", '<listens:here name="ears"/></interaction>')
    (folder / "scene.xml").write_text(text, encoding="utf-8")
    words = ["run", str(folder / "scene.xml"), "--headless", "--pace", "fast", "--for", "0.05 s"]
    path = os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", "")))
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, timeout=600, check=False,
        env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip


def test_a_thread_that_goes_on_does_not_keep_the_program_and_is_told(tmp_path: Path) -> None:
    ended = run(tmp_path, daemon=False)
    assert ended.returncode == 0, ended.stderr
    assert "thread still runs: 'listener'" in ended.stderr
    assert "simulated" in ended.stdout  # what it had to say has gone out


def test_a_thread_that_ends_with_the_program_is_not_told(tmp_path: Path) -> None:
    ended = run(tmp_path, daemon=True)
    assert ended.returncode == 0, ended.stderr
    assert "still run" not in ended.stderr
