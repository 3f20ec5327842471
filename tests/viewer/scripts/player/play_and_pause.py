"""P and Space play and pause."""

from prepared import line, press, turn
from pyglet.window import key

begin = line.now
turn(30)
assert abs(line.now - begin - 30 / 60) < 0.003, line.now
for symbol in (key.P, key.SPACE):
    press(symbol)
    before = line.now
    turn(10)
    assert not line.playing and line.now == before
    press(symbol)
    turn(5)
    assert line.playing and line.now > before
