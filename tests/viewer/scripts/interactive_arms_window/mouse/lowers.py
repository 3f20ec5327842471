"""the wheel lowers it onto the block, and the arm pushes back."""

from prepared import state, tell, turn

tell("on_mouse_scroll", 10, 10, 0, -9)
turn(60)
assert abs(state["finger.hand.target"][2] - 0.022) < 1e-9
assert 0.3 < float(state["arm.sent.wrench"][2]) < 2.0, state["arm.sent.wrench"]
assert state["finger.hip"][2] > 0.0225
