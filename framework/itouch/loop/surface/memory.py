"""What a tick remembers of a carried surface: State fields in this order (see ``itouch.world.fields``)."""

from __future__ import annotations

RENDERS = 0  # 1: the plate's to render, 0: the arm's alone
PRESENT = 1  # 1: the plate is there, or still felt: what touches the finger is the plate
SETTLED = 2  # 1: the plate is where the virtual surface is, 0: it comes or goes
CLEAR = 3  # 1: where it does not render, it has left the finger as far as it goes
SHARE = 4  # the arm's part of the normal force; -1: no contact
PRESSED = 5  # how long the virtual contact has lasted [s]
FELT, FELT_WEIGHT, FELT_FORCE = 6, 7, 8  # felt since the begin; weight of the measured force; their blend [N]
MISSED = 9  # LOW or HIGH: its force is the arm's
MISSES, MISSED_AT, MISSED_DEPTH, MISSED_LOAD = 10, 11, 12, 13  # how often; the first: when [s], depth [m], load [N]
CUT = 14  # what the plate takes of the force that the arm may give [N]
UPRIGHT, CLIMB = 15, 16  # cosine of the tilt of the surface below; how fast its height changes under the finger [m/s]
CHANGING = 17  # for how long the force is still led over from one to the other [s]
LOAD = 18  # the plate's force a tick ago [N]
LEVEL, SINK = 19, 20  # height of the lowest point of the finger, and its speed, smoothed [m], [m/s]
OFF = 21  # how much deeper the finger seems to be in the plate than the force explains, smoothed [m]
LINGERS, LINGERED, LINGERED_AT = 22, 23, 24  # felt since the virtual contact ended [s], -1: no more; the longest; when
WANTED = 25  # what the arm was to give, were it not led over, (3,) [N]
VIRTUAL = 28  # the virtual force a tick ago, (3,) [N]
STIRS = 31  # by how much the virtual force changed in the last two ticks, the newest first, (2,) [N]
GOES = 33  # how fast the finger goes in x and y, smoothed, (2,) [m/s]
LIFTS = 35  # how fast the surface's object lifts it under the finger, smoothed [m/s]
SLOPE = 36  # how steep it is in x and y where the finger will be `itouch.loop.surface.ground.AHEAD` from now, (2,) [1]
TURNS = 38  # how fast its height's speed changes there as the slope does [m/s2]
HASTENS = 39  # how fast its height's speed changes as the finger goes faster or slower, or the object does [m/s2]
RISES = 40  # how fast the plate rises as its surface does or, where it does not render, by itself, smoothed [m/s]
MEMORY = 41

#: What `MISSED` says: the plate is lower than its height says, or higher; or it was told to stay away (T4).
LOW, HIGH, WITHDRAWN = 1.0, 2.0, 3.0

#: Force [N] from which on a plate is felt, below which it is left, and what a sensor may read of nothing.
TOUCH, LEFT, NOTHING = 0.05, 0.02, 0.02
#: A plate that is so near below the finger is as good as there [m].
ABOUT = 3e-4
#: Gap [m] over which the arm takes over the normal force from a plate that is too low.
HAND_OVER = 1e-3
