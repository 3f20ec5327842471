"""up and down change the speed."""

from prepared import line, press, turn
from pyglet.window import key

press(key.UP)
press(key.UP)
before = line.now
for _ in range(6):
    turn(1, 0.01)  # waits where nothing was read yet
assert line.speed == 4.0 and abs(line.now - before - 0.24) < 0.05, line.now - before
for _ in range(4):
    press(key.DOWN)
assert line.speed == 0.25
