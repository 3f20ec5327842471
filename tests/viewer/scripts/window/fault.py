"""a fault is told in words."""

from prepared import changed, pixels, press, source, turn
from pyglet.window import key

press(key.P)
turn()
plain = pixels()
source.status.faults = [{"trip": "silence", "device": "table", "cause": "is silent"}]
turn()
assert changed(plain, pixels()) > 300
