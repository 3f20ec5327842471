"""Before each script: a window on a session whose arm a person leads, and a gamepad that the script moves."""

import sys
from types import SimpleNamespace

from session_here import Local

import itouch
from itouch.arms import gamepad
from itouch_tools.viewer import steering
from itouch_tools.viewer.window import Window

controller = SimpleNamespace(name="fake", leftx=0.0, lefty=0.0, righty=0.0, device=None, open=lambda: None,
                             close=lambda: None)  # fmt: skip
if sys.argv[-1].endswith("gamepad.xml"):
    steering.find_pad = lambda: gamepad.Pad(controller)
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


said = source.status.message
turn()
state = session.state
