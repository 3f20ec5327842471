"""Space lets the machine move, letting go stops it, and R with Space goes on."""

import time

from prepared import HELD, begin, press, until
from pyglet.window import key

import itouch


def goes(ticks):  # on a busy machine the switch may be let go in between
    if status.faults:
        press(key.R)
    return handle.link.tick > ticks


handle, window, status = begin(HELD)
handle.command("enable")
until(lambda: status.waiting, "waiting")
assert handle.link.tick == 0
window.dispatch_event("on_key_press", key.SPACE, 0)
until(lambda: goes(50) and not status.waiting, "moves")
window.dispatch_event("on_key_release", key.SPACE, 0)
until(lambda: status.faults, "let go")
assert status.faults[0]["trip"] == "released"
press(key.R)
until(lambda: "nobody holds" in status.message, "refused")
tick = handle.link.tick
window.dispatch_event("on_key_press", key.SPACE, 0)
until(lambda: True, "a frame")
press(key.R)
until(lambda: goes(tick + 10), "goes on")
time.sleep(0.6)  # the window hangs
until(lambda: status.faults and status.faults[0]["tick"] > tick, "let go by itself")
handle.request_stop()
try:
    handle.wait(300)
except itouch.DeviceFaultError as fault:
    assert "switch" in str(fault)
window.source.stop()
handle.close()
