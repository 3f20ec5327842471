"""P pauses in two windows alike; one that goes leaves the other."""

import time

from prepared import SOUND, begin, press, until
from pyglet.window import key

from itouch.servo import attach
from itouch_tools.viewer.offscreen import open_window

handle, window, status = begin(SOUND)
link = attach(handle.name)
other = open_window(link, time.perf_counter, mute=True)
press(key.P)
until(lambda: status.paused and other.source.status.paused, "both paused", (other,))
tick = handle.link.tick
other.dispatch_event("on_key_press", key.P, 0)
other.dispatch_events()
until(lambda: not status.paused and handle.link.tick > tick, "goes on", (other,))
other.dispatch_event("on_close")
other.dispatch_events()
other.close()
tick = handle.link.tick
until(lambda: handle.link.tick > tick + 20, "goes on without it")
assert window.source.rearm() == "there is nothing to re-arm"
handle.stop()
until(lambda: "over" in status.message, "is over")
handle.close()
