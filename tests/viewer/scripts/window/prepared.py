"""Before each script: a window on a session whose time the script turns."""

import sys
from pathlib import Path

from driven_window import Driven, changed  # noqa: F401 - for the scripts
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

driven = Driven(window, clock)
turn, tell, press, pixels = driven.turn, driven.tell, driven.press, driven.pixels
turn()
choices, camera = window.picture.choices, window.picture.camera
