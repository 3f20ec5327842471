"""held keys lead it at the arm's speed."""

import numpy as np
from prepared import said, state, tell, turn
from pyglet.window import key

assert "arrow keys lead" in said, said
before = state["finger.hand.target_offset"].copy()
tell("on_key_press", key.UP, 0)
tell("on_key_press", key.PAGEDOWN, 0)
turn(30)
tell("on_key_release", key.UP, 0)
tell("on_key_release", key.PAGEDOWN, 0)
turn(3)
np.testing.assert_allclose(state["finger.hand.target_offset"] - before, (0, 0.025, -0.025), atol=1e-9)
