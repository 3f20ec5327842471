"""Pictures off the screen: what they show, and what is said when they can't be made."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from graphics import need_graphics
from program import program
from shipped import SCENES

import itouch

sys.path.insert(0, str(Path(__file__).parents[1] / "cli"))

from test_command_options import Terminal, lines_on_screen

DRAW = """
import sys, numpy as np, itouch
from itouch_tools.viewer.offscreen import Offscreen
from itouch_tools.viewer.overlay import SessionStatus
session = itouch.build(sys.argv[1])
shots = Offscreen(session.model, width=640, height=360)
pictures = {}
def take(name, **status):
    pictures[name] = shots.shoot(session.state, SessionStatus(**status))
session.run(3.0, each=lambda: shots.picture.ring.add(session.state), every=10)
take("free")
take("again")
ring = type(shots.picture.ring)
unmarked, ring.preparing = ring.preparing, lambda self: [(0.5, 2.0)]
take("marked")
ring.preparing = unmarked
shots.picture.choices.thermal = True
take("thermal")
shots.picture.choices.thermal = False
shots.picture.choices.help = True
take("help")
shots.picture.choices.help = False
take("fault", faults=[{"trip": "silence", "device": "table", "cause": "is silent"}])
session.run(5.5, each=lambda: shots.picture.ring.add(session.state), every=10)
take("contact")
camera, canvas = shots.picture.camera, shots.picture.canvas
for name in session.model.objects:
    index = session.model.objects.index(name)
    point = session.state["objects.pose"][index][:3].copy()
    point[2] += session.model.shapes[index].half_extents[2]
    point[1] -= 0.7 * session.model.shapes[index].half_extents[1]
    x, y = camera.project(point, 640, 360)
    picked = canvas.pick(session.state, camera, shots._frame, int(x), int(y))
    pictures["pick " + name] = np.array([picked == name])
    print(name, picked)
pictures["nothing"] = np.array([canvas.pick(session.state, camera, shots._frame, 2, 355) == ""])
shots.close()
np.savez(sys.argv[2], **pictures)
"""


#: Draw a scene of two fingers, and tell with which words, where the names of its curves stand, and what they are.
KEYS = """
import json, sys, itouch
from itouch_tools.viewer.offscreen import Offscreen
from itouch_tools.viewer.text import Text
session = itouch.build(sys.argv[1])
shots, told, put = Offscreen(session.model, width=1280, height=720), [], Text.put
def keep(self, words, x, y, *rest, size, **more):
    told.append((words, x, y, self.width(size) * len(words)))
    put(self, words, x, y, *rest, size=size, **more)
Text.put = keep
session.run(1.0, each=lambda: shots.picture.ring.add(session.state), every=10)
shots.shoot(session.state)
print(json.dumps([[signal.label for chart in shots.picture.ring.charts for signal in chart.signals], told]))
shots.close()
"""


def without_display() -> dict[str, str]:
    return {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    need_graphics()
    out = tmp_path_factory.mktemp("pictures") / "shots.npz"
    scene = str(SCENES / "four_materials.xml")
    done = subprocess.run([sys.executable, "-c", DRAW, scene, str(out)], capture_output=True, text=True,
                          env=without_display())  # fmt: skip
    assert done.returncode == 0, done.stderr
    return dict(np.load(out))


def changed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (np.abs(a.astype(int) - b.astype(int)).max(2) > 24).nonzero()


def test_the_same_state_gives_the_same_picture(pictures):
    assert len(changed(pictures["free"], pictures["again"])[0]) == 0


def test_a_picture_has_many_colours_and_a_dark_ground(pictures):
    free = pictures["free"]
    assert free.shape == (360, 640, 3)
    assert len(np.unique(free.reshape(-1, 3), axis=0)) > 300
    assert (free[0, 300] < 40).all()


def test_a_contact_shows_its_force_in_the_scene_and_in_the_curves(pictures):
    rows, columns = changed(pictures["free"], pictures["contact"])
    assert ((columns > 460).sum() > 200) and ((columns < 440).sum() > 500)
    contact = pictures["contact"][:, :440].astype(int)
    yellow = (contact[..., 0] > 150) & (contact[..., 1] > 140) & (contact[..., 2] < 120)
    assert yellow.sum() > 20


def test_the_time_in_which_the_heights_were_found_is_marked_in_the_curves_alone(pictures):
    _, columns = (pictures["free"].astype(int) != pictures["marked"]).any(2).nonzero()
    assert columns.size > 500 and columns.min() > 460


def test_help_faults_and_temperatures_are_seen(pictures):
    for name in ("help", "fault", "thermal"):
        assert len(changed(pictures["free"], pictures[name])[0]) > 300, name


def test_picking_finds_what_is_drawn_there(pictures):
    picked = {name: bool(value.all()) for name, value in pictures.items() if name.startswith("pick ")}
    assert all(picked.values()), picked
    assert pictures["nothing"].all()


def itouch_py(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "itouch_tools.cli", *words], capture_output=True, text=True,
                          env=without_display() | environment)  # fmt: skip


def test_run_writes_a_screenshot_and_a_film(tmp_path: Path):
    need_graphics()
    shot, film = tmp_path / "shot.png", tmp_path / "film.gif"
    done = itouch_py("run", str(SCENES / "first_touch.xml"), "--screenshot", str(shot), "--at", "1.2s", "--film",
                     str(film), "--size", "320x180")  # fmt: skip
    assert done.returncode == 0, done.stderr
    from PIL import Image

    with Image.open(shot) as picture:
        assert picture.size == (320, 180)
    with Image.open(film) as moving:
        assert moving.size == (320, 180)
        assert 20 <= moving.n_frames <= 30


@pytest.mark.parametrize("words", [(), ("--for", "2s")])
def test_a_film_says_how_far_it_is(tmp_path: Path, words: tuple[str, ...]) -> None:
    need_graphics()
    film = tmp_path / "film.gif"
    terminal = Terminal(
        "run", str(SCENES / "first_touch.xml"), "--film", str(film), "--size", "640x360", *words, env=without_display()
    )
    assert terminal.end() == 0, terminal.text
    line = re.compile(r" *[\d.]+ s  (\d+)%(, about \d+ s left)?  finger ")
    shares = [int(found[1]) for shown in lines_on_screen(terminal.text) if (found := line.match(shown))]
    assert len(shares) >= 2 and shares == sorted(shares) and shares[0] < 50 <= shares[-1] <= 99, terminal.text
    assert film.exists()


def test_run_writes_an_mp4(tmp_path: Path):
    need_graphics()
    film = tmp_path / "film.mp4"
    done = itouch_py("run", str(SCENES / "first_touch.xml"), "--film", str(film), "--size", "320x180", "--for", "0.4s")
    assert done.returncode == 0, done.stderr
    import av

    with av.open(str(film)) as moving:
        assert len(list(moving.decode(video=0))) == 10


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--at", "1s"), "give --screenshot"),
        (("--screenshot", "s.png", "--for", "1s", "--at", "5s"), "--at 5 s is after the end, which is at 1 s"),
        (("--film", "x.avi"), "ends in .mp4 or .gif"),
        (("--screenshot", "s.png", "--pace", "real"), "--pace fast"),
        (("--screenshot", "missing/s.png"), "no folder"),
        (("--screenshot", "s.png", "--size", "1x1"), "64 to 4096"),
    ],
)
def test_what_cannot_be_pictured_is_said(tmp_path: Path, words, says):
    done = program("run", str(SCENES / "first_touch.xml"), *words, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr and "Traceback" not in done.stderr


def test_a_picture_of_a_time_that_never_came_is_said(tmp_path: Path):
    need_graphics()
    shot, kept, report, film = (tmp_path / name for name in ("s.png", "z.itouch", "z.json", "z.gif"))
    done = itouch_py("run", str(SCENES / "first_touch.xml"), "--screenshot", str(shot), "--at", "999s",
                     "--save", str(kept), "--report", str(report), "--film", str(film), "--size", "320x180")  # fmt: skip
    assert done.returncode == 2
    assert "the run ended at" in done.stderr and "Traceback" not in done.stderr
    assert json.loads(report.read_text())["simulated_s"] > 2.0  # whatever failed, the rest is written
    assert itouch.restore(kept).seconds > 2.0 and film.stat().st_size > 1000


def test_each_curve_of_two_fingers_is_named_in_the_key() -> None:
    need_graphics()
    done = subprocess.run(
        [sys.executable, "-c", KEYS, str(SCENES / "two_fingers.xml")], capture_output=True, text=True, check=True,
        env=without_display(),
    )  # fmt: skip
    curves, told = json.loads(done.stdout.splitlines()[-1])
    assert len(curves) == 4
    keys = [next(place for place in told if place[0].startswith(name)) for name in curves]
    for words, x, y, wide in keys:
        assert x + wide <= 1280.0, f"{words} is cut"
        assert all(other is words or line != y or left >= x + wide or left < x for other, left, line, _ in keys)
