"""Arms that a person leads, in a window on a virtual screen: from its first frame on, without a key."""

from __future__ import annotations

import pytest
from windows import drive

SCENE = """<itouch version="1.0" xmlns:PLUGIN="urn:itouch:plugin:PLUGIN">
  <materials><material name="wood"><contact stiffness="0.8 N/mm"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices><device name="arm" plugin="PLUGIN"><PLUGIN:hardware start="0 0 40 mm" WAY/></device></devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/></interaction></itouch>"""

PREPARE = """
import sys, numpy as np, itouch
from types import SimpleNamespace
from pyglet.window import key
import pyglet
pyglet.options.audio = ("silent",)
from itouch.arms import gamepad
controller = SimpleNamespace(name="fake", leftx=0.0, lefty=0.0, righty=0.0, device=None, open=lambda: None, close=lambda: None)
from itouch_tools.viewer import steering
if sys.argv[-1].endswith("gamepad.xml"):
    steering.find_pad = lambda: gamepad.Pad(controller)
from session_here import Local
from itouch_tools.viewer.window import Window
clock = [0.0]
session = itouch.build(sys.argv[-1])
source = Local(session)
window = Window(source, lambda: clock[0], width=320, height=240)
def turn(frames=1, period=1 / 60):
    for _ in range(frames):
        clock[0] += period
        window.dispatch_events()
        window.frame()
def tell(*event):
    window.dispatch_event(*event)
    window.dispatch_events()
said = source.situation.message
turn()
state = session.state
"""

MOUSE = {
    "the mouse leads it from the begin": """
        assert "mouse leads" in said, said
        np.testing.assert_allclose(state["finger.hand.target"], (0, 0, 0.04), atol=1e-9)
        tell("on_mouse_motion", 10, 10, 30, -10)
        turn(20)
        np.testing.assert_allclose(state["finger.hand.target"], (0.006, -0.002, 0.04), atol=1e-9)
    """,
    "the wheel lowers it onto the block, and the arm pushes back": """
        tell("on_mouse_scroll", 10, 10, 0, -9)
        turn(60)
        assert abs(state["finger.hand.target"][2] - 0.022) < 1e-9
        assert 0.3 < float(state["arm.sent.wrench"][2]) < 2.0, state["arm.sent.wrench"]
        assert state["finger.hip"][2] > 0.0225
    """,
    "M gives it away and takes it back": """
        tell("on_key_press", key.M, 0); turn(30)
        before = state["finger.hand.target"].copy()
        tell("on_mouse_motion", 10, 10, 100, 0); turn(10)
        assert (state["finger.hand.target"] == before).all()
        tell("on_key_press", key.M, 0); tell("on_mouse_motion", 10, 10, 10, 0); turn(20)
        assert state["finger.hand.target"][0] > before[0]
    """,
}
KEYBOARD = {
    "held keys lead it at the arm's speed": """
        assert "arrow keys lead" in said, said
        before = state["finger.hand.target_offset"].copy()
        tell("on_key_press", key.UP, 0); tell("on_key_press", key.PAGEDOWN, 0)
        turn(30)
        tell("on_key_release", key.UP, 0); tell("on_key_release", key.PAGEDOWN, 0)
        turn(3)
        np.testing.assert_allclose(state["finger.hand.target_offset"] - before, (0, 0.025, -0.025), atol=1e-9)
    """,
    "the mouse does not": """
        before = state["finger.hand.target_offset"].copy()
        tell("on_mouse_motion", 10, 10, 100, 100); turn(5)
        assert (state["finger.hand.target_offset"] == before).all()
    """,
}
GAMEPAD = {
    "its sticks lead it at the arm's speed": """
        assert "stick leads" in said, said
        before = state["finger.hand.target_offset"].copy()
        controller.leftx, controller.lefty, controller.righty = 0.5, -1.0, 1.0
        turn(30)
        controller.leftx = controller.lefty = controller.righty = 0.0
        turn(3)
        np.testing.assert_allclose(state["finger.hand.target_offset"] - before, (0.0125, 0.025, -0.025), atol=1e-9)
    """,
}


@pytest.mark.parametrize(
    ("plugin", "way", "scripts"),
    [
        ("mouse", 'step="0.2 mm"', MOUSE),
        pytest.param("keyboard", 'speed="50 mm/s"', KEYBOARD, marks=pytest.mark.long),
        pytest.param("gamepad", 'speed="50 mm/s"', GAMEPAD, marks=pytest.mark.long),
    ],
)
def test_a_person_leads_the_finger(plugin, way, scripts, screen, tmp_path):
    scene = tmp_path / f"{plugin}.xml"
    scene.write_text(SCENE.replace("PLUGIN", plugin).replace("WAY", way))
    said = drive(PREPARE, scripts, [str(scene)], screen, tmp_path)
    assert not any(said.values()), "\n".join(said.values())
