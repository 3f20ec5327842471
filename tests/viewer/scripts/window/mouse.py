"""the mouse orbits, pans, zooms."""

from prepared import camera, source, tell
from pyglet.window import key, mouse

before = camera.azimuth
tell("on_mouse_press", 100, 100, mouse.LEFT, 0)
tell("on_mouse_drag", 130, 100, 30, 0, mouse.LEFT, 0)
assert camera.azimuth != before
tell("on_mouse_release", 130, 100, mouse.LEFT, 0)
assert source.status.picked == ""
target = camera.target
tell("on_mouse_drag", 130, 100, 30, 0, mouse.LEFT, key.MOD_SHIFT)
assert camera.target != target
target = camera.target
tell("on_mouse_drag", 130, 100, 30, 0, mouse.MIDDLE, 0)
assert camera.target != target
distance = camera.distance
tell("on_mouse_scroll", 100, 100, 0, 2)
assert camera.distance < distance
