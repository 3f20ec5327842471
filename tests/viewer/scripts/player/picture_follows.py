"""the picture follows, and is the same when one comes back."""

from prepared import changed, clock, line, pixels, playback, press, reel, turn
from pyglet.window import key

press(key.P)
playback.seek(0.2)
clock[0] += 5
while not line.known.all():
    reel.work(0.1)
    line.known = reel.known(200)
turn(2)
first = pixels()
playback.seek(1.5)
turn(2)
assert changed(first, pixels()) > 500
playback.seek(0.2)
turn(2)
assert changed(first, pixels()) == 0
