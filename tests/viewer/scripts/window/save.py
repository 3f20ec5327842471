"""S saves a session that can be restored."""

import sys

from prepared import press, source, turn
from pyglet.window import key

import itouch

press(key.S)
turn()
assert "saved" in source.status.message
assert itouch.restore(sys.argv[3]).seconds > 9.0
source._save_to = sys.argv[2] + "/x.itouch"
press(key.S)
assert "x.itouch" in source.status.message
