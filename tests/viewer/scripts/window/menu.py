"""the menu pauses, saves, and stops safely."""

from prepared import choices, source, tell, turn, window
from pyglet.window import mouse


def click(name, where=-1):
    found = [place for place in window.picture.menu if place.key == name]
    x, y, w, h = found[where].area
    tell("on_mouse_press", int(x + w / 2), int(y + h / 2), mouse.LEFT, 0)
    tell("on_mouse_release", int(x + w / 2), int(y + h / 2), mouse.LEFT, 0)


click("H", 0)
turn()
assert choices.help and len(window.picture.menu) >= 20
click("P")
turn()
assert source.status.paused
click("S")
assert "saved" in source.status.message
click("ESCAPE")
assert window.closed and source.stopped
