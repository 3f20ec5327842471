"""an unknown key does nothing."""

from prepared import press, turn, window
from pyglet.window import key

press(key.F12)
press(key.Q)
turn(2)
assert not window.closed
