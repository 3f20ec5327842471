"""pointing into a curve tells what all were then."""

import numpy as np
from prepared import changed, pixels, press, turn, window
from pyglet.window import key

press(key.P)
turn()
plain = pixels()
ratio = window.get_pixel_ratio()
x, y = int(540 / ratio), int(350 / ratio)
window.dispatch_event("on_mouse_motion", x, y, 0, 0)
turn()
told = (np.abs(plain - pixels()).max(2) > 24).any(0).nonzero()[0]
assert len(told) and told.min() > 640 * 0.6  # in the charts alone
column = (np.abs(plain - pixels()).max(2) > 24)[:, 540]
assert column.sum() > 40  # a line through all of them
window.dispatch_event("on_mouse_leave", 0, 0)
turn()
assert changed(plain, pixels()) == 0
