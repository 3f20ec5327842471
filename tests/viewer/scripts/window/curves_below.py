"""D puts the curves below the scene and beside it again."""

from prepared import changed, pixels, press, turn, window
from pyglet.window import key

press(key.P)
turn()
plain = pixels()
press(key.D)
turn()
assert window.picture.under and changed(plain, pixels()) > 5000
press(key.D)
turn()
assert not window.picture.under and changed(plain, pixels()) == 0
