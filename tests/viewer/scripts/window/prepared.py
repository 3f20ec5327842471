"""Before each script: a window on a session whose time the script turns."""

import sys
from pathlib import Path

import numpy as np
from session_here import Local

import itouch
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
