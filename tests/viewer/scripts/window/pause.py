"""P pauses and goes on."""

from prepared import press, session, source, turn
from pyglet.window import key

press(key.P)
before = session.seconds
turn(10)
assert session.seconds == before and source.status.paused
press(key.P)
turn(10)
assert session.seconds > before
