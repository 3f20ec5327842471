"""a gamepad moves the finger, and rests near its middle."""

from types import SimpleNamespace

from prepared import press, session, turn, window
from pyglet.window import key

from itouch.arms.gamepad import Pad

controller = SimpleNamespace(leftx=1.0, lefty=0.0, righty=0.5, device=None, open=lambda: None)
window._steering.pad = Pad(controller)
before = session.state["finger.hand.target"].copy()
turn(5)
assert not session.state["finger.hand.offset"].any()
press(key.M)
turn(10)
moved = session.state["finger.hand.target_offset"]
assert moved[0] > 8e-3 and moved[2] < -3e-3  # a stick that is pulled is positive
controller.leftx = controller.righty = 0.05
still = moved.copy()
turn(5)
assert (session.state["finger.hand.target_offset"] == still).all()
