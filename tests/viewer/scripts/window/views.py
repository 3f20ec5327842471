"""numbers choose views and F frames."""

from prepared import camera, press, turn
from pyglet.window import key

seen = set()
for symbol in (key._1, key._2, key._3, key._4, key._5):
    press(symbol)
    turn()
    seen.add((camera.azimuth, camera.elevation))
assert len(seen) == 5
camera.distance = 9.0
press(key.F)
assert camera.distance < 1.5
