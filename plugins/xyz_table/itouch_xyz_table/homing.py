"""Homing of drives without a search of their own: each axis moves gently against the low end of its travel."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Sequence

from itouch_xyz_table.drives import Drives
from itouch_xyz_table.servos import AXES, Goal, ServoError, check

#: Share of the torque limit, and speed [m/s], with which an axis searches for its end.
GENTLE, SLOW = 0.25, 0.02
#: An axis that moves slower than this [m/s] for this long [s], over this many readings, is at its end.
_STILL, _STOOD, _LOOKS = 0.002, 0.15, 30
#: A servo that was given a position must report it within this time [s], to this accuracy [m].
_TOLD, _NEAR = 0.3, 1e-3
#: Time [s] that the search may take beyond that of the whole travel.
_GRACE = 3.0


def home(
    servos: Drives,
    *,
    leads: Sequence[float],
    torques: Sequence[float],
    travel: Sequence[float],
    low: Sequence[float],
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Home z first, then x and y: moving down takes the plate away from the finger.

    Parameters
    ----------
    servos
        The open bus, stopped.
    leads
        Travel per revolution [m], with sign.
    torques
        Torque limits [N m].
    travel, low
        Length of each axis, and position of its low end [m].

    Raises
    ------
    ServoError
        If an axis does not find its end, or its servo does not accept its position there.
    """
    for axis in (2, 0, 1):
        lead = leads[axis]
        try:
            _to_the_end(servos, axis, lead, GENTLE * torques[axis], travel[axis] / SLOW + _GRACE, clock)
        except BaseException:
            with contextlib.suppress(ServoError):  # the first error is the one to report
                servos.stop()
            raise
        servos.stop()
        servos.set_position(axis, low[axis] / lead)
        _believed(servos, axis, lead, low[axis], clock)


def _believed(servos: Drives, axis: int, lead: float, place: float, clock: Callable[[], float]) -> None:
    """Check that a servo has accepted its position: old firmware ignores a register that it does not know."""
    begin = clock()
    while True:
        found = servos.query()[axis].position * lead
        if abs(found - place) <= _NEAR:
            return
        if clock() - begin > _TOLD:
            raise ServoError(
                f"axis {AXES[axis]} was told that it is at {1e3 * place:.1f} mm and says {1e3 * found:.1f} mm: its "
                "servo does not accept a position; update its firmware"
            )


def _to_the_end(
    servos: Drives, axis: int, lead: float, torque: float, limit: float, clock: Callable[[], float]
) -> None:
    speed = -SLOW / lead
    goals: list[Goal | None] = [None, None, None]
    goals[axis] = Goal(math.nan, speed, 0.0, torque, abs(speed))
    begin = last = clock()
    place, looks = servos.query()[axis].position, 0
    while clock() - begin < limit:
        states = servos.command(goals)
        check([states[axis]] * 3, driven=False)
        now = clock()
        if abs(states[axis].position - place) * abs(lead) > _STILL * _STOOD:
            place, last, looks = states[axis].position, now, 0
        looks += 1
        if now - last > _STOOD and looks > _LOOKS:
            return
    raise ServoError(f"axis {AXES[axis]} found no end within {limit:.0f} s: check its lead and direction")
