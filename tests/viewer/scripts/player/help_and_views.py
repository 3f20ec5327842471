"""H lists these keys, views and a lost context work as ever."""

from prepared import changed, clock, pixels, playback, press, tell, turn, window
from pyglet.window import key

press(key.P)
clock[0] += 5
turn(2)
plain = pixels()
press(key.H)
turn()
assert changed(plain, pixels()) > 1000
press(key.H)
press(key._4)
turn()
assert window.picture.camera.elevation > 80
press(key.M)
press(key.S)
press(key.R)
assert "recording" in playback.status.message
tell("on_context_lost")
turn()
assert window.picture.ring is playback.curves and window.picture.bar is not None
window.set_size(500, 300)
tell("on_resize", 500, 300)
turn(2)
window.set_size(1, 1)
tell("on_resize", 1, 1)
turn(2)
assert not window.closed
