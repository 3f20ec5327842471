"""Before the touch, compiled: which object the finger approaches, the plate's start temperature, and when it is ready.

With ``equalise`` the plate is ready after the same time for every object, long enough for the longest switch: neither
a delay nor its absence reveals the material.  (What the table does before a touch depends on finger and shape alone.)

In every function ``scene`` is a `views.Scene`, ``own`` are `views.OwnFields`, ``given`` is `views.Given`, ``figures``
are `views.Figures`, and ``index`` is that of an object.
"""

from __future__ import annotations

import math
from typing import Any

from itouch.plugin.kernels import inlined, linked
from itouch_thermal.display.column import F_BEGIN, F_DECAY, F_END, F_PORT
from itouch_thermal.flux import onset
from itouch_thermal.flux.start import MARGIN
from itouch_thermal.flux.views import Floats

#: Force [N] on the plate above which a finger is on it.
TOUCHED = 0.03
#: Over how long the infrared readings of the skin are averaged while the rig is calibrated [s], and the greatest flux
#: [W/m2] that the plate then takes from the finger in place of the air: without it, covered skin warms up.
AVERAGED, DRAWN = 1.0, 45.0
#: Places in a row of `Given.start`: start temperatures for a cool, a usual and a warm skin, and the object's own.
COOL, USUAL, WARM, OWN = range(4)
#: The plate is ready within this of its start temperature [K].
READY = 0.1


@linked
def pressed(scene: Any, heat: bool) -> bool:
    """Tell whether the finger is on the plate: by the measured force, else as the virtual contact says."""
    if scene.load.shape[0] > 0:
        return bool(abs(scene.load[2]) > TOUCHED)
    return bool(in_contact(scene, heat))


@linked
def in_contact(scene: Any, heat: bool) -> bool:
    """Tell whether the finger presses on a virtual object now."""
    return math.isfinite(scene.resistance[0]) if heat else bool(scene.normal_force[0] > 0.0)


@linked
def judged(error: float, passed: float) -> float:
    """Return the readiness, 0 to 1, of a plate that differs from its start temperature by an error [K].

    ``passed`` is the share that is over of the time that every approach takes, and is the readiness until it is 1; 1 or
    more if no such time is set.
    """
    return max(0.0, passed) if passed < 1.0 else max(0.0, min(1.0, 2.0 - abs(error) / READY))


@linked
def aim_at(start: Floats, limited: Any, wanted: float, low: float, high: float) -> None:
    """Set the start temperature [K], clipped to the plate's band less MARGIN.

    ``start`` (1,) and ``limited`` (1,), whether ``wanted`` is outside the band, are written; ``wanted``, ``low`` and
    ``high`` [K].
    """
    start[0] = min(high - MARGIN, max(low + MARGIN, wanted))
    limited[0] = int(not low <= wanted <= high)


@linked
def neutral(
    calm: Floats, looked: Floats, covered: Floats, tissue: Floats, resting: float, measured: float, rest: float,
    touched: bool, resistance: float, period: float, lead: float,
) -> float:  # fmt: skip
    """Return the plate temperature [K] with which a finger that touches the plate in a calibration keeps its own.

    Skin at rest gives heat to the air.  On the plate it gives it to the plate, up to what that may take; the rest warms
    the skin, and the plate follows it.  Nobody knows when it will be touched next, so it is always prepared for that.

    Parameters
    ----------
    calm, looked
        Mean of the resting skin's readings [K], 0 before the first, and over how long it is [s], shape (1,) each.
    covered
        Modes of the skin's warming by the plate so far, shape (n,); changed.
    tissue
        Packed finger, shape (4, n); see `itouch_thermal.display.column`.
    resting, rest
        Heat [W/m2] that the finger at rest gives to the air, and its skin's temperature where no sensor sees it [K].
    measured
        Reading of the skin's temperature [K]; NaN: it is not seen now.
    touched, resistance
        Whether the finger is on the plate, and with what contact resistance [K m2/W].
    period, lead
        Time since the last call, and time from now until the plate reaches its target [s].
    """
    drawn = min(DRAWN, max(-DRAWN, resting))
    kept, warmer, soon, steps = resting - drawn, 0.0, 0.0, lead / period
    for i in range(covered.shape[0]):
        decay, gained = tissue[F_DECAY, i], kept * (tissue[F_BEGIN, i] + tissue[F_END, i])
        covered[i] = decay * covered[i] + (gained if touched else 0.0)
        warmer += tissue[F_PORT, i] * covered[i]
        left = decay**steps
        soon += tissue[F_PORT, i] * (
            left * covered[i] + gained * ((1.0 - left) / (1.0 - decay) if decay < 1.0 else steps)
        )
    if math.isfinite(measured):
        looked[0] = min(AVERAGED, looked[0] + period) if calm[0] != 0.0 else period
        calm[0] += min(1.0, period / looked[0]) * (measured - warmer - calm[0])
    skin = calm[0] if calm[0] != 0.0 else rest
    return float(skin + soon - resistance * drawn)


@linked
def aim_for_skin(scene: Any, own: Any, given: Any, figures: Any) -> None:
    """Aim for the skin's temperature during calibration, so that a plate felt then does not cool the finger."""
    seen = scene.skin.shape[0] > 0 and (scene.skin_valid.shape[0] == 0 or scene.skin_valid[0] >= 0.5)
    own.approached[0] = -1
    wanted = neutral(
        own.calm, own.looked, own.covered, given.cover, figures.resting, scene.skin[0] if seen else math.nan,
        figures.rest, pressed(scene, figures.heat), figures.on_plate, figures.update, figures.lead,
    )  # fmt: skip
    aim_at(own.start_temperature, own.plate_limited, wanted, figures.low, figures.high)


@linked
def coming(scene: Any) -> int:
    """Return the object that the plate will render, -1: none; it is the one below, even if a taller one is nearer."""
    near, below = scene.near_object[0], scene.below[0]
    return int(below if near >= 0 and below >= 0 else near)


@inlined
def sees(scene: Any, figures: Any) -> bool:
    """Tell whether a sensor sees the skin, for all that the controller asks before a touch."""
    return bool(scene.skin.shape[0] > 0 and not (figures.doubts and scene.skin_valid[0] < 0.5))


@inlined
def blind(scene: Any, figures: Any) -> bool:
    """Tell whether the skin's temperature, which is needed for a new aim, is not known here."""
    return bool(not sees(scene, figures) and math.isnan(scene.guess[0]))


@linked
def wanted_for(scene: Any, given: Any, figures: Any, index: int) -> float:
    """Return the start temperature [K] for an object, as warm as it and the skin, which must be known, are now."""
    goes_on, warmed, row = given.played[index] == 0, 0.0, given.start[index]
    if goes_on and given.known[index] != 0:
        warmed = onset.warmth(given.bodies[index], scene.bodies[index], row[OWN])
    skin = scene.skin[0] if sees(scene, figures) else scene.guess[0]
    return float(
        onset.start_for(row[COOL], row[USUAL], row[WARM], figures.rest, row[OWN], goes_on, skin, warmed)
    )  # fmt: skip


@linked
def aim(scene: Any, own: Any, given: Any, figures: Any, index: int, tick: int) -> None:
    """Aim for the object that the finger approaches; if nothing is known of its heat, the start temperature stays."""
    own.preset_begun[0] = tick
    if index >= 0:
        own.approached[0] = index
        if given.starts[index] != 0:
            wanted = wanted_for(scene, given, figures, index)
            aim_at(own.start_temperature, own.plate_limited, wanted, figures.low, figures.high)


@linked
def look_near(scene: Any, own: Any, given: Any, figures: Any) -> None:
    """Aim, between touches, for the near object, anew now and then, as it and the skin recover from the last touch."""
    near, tick = coming(scene), scene.tick[0]
    if near < 0:
        return
    if near != own.approached[0]:
        aim(scene, own, given, figures, near, tick)
    elif tick % figures.again < figures.hold and given.starts[near] != 0:
        wanted = wanted_for(scene, given, figures, near)
        if abs(wanted - own.start_temperature[0]) > READY / 2.0:
            aim_at(own.start_temperature, own.plate_limited, wanted, figures.low, figures.high)


@linked
def judge(scene: Any, own: Any, figures: Any, error: float) -> None:
    """Write the readiness of a plate that differs from its start temperature by an error [K]."""
    passed = 1.0
    if figures.preset_time > 0.0:
        passed = (scene.tick[0] - own.preset_begun[0]) * figures.period / figures.preset_time
    own.readiness[0] = judged(error, passed)
    own.plate_ready[0] = int(own.readiness[0] >= 1.0)
