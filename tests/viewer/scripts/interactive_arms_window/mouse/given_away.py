"""M gives it away and takes it back."""

from prepared import state, tell, turn
from pyglet.window import key

tell("on_key_press", key.M, 0)
turn(30)
before = state["finger.hand.target"].copy()
tell("on_mouse_motion", 10, 10, 100, 0)
turn(10)
assert (state["finger.hand.target"] == before).all()
tell("on_key_press", key.M, 0)
tell("on_mouse_motion", 10, 10, 10, 0)
turn(20)
assert state["finger.hand.target"][0] > before[0]
