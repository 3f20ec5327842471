"""a click shows the properties of what is there."""

import numpy as np
from prepared import camera, source, tell, turn, window
from pyglet.window import mouse

x, y = camera.project(np.array([-0.022, -0.025, 0.018]), *window.get_framebuffer_size())
tell("on_mouse_press", int(x), int(y), mouse.LEFT, 0)
tell("on_mouse_release", int(x), int(y), mouse.LEFT, 0)
assert source.status.picked == "pyrex", source.status.picked
turn()
