"""What one tick remembers of a carried surface for the next: places of the fields in `itouch.world.state_fields`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from itouch.blocks import places, width
from itouch.world.state_fields import SURFACE

_at = places(SURFACE)
RENDERS = _at["surface.renders"]  # 1: the plate renders the contact, 0: the arm alone does
PRESENT = _at["surface.present"]  # 1: the plate is there, or still felt: what touches the finger is the plate
SETTLED = _at["surface.settled"]  # 1: the plate is where the virtual surface is, 0: it comes or goes
CLEAR = _at["surface.clear"]  # 1: the plate does not render, and has withdrawn from the finger as far as it goes
SHARE = _at["surface.share"]  # the arm's share of the normal force; -1: no contact
PRESSED = _at["surface.pressed"]  # how long the virtual contact has lasted [s]
FELT = _at["surface.felt"]  # 1: the plate counts as felt
FELT_WEIGHT, FELT_FORCE = _at["surface.felt_weight"], _at["felt_force"]  # weight of its measured force; felt force [N]
MISSED = _at["surface.missed"]  # LOW, HIGH, or WITHDRAWN (below): the arm gives the force; 0: nothing is wrong
MISSES, MISSED_AT = _at["surface.misses"], _at["surface.missed_at"]  # how often; when first [s]
MISSED_DEPTH, MISSED_LOAD = _at["surface.missed_depth"], _at["surface.missed_load"]  # depth [m] and load [N] then
CUT = _at["surface.cut"]  # how much the plate's force lowers the arm's limit [N]
UPRIGHT = _at["surface.upright"]  # cosine of the tilt of the surface below
CLIMB = _at["surface.climb"]  # how fast its height changes under the finger [m/s]
CHANGING = _at["surface.changing"]  # for how long the force is still being handed over between arm and plate [s]
LOAD = _at["surface.load"]  # the plate's force a tick ago [N]
LEVEL, SINK = _at["surface.level"], _at["surface.sink"]  # height [m] of the finger's lowest point, its speed, smoothed
ACCELERATION = _at["surface.acceleration"]  # how fast that speed changes, smoothed [m/s2]
OFF = _at["surface.off"]  # how much deeper the finger seems to be in the plate than the force explains, smoothed [m]
LINGERS = _at["surface.lingers"]  # felt since the virtual contact ended [s], -1: no more
LETS_GO = _at["surface.lets_go"]  # for how long the plate, which may bounce, has not been felt since then [s]
LINGERED, LINGERED_AT = _at["surface.lingered"], _at["surface.lingered_at"]  # the longest time; when it ended
WANTED = _at["surface.wanted"]  # the force that the arm would give without the small steps of a handover, (3,) [N]
VIRTUAL = _at["surface.virtual"]  # the virtual force a tick ago, (3,) [N]
STIRS = _at["surface.stirs"]  # by how much that changed in the last two ticks, the newest first, (2,) [N]
GOES = _at["surface.goes_x"]  # velocity of the finger in x and y, smoothed, (2,) [m/s]
LIFTS = _at["surface.lifts"]  # how fast the surface rises under the finger by the motion of its object, smoothed [m/s]
SLOPE = _at["surface.slope_x"]  # slope in x and y where the finger will be `SLOPE_AHEAD` from now, (2,) [1]
TURNS = _at["surface.turns"]  # how fast the speed of its height changes there because the slope changes [m/s2]
HASTENS = _at["surface.hastens"]  # how fast the speed of its height changes because finger or object accelerate [m/s2]
RISES = _at["surface.rises"]  # how fast the plate rises, as its surface does or by itself, smoothed [m/s]
VARIANCE = _at["surface.variance"]  # of the noise of the plate's force sensor [N2]
HEARD = _at["surface.heard"]  # for how long that was measured [s]
READ, READ_BEFORE = _at["surface.read_last"], _at["surface.read_before"]  # its last two readings [N]
DEEP = _at["surface.depth"]  # how far the finger seemed to be in the plate a tick ago [m]
HEARD_AT = _at["surface.heard_at"]  # behind a wire: the tick in which its newest reading was measured
AVERAGED_AT = _at["surface.averaged_at"]  # the same of the newest reading that is in the average
FILTERED = _at["surface.averaged"]  # what the sensor reads, with its noise averaged out [N]
LOUD = _at["surface.loud"]  # rms of its noise [N]; 0: it is quiet
BORNE, UNSURE = (
    _at["surface.borne"],
    _at["surface.unsure"],
)  # the force on the plate; how far it may err [N]
MEMORY = width(SURFACE)

#: What is estimated of the force on the plate, one after the other: `LOUD`, `BORNE` and `UNSURE`.
_ESTIMATED = slice(LOUD, UNSURE + 1)

#: Value of `MISSED` besides those that a modality says: safety keeps the plate away (T4).
WITHDRAWN = 3.0
#: What a sensor may read of no touch [N].
NOTHING = 0.02


def estimated(memory: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the view (3,) [N] of the memory of a surface (MEMORY,) that holds `LOUD`, `BORNE` and `UNSURE`."""
    return memory[_ESTIMATED]
