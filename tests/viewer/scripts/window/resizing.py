"""resizing keeps everything in place."""

import numpy as np
from prepared import pixels, tell, turn, window

for size in ((900, 500), (320, 200), (1, 1), (640, 400)):
    window.set_size(*size)
    tell("on_resize", *size)
    turn(2)
assert window._target.width == window.get_framebuffer_size()[0]
assert len(np.unique(pixels().reshape(-1, 3), axis=0)) > 200
