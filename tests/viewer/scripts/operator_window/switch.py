"""the switch is held while Space is down and the window has the keys."""

from prepared import window
from pyglet.window import key

window.on_key_press(key.SPACE, 0)
assert window.held
window.on_key_release(key.SPACE, 0)
assert not window.held
window.on_key_press(key.SPACE, 0)
window.on_deactivate()
assert not window.held
window.on_key_press(key.SPACE, 0)
window.on_close()
assert not window.held and window.stopped
window.on_key_press(key.N, 0)
window.on_key_press(key.SPACE, 0)  # a letter of the note
assert not window.held
