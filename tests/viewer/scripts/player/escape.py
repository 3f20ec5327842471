"""Esc closes."""

from prepared import press, window
from pyglet.window import key

press(key.ESCAPE)
assert window.closed
