"""in a window of hardly a pixel a letter may have none: an apostrophe in the operator's note ended the whole study."""

import time

from prepared import face, picture, window

face.message = "the operator's note"
large = picture()
for size in ((1, 1), (900, 2), (3, 700), (1280, 720)):
    window.set_size(*size)
    limit = time.monotonic() + 30.0
    while (window._frame.width, window._frame.height) != size:
        assert time.monotonic() < limit, size
        window.dispatch_events()
        time.sleep(0.01)
    drawn = picture()
assert drawn.shape == large.shape and (drawn == large).all()
