"""its sticks lead it at the arm's speed."""

import numpy as np
from prepared import controller, said, state, turn

assert "stick leads" in said, said
before = state["finger.hand.target_offset"].copy()
controller.leftx, controller.lefty, controller.righty = 0.5, -1.0, 1.0
turn(30)
controller.leftx = controller.lefty = controller.righty = 0.0
turn(3)
np.testing.assert_allclose(state["finger.hand.target_offset"] - before, (0.0125, 0.025, -0.025), atol=1e-9)
