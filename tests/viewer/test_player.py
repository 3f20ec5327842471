"""The window that plays a recording, on a virtual screen: keys and mouse as events; frames are driven by hand."""

from __future__ import annotations

import pytest
from graphics import need_graphics
from shipped import SCENES
from test_pictures import itouch_py
from windows import asked, drive, scripts_of

SCRIPTS = scripts_of("player")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("player") / "r.mcap"
    done = itouch_py("run", str(SCENES / "first_touch.xml"), "--record", str(path), "--for", "2.4s")
    assert done.returncode == 0, done.stderr
    return path


@pytest.fixture(scope="module")
def said(request, screen, recorded, tmp_path_factory):
    return drive(asked(request, SCRIPTS), [str(recorded)], screen, tmp_path_factory.mktemp("player-scripts"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_of_player_events_runs_without_an_error(name: str, said):
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
        (("--screenshot", str(tmp_path / "x.png"), "--at", "99s"), "after the end, which is at 2.4 s"),
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
