"""it shows what changes, beside the participant's."""

from prepared import face, lines, picture, window
from pyglet.window import key

from itouch_tools.viewer.participant_window import AskingWindow

before = picture()
other = AskingWindow()
other.show_face(face)
assert (picture() == before).all()
lines[1] = ("table: enabled", True)
after = picture()
assert (after != before).any()
window.on_key_press(key.P, 0)
assert (picture() != after).any()
other.close()
