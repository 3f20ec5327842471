"""the mouse leads it from the begin."""

import numpy as np
from prepared import said, state, tell, turn

assert "mouse leads" in said, said
np.testing.assert_allclose(state["finger.hand.target"], (0, 0, 0.04), atol=1e-9)
tell("on_mouse_motion", 10, 10, 30, -10)
turn(20)
np.testing.assert_allclose(state["finger.hand.target"], (0.006, -0.002, 0.04), atol=1e-9)
