"""H, T, G and C change the picture and change it back."""

from prepared import changed, choices, pixels, press, turn
from pyglet.window import key

press(key.P)
turn()
plain = pixels()
for symbol, name in ((key.H, "help"), (key.T, "thermal"), (key.G, "aids"), (key.C, "curves")):
    before = getattr(choices, name)
    press(symbol)
    turn()
    assert getattr(choices, name) is not before
    assert changed(plain, pixels()) > 150, name
    press(symbol)
    turn()
    assert changed(plain, pixels()) == 0, name
