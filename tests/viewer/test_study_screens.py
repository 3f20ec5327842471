"""The screens of a study, off the screen: readable from 2 m, light and dark, and the same whatever is touched."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from graphics import need_graphics

DRAW = """
import json, sys
import numpy as np
from types import SimpleNamespace
from itouch_tools.viewer.offscreen import open_context
width, height = int(sys.argv[1]), int(sys.argv[2])
window = open_context(width, height)
from itouch_tools.viewer.study_screens import DARK, LIGHT, StudyScreen
from itouch_tools.viewer.buffers import Frame
frame = Frame(width, height)
def face(cue, **more):
    plain = dict(question="", choices=(), left=None, force=None, window=None, trial=3, trials=10, void=0, message="")
    return SimpleNamespace(cue=cue, **{**plain, **more})
def rows_of_ink(picture, ground):
    return (np.abs(picture.astype(int) - ground).max(axis=2) > 60).any(axis=1)
def longest(rows):
    best = run = 0
    for row in rows:
        run = run + 1 if row else 0
        best = max(best, run)
    return best
found = {}
for name, look in (("dark", DARK), ("light", LIGHT)):
    board = StudyScreen(look)
    said = found[name] = {}
    board.participant(face("go"), frame)
    picture = frame.read()
    upper = picture[: int(0.9 * height)]
    ground = picture[0, 0].astype(int)
    said["letter"] = longest(rows_of_ink(upper, ground)) / height
    said["again"] = bool((board.participant(face("go"), frame), (frame.read() == picture).all())[1])
    names = ("aluminium", "pyrex", "wood", "pmma", "polystyrene foam, extruded")
    board.participant(face("answer", question="What did you touch?", choices=names), frame)
    said["targets"] = [[x / width, y / height, w / width, h / height] for x, y, w, h in board.targets]
    said["hits"] = [board.hit(x + w / 2, y + h / 2) for x, y, w, h in board.targets]
    said["miss"] = board.hit(1, height - 1)
    bars = []
    for force in (0.0, 0.5, 1.0, 1.9, 50.0, float("nan")):
        board.participant(face("contact", force=force, window=(0.7, 1.3)), frame)
        bars.append(frame.read())
    said["bars differ"] = [bool((a != b).any()) for a, b in zip(bars, bars[1:3])]
    board.participant(face("go"), frame, page=["# Heading", "", "- item " + "word " * 200])
    said["page"] = bool((frame.read() != picture).any())
    board.operator(face("contact", left=2.0), [("arm: enabled", True), ("table: fault", False)], frame)
    said["operator"] = bool((frame.read() != picture).any())
    luminance = lambda c: sum(w * (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4) for w, v in zip((0.2126, 0.7152, 0.0722), c))
    pairs = [(look.ink, look.ground), (look.quiet, look.ground), (look.ink, look.box)]
    ratios = [sorted((luminance(a), luminance(b))) for a, b in pairs]
    said["contrast"] = [(high + 0.05) / (low + 0.05) for low, high in ratios]
print(json.dumps(found))
"""


@pytest.mark.parametrize(("width", "height"), [(1280, 720), pytest.param(3840, 2160, marks=pytest.mark.long)])
def test_the_screens_can_be_read(tmp_path: Path, width: int, height: int) -> None:
    need_graphics()
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run([sys.executable, "-c", DRAW, str(width), str(height)], capture_output=True, text=True,
                          env=environment, timeout=600)  # fmt: skip
    assert done.returncode == 0, done.stderr
    for name, said in json.loads(done.stdout).items():
        assert said["letter"] > 0.04, name  # 12 mm on a screen of 0.3 m: 20 minutes of arc at 2 m
        assert said["again"]
        assert said["hits"] == [0, 1, 2, 3, 4]
        assert said["miss"] is None
        for x, y, wide, tall in said["targets"]:
            assert 0 <= x <= x + wide <= 1
            assert 0 <= y <= y + tall <= 1
            assert wide > 0.2
            assert tall > 0.15
        assert all(said["bars differ"])
        assert said["page"]
        assert said["operator"]
        assert min(said["contrast"]) > 7.0, name  # WCAG AAA
