"""Esc stops safely and closes."""

from prepared import press, source, window
from pyglet.window import key

press(key.ESCAPE)
assert window.closed and source.stopped
