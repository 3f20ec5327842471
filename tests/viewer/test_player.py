"""The window that plays a recording, on a virtual screen: keys and mouse as events; frames are driven by hand."""

from __future__ import annotations

import pytest
from graphics import need_graphics
from shipped import SCENES
from test_pictures import itouch_py
from windows import asked, drive

PREPARE = """
import sys, numpy as np, itouch, pyglet
pyglet.options.audio = ("silent",)
from pyglet.window import key, mouse
from itouch_tools.viewer.playback import Playback
from itouch_tools.viewer.player import Player
from itouch_tools.viewer.recording_seek import SeekableRecording
clock = [0.0]
reel = SeekableRecording(itouch.read(sys.argv[2]))
playback = Playback(reel)
window = Player(playback, lambda: clock[0], width=640, height=360)
line, state = playback.line, playback.state
def turn(frames=1, period=1 / 60):
    for _ in range(frames):
        clock[0] += period
        window.dispatch_events()
        window.frame()
    while line.reading:
        window.frame()
def tell(*event):
    window.dispatch_event(*event)
    window.dispatch_events()
def press(symbol, modifiers=0):
    tell("on_key_press", symbol, modifiers)
    if not window.closed:
        tell("on_key_release", symbol, modifiers)
def pixels():
    window.switch_to()
    return window._target.read().astype(int)
def changed(a, b):
    return int((np.abs(a - b).max(2) > 24).sum())
def at(share):
    left, bottom, width, height = window.picture.bar
    return int(left + share * width), int(bottom + height / 2)
turn()
"""

SCRIPTS = {
    "P and Space play and pause": """
        begin = line.now; turn(30)
        assert abs(line.now - begin - 30 / 60) < 0.003, line.now
        for symbol in (key.P, key.SPACE):
            press(symbol); before = line.now; turn(10)
            assert not line.playing and line.now == before
            press(symbol); turn(5)
            assert line.playing and line.now > before
    """,
    "arrows step by one tick, with Shift by a hundred, and repeat while held": """
        press(key.P); playback.seek(1.0); turn()
        for symbol, modifiers, ticks in ((key.RIGHT, 0, 1), (key.LEFT, 0, -1), (key.RIGHT, key.MOD_SHIFT, 100),
                                         (key.LEFT, key.MOD_SHIFT, -100)):
            before = int(state["tick"]); press(symbol, modifiers); turn()
            assert int(state["tick"]) - before == ticks
        before = int(state["tick"])
        tell("on_key_press", key.RIGHT, 0); turn(15, 1 / 15); tell("on_key_release", key.RIGHT, 0)
        after = int(state["tick"])
        assert 5 < after - before < 20, after - before
        turn(5, 0.1)
        assert int(state["tick"]) == after
    """,
    "up and down change the speed": """
        press(key.UP); press(key.UP); before = line.now
        for _ in range(6): turn(1, 0.01)  # waits where nothing was read yet
        assert line.speed == 4.0 and abs(line.now - before - 0.24) < 0.05, line.now - before
        for _ in range(4): press(key.DOWN)
        assert line.speed == 0.25
    """,
    "page and home and end go where something happened": """
        press(key.P); press(key.HOME); turn()
        stops = []
        for _ in range(len(line.stops)):
            stops.append(round(line.now, 3)); press(key.PAGEDOWN); turn()
        assert stops == [round(stop, 3) for stop in line.stops], (stops, line.stops)
        press(key.PAGEUP); turn()
        assert round(line.now, 3) == stops[-2]
        press(key.END); turn()
        assert line.now == line.last
    """,
    "the mouse winds on the time line and orbits beside it": """
        press(key.P); turn()
        camera = window.picture.camera; before = camera.azimuth
        tell("on_mouse_press", *at(0.25), mouse.LEFT, 0); turn()
        assert abs(line.now - (line.first + 0.25 * (line.last - line.first))) < 0.02
        tell("on_mouse_drag", *at(0.8), 300, 0, mouse.LEFT, 0); turn()
        assert abs(line.now - (line.first + 0.8 * (line.last - line.first))) < 0.02
        tell("on_mouse_drag", 5000, at(0)[1], 300, 0, mouse.LEFT, 0); turn()
        assert line.now == line.last and camera.azimuth == before
        tell("on_mouse_release", *at(0.8), mouse.LEFT, 0)
        assert window.playback.situation.picked == ""
        tell("on_mouse_press", 200, 200, mouse.LEFT, 0)
        tell("on_mouse_drag", 230, 200, 30, 0, mouse.LEFT, 0)
        assert camera.azimuth != before and line.now == line.last
    """,
    "the picture follows, and is the same when one comes back": """
        press(key.P); playback.seek(0.2); clock[0] += 5
        while not line.known.all(): reel.work(0.1); line.known = reel.known(200)
        turn(2); first = pixels()
        playback.seek(1.5); turn(2)
        assert changed(first, pixels()) > 500
        playback.seek(0.2); turn(2)
        assert changed(first, pixels()) == 0
    """,
    "H lists these keys, views and a lost context work as ever": """
        press(key.P); clock[0] += 5; turn(2); plain = pixels()
        press(key.H); turn()
        assert changed(plain, pixels()) > 1000
        press(key.H); press(key._4); turn()
        assert window.picture.camera.elevation > 80
        press(key.M); press(key.S); press(key.R)
        assert "recording" in playback.situation.message
        tell("on_context_lost"); turn()
        assert window.picture.ring is playback.curves and window.picture.bar is not None
        window.set_size(500, 300); tell("on_resize", 500, 300); turn(2)
        window.set_size(1, 1); tell("on_resize", 1, 1); turn(2)
        assert not window.closed
    """,
    "Esc closes": """
        press(key.ESCAPE)
        assert window.closed
    """,
}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("player") / "r.mcap"
    done = itouch_py("run", str(SCENES / "first_touch.xml"), "--record", str(path), "--for", "2.4s")
    assert done.returncode == 0, done.stderr
    return path


@pytest.fixture(scope="module")
def said(request, screen, recorded, tmp_path_factory):
    return drive(PREPARE, asked(request, SCRIPTS), [str(recorded)], screen, tmp_path_factory.mktemp("player-scripts"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_player(name: str, said):
    assert not said[name], said[name]


def test_pictures_of_a_recording(recorded, tmp_path):
    need_graphics()
    shot, film = tmp_path / "shot.png", tmp_path / "film.gif"
    done = itouch_py("replay", str(recorded), "--screenshot", str(shot), "--at", "1.2s", "--film", str(film), "--size",
                     "320x180")  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "0 mismatches" in done.stdout
    from PIL import Image

    with Image.open(shot) as picture, Image.open(film) as moving:
        assert picture.size == moving.size == (320, 180)
        assert 22 <= moving.n_frames <= 26
    again = tmp_path / "again.png"
    done = itouch_py("run", str(SCENES / "first_touch.xml"), "--screenshot", str(again), "--at", "1.2s", "--for", "1.3s",
                     "--film", str(tmp_path / "again.gif"), "--size", "320x180")  # fmt: skip
    assert done.returncode == 0 and again.read_bytes() == shot.read_bytes()


def test_what_cannot_be_viewed_is_said(recorded, tmp_path):
    for words, says in (
        (("--view",), "no display"),
        (("--view", "--screenshot", "x.png"), "choose one"),
        (("--at", "1s"), "--screenshot"),
        (("--screenshot", str(tmp_path / "x.png"), "--at", "99s"), "the run ended at"),
    ):
        done = itouch_py("replay", str(recorded), *words)
        assert done.returncode == 2 and says in done.stderr and "Traceback" not in done.stderr, done.stderr
    done = itouch_py("replay", str(recorded), "--view", DISPLAY=":999")
    assert done.returncode == 2 and "no display" in done.stderr and "Traceback" not in done.stderr


def test_what_cannot_be_opened_in_a_window_is_said(recorded, tmp_path, screen):
    display = screen["DISPLAY"]
    done = itouch_py("replay", str(tmp_path / "none.mcap"), "--view", DISPLAY=display)
    assert done.returncode == 2 and "none.mcap" in done.stderr
    done = itouch_py("replay", str(recorded), "--view", DISPLAY=display, MESA_GL_VERSION_OVERRIDE="2.1")
    assert done.returncode == 2 and "no OpenGL 3.3 window" in done.stderr and "Traceback" not in done.stderr
