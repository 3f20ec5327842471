"""the menu does by mouse what the keys do."""

from prepared import camera, changed, choices, pixels, press, source, tell, turn, window
from pyglet.window import key, mouse


def click(symbol, last=True):
    turn()
    found = [place for place in window.picture.menu if getattr(key, place.key) == symbol]
    x, y, w, h = (found[-1] if last else found[0]).area
    window.dispatch_event("on_mouse_motion", int(x + w / 2), int(y + h / 2), 1, 1)
    turn()
    tell("on_mouse_press", int(x + w / 2), int(y + h / 2), mouse.LEFT, 0)
    held = source.held if hasattr(source, "held") else None
    if not window.closed:
        tell("on_mouse_drag", int(x + w / 2) + 2, int(y), 2, 0, mouse.LEFT, 0)
        tell("on_mouse_release", int(x + w / 2), int(y + h / 2), mouse.LEFT, 0)
    return held


window.set_size(900, 560)
tell("on_resize", 900, 560)
press(key.P)
turn()
closed = pixels()
azimuth = camera.azimuth
click(key.H, last=False)
turn()
assert choices.help and len(window.picture.menu) >= 20 and changed(closed, pixels()) > 1000
for symbol, name in ((key.T, "thermal"), (key.G, "aids"), (key.C, "curves"), (key.N, "names"), (key.L, "light")):
    before = getattr(choices, name)
    click(symbol)
    assert getattr(choices, name) is not before, name
    click(symbol)
    assert getattr(choices, name) is before, name
click(key.PLUS)
assert choices.larger == 1.25
click(key.MINUS)
assert choices.larger == 1.0
assert camera.azimuth == azimuth and source.status.picked == ""  # a press is no drag and no click
seen = set()
for number in (key._1, key._2, key._3, key._4, key._5):
    click(number)
    seen.add((camera.azimuth, camera.elevation))
assert len(seen) == 5
click(key.P)
assert not source.status.paused
click(key.P)
assert source.status.paused
click(key.S)
assert "saved" in source.status.message
said = []
source.hold = said.append
click(key.SPACE)
assert said == [True, False]
tell("on_mouse_press", 300, 300, mouse.LEFT, 0)
tell("on_mouse_release", 300, 300, mouse.LEFT, 0)
assert choices.help
click(key.H)
turn()
assert not choices.help
click(key.H, last=False)
click(key.ESCAPE)
assert window.closed and source.stopped
