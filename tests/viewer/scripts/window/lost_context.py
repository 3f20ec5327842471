"""a lost context is made anew."""

from prepared import changed, choices, pixels, press, tell, turn, window
from pyglet.window import key

press(key.P)
press(key.T)
turn()
plain = pixels()
tell("on_context_lost")
turn()
assert choices is window.picture.choices and changed(plain, pixels()) == 0
