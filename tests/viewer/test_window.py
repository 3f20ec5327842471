"""The window itself, on a virtual screen: every key, the mouse, resizing, closing; frames are driven by hand."""

from __future__ import annotations

import pytest
from shipped import SCENES
from windows import asked, drive

#: Runs before every script: a window on a session whose time the script turns.
PREPARE = """
import sys, numpy as np, itouch
from pathlib import Path
from pyglet.window import key, mouse
import pyglet
pyglet.options.audio = ("silent",)
from session_here import Local
from itouch_tools.viewer.window import Window
clock = [0.0]
begun = Path(sys.argv[3] + ".begun")
if not begun.exists():
    session = itouch.build(sys.argv[2])
    session.run(9.0)
    session.save(begun)
session = itouch.restore(begun)
source = Local(session, save_to=sys.argv[3])
window = Window(source, lambda: clock[0], width=640, height=400)
def turn(frames=1, period=1 / 60):
    for _ in range(frames):
        clock[0] += period
        window.dispatch_events()
        window.frame()
def tell(*event):
    window.dispatch_event(*event)  # into the queue
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
turn()
choices, camera = window.picture.choices, window.picture.camera
"""

SCRIPTS = {
    "time runs with the host's clock": """
        before = session.seconds
        turn(10, 0.05)
        assert abs(session.seconds - before - 0.5) < 0.003, session.seconds - before
    """,
    "P pauses and goes on": """
        press(key.P); before = session.seconds; turn(10)
        assert session.seconds == before and source.situation.paused
        press(key.P); turn(10)
        assert session.seconds > before
    """,
    "H, T, G and C change the picture and change it back": """
        press(key.P); turn()
        plain = pixels()
        for symbol, name in ((key.H, "help"), (key.T, "thermal"), (key.G, "aids"), (key.C, "curves")):
            before = getattr(choices, name)
            press(symbol); turn()
            assert getattr(choices, name) is not before
            assert changed(plain, pixels()) > 150, name
            press(symbol); turn()
            assert changed(plain, pixels()) == 0, name
    """,
    "D puts the curves below the scene and beside it again": """
        press(key.P); turn()
        plain = pixels()
        press(key.D); turn()
        assert window.picture.under and changed(plain, pixels()) > 5000
        press(key.D); turn()
        assert not window.picture.under and changed(plain, pixels()) == 0
    """,
    "pointing into a curve tells what all were then": """
        press(key.P); turn()
        plain = pixels()
        ratio = window.get_pixel_ratio()
        x, y = int(540 / ratio), int(350 / ratio)
        window.dispatch_event("on_mouse_motion", x, y, 0, 0); turn()
        told = (np.abs(plain - pixels()).max(2) > 24).any(0).nonzero()[0]
        assert len(told) and told.min() > 640 * 0.6  # in the charts alone
        column = (np.abs(plain - pixels()).max(2) > 24)[:, 540]
        assert column.sum() > 40  # a line through all of them
        window.dispatch_event("on_mouse_leave", 0, 0); turn()
        assert changed(plain, pixels()) == 0
    """,
    "numbers choose views and F frames": """
        seen = set()
        for symbol in (key._1, key._2, key._3, key._4, key._5):
            press(symbol); turn()
            seen.add((camera.azimuth, camera.elevation))
        assert len(seen) == 5
        camera.distance = 9.0
        press(key.F)
        assert camera.distance < 1.5
    """,
    "the mouse orbits, pans, zooms": """
        before = camera.azimuth
        tell("on_mouse_press", 100, 100, mouse.LEFT, 0)
        tell("on_mouse_drag", 130, 100, 30, 0, mouse.LEFT, 0)
        assert camera.azimuth != before
        tell("on_mouse_release", 130, 100, mouse.LEFT, 0)
        assert source.situation.picked == ""
        target = camera.target
        tell("on_mouse_drag", 130, 100, 30, 0, mouse.LEFT, key.MOD_SHIFT)
        assert camera.target != target
        target = camera.target
        tell("on_mouse_drag", 130, 100, 30, 0, mouse.MIDDLE, 0)
        assert camera.target != target
        distance = camera.distance
        tell("on_mouse_scroll", 100, 100, 0, 2)
        assert camera.distance < distance
    """,
    "a click shows the properties of what is there": """
        x, y = camera.project(np.array([-0.022, -0.025, 0.018]), *window.get_framebuffer_size())
        tell("on_mouse_press", int(x), int(y), mouse.LEFT, 0)
        tell("on_mouse_release", int(x), int(y), mouse.LEFT, 0)
        assert source.situation.picked == "pyrex", source.situation.picked
        turn()
    """,
    "S saves a session that can be restored": """
        press(key.S); turn()
        assert "saved" in source.situation.message
        assert itouch.restore(sys.argv[3]).seconds > 9.0
        source._save_to = sys.argv[2] + "/x.itouch"
        press(key.S)
        assert "x.itouch" in source.situation.message
    """,
    "M gives the finger to mouse and arrows": """
        press(key.M)
        assert "mouse moves" in source.situation.message
        before = session.state["finger.hand.target"].copy()
        tell("on_mouse_motion", 10, 10, 100, -50)
        turn(7, 0.05)
        np.testing.assert_allclose(session.state["finger.hand.target"] - before, (0.01, -0.005, 0), atol=1e-9)
        tell("on_mouse_scroll", 10, 10, 0, 3)
        tell("on_key_press", key.RIGHT, 0)
        turn(10)
        tell("on_key_release", key.RIGHT, 0)
        turn(7, 0.05)
        np.testing.assert_allclose(session.state["finger.hand.target"] - before, (0.015, -0.005, 0.003), atol=1e-9)
        press(key.M); turn(10, 0.05)
        assert not session.state["finger.hand.offset"].any()
    """,
    "the menu pauses, saves, and stops safely": """
        def click(name, where=-1):
            found = [place for place in window.picture.menu if place.key == name]
            x, y, w, h = found[where].area
            tell("on_mouse_press", int(x + w / 2), int(y + h / 2), mouse.LEFT, 0)
            tell("on_mouse_release", int(x + w / 2), int(y + h / 2), mouse.LEFT, 0)
        click("H", 0); turn()
        assert choices.help and len(window.picture.menu) >= 20
        click("P"); turn(); assert source.situation.paused
        click("S"); assert "saved" in source.situation.message
        click("ESCAPE")
        assert window.closed and source.stopped
    """,
    "the menu does by mouse what the keys do": """
        def click(symbol, last=True):
            turn()
            found = [place for place in window.picture.menu if getattr(key, place.key) == symbol]
            x, y, w, h = (found[-1] if last else found[0]).area
            window.dispatch_event("on_mouse_motion", int(x + w / 2), int(y + h / 2), 1, 1); turn()
            tell("on_mouse_press", int(x + w / 2), int(y + h / 2), mouse.LEFT, 0)
            held = source.held if hasattr(source, "held") else None
            if not window.closed:
                tell("on_mouse_drag", int(x + w / 2) + 2, int(y), 2, 0, mouse.LEFT, 0)
                tell("on_mouse_release", int(x + w / 2), int(y + h / 2), mouse.LEFT, 0)
            return held
        window.set_size(900, 560); tell("on_resize", 900, 560)
        press(key.P); turn()
        closed = pixels()
        azimuth = camera.azimuth
        click(key.H, last=False)
        turn()
        assert choices.help and len(window.picture.menu) >= 20 and changed(closed, pixels()) > 1000
        for symbol, name in ((key.T, "thermal"), (key.G, "aids"), (key.C, "curves"), (key.N, "names"), (key.L, "light")):
            before = getattr(choices, name)
            click(symbol)
            assert getattr(choices, name) is not before, name
            click(symbol)
            assert getattr(choices, name) is before, name
        click(key.PLUS); assert choices.larger == 1.25
        click(key.MINUS); assert choices.larger == 1.0
        assert camera.azimuth == azimuth and source.situation.picked == ""  # a press is no drag and no click
        seen = set()
        for number in (key._1, key._2, key._3, key._4, key._5):
            click(number); seen.add((camera.azimuth, camera.elevation))
        assert len(seen) == 5
        click(key.P); assert not source.situation.paused
        click(key.P); assert source.situation.paused
        click(key.S); assert "saved" in source.situation.message
        said = []
        source.hold = said.append
        click(key.SPACE); assert said == [True, False]
        tell("on_mouse_press", 300, 300, mouse.LEFT, 0); tell("on_mouse_release", 300, 300, mouse.LEFT, 0)
        assert choices.help
        click(key.H); turn(); assert not choices.help
        click(key.H, last=False); click(key.ESCAPE)
        assert window.closed and source.stopped
    """,
    "a gamepad moves the finger, and rests near its middle": """
        from types import SimpleNamespace
        from itouch.arms.gamepad import Pad
        controller = SimpleNamespace(leftx=1.0, lefty=0.0, righty=0.5, device=None, open=lambda: None)
        window._steering.pad = Pad(controller)
        before = session.state["finger.hand.target"].copy()
        turn(5)
        assert not session.state["finger.hand.offset"].any()
        press(key.M); turn(10)
        moved = session.state["finger.hand.target_offset"]
        assert moved[0] > 8e-3 and moved[2] < -3e-3  # a stick that is pulled is positive
        controller.leftx = controller.righty = 0.05
        still = moved.copy(); turn(5)
        assert (session.state["finger.hand.target_offset"] == still).all()
    """,
    "resizing keeps everything in place": """
        for size in ((900, 500), (320, 200), (1, 1), (640, 400)):
            window.set_size(*size)
            tell("on_resize", *size)
            turn(2)
        assert window._target.width == window.get_framebuffer_size()[0]
        assert len(np.unique(pixels().reshape(-1, 3), axis=0)) > 200
    """,
    "a lost context is made anew": """
        press(key.P); press(key.T); turn()
        plain = pixels()
        tell("on_context_lost"); turn()
        assert choices is window.picture.choices and changed(plain, pixels()) == 0
    """,
    "Esc stops safely and closes": """
        press(key.ESCAPE)
        assert window.closed and source.stopped
    """,
    "the window's cross does, too": """
        tell("on_close")
        assert window.closed and source.stopped
    """,
    "a fault is told in words": """
        press(key.P); turn(); plain = pixels()
        source.situation.faults = [{"trip": "silence", "device": "table", "cause": "is silent"}]
        turn()
        assert changed(plain, pixels()) > 300
    """,
    "an unknown key does nothing": """
        press(key.F12); press(key.Q); turn(2)
        assert not window.closed
    """,
}


@pytest.fixture(scope="module")
def said(request, screen, tmp_path_factory):
    folder = tmp_path_factory.mktemp("window")
    words = [str(SCENES / "four_materials.xml"), str(folder / "saved.itouch")]
    return drive(PREPARE, asked(request, SCRIPTS), words, screen, folder)


@pytest.mark.parametrize("name", SCRIPTS)
def test_window(name: str, said):
    assert not said[name], said[name]
