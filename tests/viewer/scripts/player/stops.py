"""page and home and end go where something happened."""

from prepared import line, press, turn
from pyglet.window import key

press(key.P)
press(key.HOME)
turn()
stops = []
for _ in range(len(line.stops)):
    stops.append(round(line.now, 3))
    press(key.PAGEDOWN)
    turn()
assert stops == [round(stop, 3) for stop in line.stops], (stops, line.stops)
press(key.PAGEUP)
turn()
assert round(line.now, 3) == stops[-2]
press(key.END)
turn()
assert line.now == line.last
