"""the mouse winds on the time line and orbits beside it."""

from prepared import at, line, press, tell, turn, window
from pyglet.window import key, mouse

press(key.P)
turn()
camera = window.picture.camera
before = camera.azimuth
tell("on_mouse_press", *at(0.25), mouse.LEFT, 0)
turn()
assert abs(line.now - (line.first + 0.25 * (line.last - line.first))) < 0.02
tell("on_mouse_drag", *at(0.8), 300, 0, mouse.LEFT, 0)
turn()
assert abs(line.now - (line.first + 0.8 * (line.last - line.first))) < 0.02
tell("on_mouse_drag", 5000, at(0)[1], 300, 0, mouse.LEFT, 0)
turn()
assert line.now == line.last and camera.azimuth == before
tell("on_mouse_release", *at(0.8), mouse.LEFT, 0)
assert window.playback.status.picked == ""
tell("on_mouse_press", 200, 200, mouse.LEFT, 0)
tell("on_mouse_drag", 230, 200, 30, 0, mouse.LEFT, 0)
assert camera.azimuth != before and line.now == line.last
