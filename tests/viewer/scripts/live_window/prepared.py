"""Before each script: what it needs to begin a session in a process of its own, with a window on it."""

import sys
import time

import itouch
from itouch_tools.viewer.offscreen import open_window
from itouch_tools.viewer.window import Window

Window.__init__.__kwdefaults__.update(width=640, height=400)  # a quarter of what software would have to draw
FAILING, SOUND, HELD = sys.argv[2:5]


def begin(scene):
    global handle, window, status
    handle = itouch.launch(scene, linger=True)
    window = open_window(handle.link, time.perf_counter, handle=handle, mute=True)
    status = window.source.status
    return handle, window, status


def until(condition, what, windows=()):
    end = time.monotonic() + 300
    while not condition():
        assert time.monotonic() < end, what
        for one in (window, *windows):
            one.dispatch_events()
            one.frame()
        time.sleep(0.04)  # a frame costs a core some 50 ms where software draws it


def press(symbol):
    window.dispatch_event("on_key_press", symbol, 0)
    window.dispatch_events()
