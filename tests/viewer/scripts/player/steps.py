"""arrows step by one tick, with Shift by a hundred, and repeat while held."""

from prepared import playback, press, state, tell, turn
from pyglet.window import key

press(key.P)
playback.seek(1.0)
turn()
for symbol, modifiers, ticks in (
    (key.RIGHT, 0, 1),
    (key.LEFT, 0, -1),
    (key.RIGHT, key.MOD_SHIFT, 100),
    (key.LEFT, key.MOD_SHIFT, -100),
):
    before = int(state["tick"])
    press(symbol, modifiers)
    turn()
    assert int(state["tick"]) - before == ticks
before = int(state["tick"])
tell("on_key_press", key.RIGHT, 0)
turn(15, 1 / 15)
tell("on_key_release", key.RIGHT, 0)
after = int(state["tick"])
assert 5 < after - before < 20, after - before
turn(5, 0.1)
assert int(state["tick"]) == after
