"""What one tick remembers of a carried surface for the next: State fields in this order (``itouch.world.fields``)."""

from __future__ import annotations

RENDERS = 0  # 1: the plate renders the contact, 0: the arm alone does
PRESENT = 1  # 1: the plate is there, or still felt: what touches the finger is the plate
SETTLED = 2  # 1: the plate is where the virtual surface is, 0: it comes or goes
CLEAR = 3  # 1: the plate does not render, and has withdrawn from the finger as far as it goes
SHARE = 4  # the arm's share of the normal force; -1: no contact
PRESSED = 5  # how long the virtual contact has lasted [s]
FELT, FELT_WEIGHT, FELT_FORCE = 6, 7, 8  # 1: the plate counts as felt; weight of its measured force; felt force [N]
MISSED = 9  # LOW, HIGH or WITHDRAWN (below): the arm gives the force; 0: nothing is wrong
MISSES, MISSED_AT, MISSED_DEPTH, MISSED_LOAD = 10, 11, 12, 13  # how often; the first: when [s], depth [m], load [N]
CUT = 14  # how much the plate's force lowers the arm's limit [N]
UPRIGHT, CLIMB = 15, 16  # cosine of the tilt of the surface below; how fast its height changes under the finger [m/s]
CHANGING = 17  # for how long the force is still being handed over between arm and plate [s]
LOAD = 18  # the plate's force a tick ago [N]
LEVEL, SINK = 19, 20  # height of the lowest point of the finger, and its speed, smoothed [m], [m/s]
OFF = 21  # how much deeper the finger seems to be in the plate than the force explains, smoothed [m]
LINGERS, LINGERED, LINGERED_AT = 22, 23, 24  # felt since the virtual contact ended [s], -1: no more; the longest; when
WANTED = 25  # the force that the arm would give without the small steps of a handover, (3,) [N]
VIRTUAL = 28  # the virtual force a tick ago, (3,) [N]
STIRS = 31  # by how much the virtual force changed in the last two ticks, the newest first, (2,) [N]
GOES = 33  # velocity of the finger in x and y, smoothed, (2,) [m/s]
LIFTS = 35  # how fast the surface rises under the finger by the motion of its object, smoothed [m/s]
SLOPE = 36  # slope in x and y where the finger will be `itouch.loop.surface.ground.AHEAD` from now, (2,) [1]
TURNS = 38  # how fast the speed of its height changes there because the slope changes [m/s2]
HASTENS = 39  # how fast the speed of its height changes because finger or object accelerate [m/s2]
RISES = 40  # how fast the plate rises: as its surface does or, where it does not render, by itself, smoothed [m/s]
MEMORY = 41

#: Values of `MISSED`: the plate is lower than its height says, or higher; or safety keeps it away (T4).
LOW, HIGH, WITHDRAWN = 1.0, 2.0, 3.0

#: Force [N] above which a plate is felt, below which the finger has left it, and what a sensor may read of no touch.
TOUCH, LEFT, NOTHING = 0.05, 0.02, 0.02
#: How near below the finger a plate is as good as there [m].
ABOUT = 3e-4
#: Gap [m] over which the arm takes over the normal force from a plate that is too low.
HAND_OVER = 1e-3
