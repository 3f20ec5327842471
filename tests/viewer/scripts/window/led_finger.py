"""M gives the finger to mouse and arrows."""

import numpy as np
from prepared import press, session, source, tell, turn
from pyglet.window import key

press(key.M)
assert "mouse moves" in source.status.message
before = session.state["finger.hand.target"].copy()
tell("on_mouse_motion", 10, 10, 100, -50)
turn(7, 0.05)
np.testing.assert_allclose(session.state["finger.hand.target"] - before, (0.01, -0.005, 0), atol=1e-9)
tell("on_mouse_scroll", 10, 10, 0, 3)
tell("on_key_press", key.RIGHT, 0)
turn(10)
tell("on_key_release", key.RIGHT, 0)
turn(7, 0.05)
np.testing.assert_allclose(session.state["finger.hand.target"] - before, (0.015, -0.005, 0.003), atol=1e-9)
press(key.M)
turn(10, 0.05)
assert not session.state["finger.hand.offset"].any()
