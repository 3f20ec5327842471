"""the mouse does not."""

from prepared import state, tell, turn

before = state["finger.hand.target_offset"].copy()
tell("on_mouse_motion", 10, 10, 100, 100)
turn(5)
assert (state["finger.hand.target_offset"] == before).all()
