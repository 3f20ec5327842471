"""keys."""

from prepared import window
from pyglet.window import key

window.on_key_press(key.N, 0)
window.on_text("n")  # the letter that began it
for letter in "no air":
    window.on_text(letter)
window.on_key_press(key.BACKSPACE, 0)
window.on_key_press(key.P, 0)  # a letter now
assert not window.paused and not window.stopped
window.on_key_press(key.ENTER, 0)
assert window.notes() == ["no ai"] and window.notes() == []
window.on_key_press(key.N, 0)
window.on_key_press(key.ESCAPE, 0)
assert window.notes() == [] and not window.stopped
window.on_key_press(key.P, 0)
assert window.paused
window.on_key_press(key.P, 0)
assert not window.paused
window.on_key_press(key.ESCAPE, 0)
assert window.stopped
