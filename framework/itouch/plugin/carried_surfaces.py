"""Numbers on which the framework and a modality that carries a surface agree (`itouch.plugin.SurfaceFields`).

The framework hands the force over between arm and surface, and lowers a surface that presses too hard (K4), by these; a
modality that goes by others works, but then each does a part of what the other has done already.
"""

from __future__ import annotations

#: Values of the field ``fault``: the surface is lower than its height says, or higher.
LOW, HIGH = 1.0, 2.0
#: Force [N] above which a surface is felt, and below which the finger has left it.
TOUCH, LEFT = 0.05, 0.02
#: How many times its noise a loud force sensor must read at least to be surely touched [1]: noise alone reads more once
#: in a million readings.
SURELY = 5.0
#: Least cosine of a surface's tilt in computing its contact with a finger; a steeper one counts as this steep.
STEEPEST = 0.1
#: How near below the finger a surface is as good as there [m].
ABOUT = 3e-4
#: Gap [m] over which the arm takes over the normal force from a surface that is too low.
HAND_OVER = 1e-3
#: How fast a surface yields above its greatest force [m/s per N], and how fast it comes back [m/s].
YIELD_RATE, YIELD_RETURN = 0.02, 0.005
#: How far ahead a surface's force is predicted [s], because a device needs time to move.
AHEAD = 0.008
#: How far ahead of the finger [s] the slope is looked at, rounded to whole ticks, one at least: the device that carries
#: a surface needs this time to change its speed.
SLOPE_AHEAD = 0.003
#: How far the force of a surface stays below the greatest force that the scene lets act on the finger [N].
ROOM = 0.15
