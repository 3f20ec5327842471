"""One step of heat between the model finger and what it touches: one object, or two at the boundary between them.

A finger that slides from one object onto another lies on both for a while.  Each object gets its share of the contact
disc and draws from the same skin, and the finger the mean of what both draw, weighted by these shares.  So nothing
jumps when one contact ends and the other begins, and the flux does not depend on how long a step is.  Air takes the
place of an object whose heat is not known.  Only where a recorded curve is played for one of them, the mean is taken of
what either alone would do: a curve has no skin.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact_heat.packing import AMBIENT, FILM, HEAT, PERIOD, PHASE, RESISTANCE, SIZE, TAIL
from contact_heat.sharing import air_beside, shared_step
from itouch_thermal.curve_playback import CurvePlayback

Array = NDArray[np.float64]

#: Resistance [K m2/W] between the finger and air beside it, if the finger's model loses no heat to air.
INSULATED = 1e12


def beyond(distance: float, area: float) -> float:
    """Return the share (0 to 1) of a disc of an area [m2] beyond a straight line at a distance [m] from its centre."""
    radius = math.sqrt(area / math.pi)
    if distance >= radius:
        return 0.0
    if distance <= -radius:
        return 1.0
    x = distance / radius
    return max(0.0, (math.acos(x) - x * math.sqrt(1.0 - x * x)) / math.pi)


class Exchange:
    """The finger and the objects of a scene, as packed models; None for an object without a thermal material."""

    def __init__(self, live: Any, finger: Array, bodies: tuple[Array | None, ...], playing: CurvePlayback) -> None:
        self._live, self._finger, self._bodies, self._playing = live, finger, bodies, playing

    def knows(self, index: int) -> bool:
        """Tell whether an object's heat is known; -1 is no object."""
        return index >= 0 and (self._bodies[index] is not None or self._playing.plays(index))

    def step(self, finger: Array, objects: Array, index: int, resistance: float, count: int) -> float:
        """Advance the finger, and the object that it touches, by one step.

        Parameters
        ----------
        finger, objects
            States of the finger, (size,), and of the objects, (objects, widest), one row each; changed in place.
        index, resistance
            The object that is touched (-1: none whose heat is known), and the contact resistance [K m2/W].
        count
            Number of this step in the touch, from 1.

        Returns
        -------
        float
            Flux out of the finger at the end of the step [W/m2].
        """
        if math.isfinite(resistance) and self._playing.plays(index):
            return self._playing.step(self._finger, finger, index, count)
        body = self._bodies[index] if index >= 0 and math.isfinite(resistance) else None
        if body is None:
            self._live.air_step(self._finger, finger)
            return 0.0
        flux: float = self._live.contact_step(self._finger, finger, body, objects[index], resistance)
        return flux

    def blend(
        self, finger: Array, objects: Array, indices: tuple[int, int], parts: tuple[float, float], resistance: float,
        counts: tuple[int, int],
    ) -> float:  # fmt: skip
        """Advance the finger, and two objects of which the second has a share of the contact disc, by one step.

        Parameters
        ----------
        finger, objects, resistance
            As in ``step``: (size,), (objects, widest) and [K m2/W].
        indices, counts
            The two objects that are touched, and the number of this step in the touch of each.
        parts
            The share of the disc that lies on the second object at the start and at the end of the step, 0 to 1.

        Returns
        -------
        float
            Flux out of the finger at the end of the step [W/m2].
        """
        if any(self._playing.plays(index) for index in indices):
            return self._blend_played(finger, objects, indices, parts[1], resistance, counts)
        tail = int(self._finger[TAIL])
        last = float(finger[tail + RESISTANCE]) if finger[tail + PHASE] > 0.0 else resistance
        (one, own, first), (two, beside, second) = (
            self._side(objects, index, last, resistance) for index in indices
        )  # fmt: skip
        before, after = np.array((first, second)).T.copy()
        flux: float = shared_step(self._finger, finger, one, own, two, beside, np.array(parts), before, after)
        for state, at in ((finger, tail), (own, int(one[TAIL])), (beside, int(two[TAIL]))):
            state[at + RESISTANCE] = resistance
        return flux

    def _side(
        self, objects: Array, index: int, last: float, resistance: float
    ) -> tuple[Array, Array, tuple[float, float]]:
        """Return model and state of an object, or of the air in its place, and its resistances [K m2/W] in a step."""
        body = self._bodies[index] if index >= 0 else None
        if body is not None:
            return body, objects[index], (last, resistance)
        film = float(self._finger[FILM])
        beside = 1.0 / film if film > 0.0 else INSULATED
        return *air_beside(float(self._finger[AMBIENT]), float(self._finger[PERIOD])), (beside, beside)

    def _blend_played(
        self, finger: Array, objects: Array, indices: tuple[int, int], part: float, resistance: float,
        counts: tuple[int, int],
    ) -> float:  # fmt: skip
        """Do `blend` where a curve is played for one of the objects: the mean of what either alone would do."""
        other, (first, second) = finger.copy(), indices
        tail, size = int(self._finger[TAIL]), int(self._finger[SIZE])
        body = self._bodies[second] if second >= 0 else None
        if body is not None and objects[second][int(body[TAIL]) + PHASE] > 0.0:  # the second object's touch goes on
            for entry in (PHASE, RESISTANCE):
                other[tail + entry] = objects[second][int(body[TAIL]) + entry]
        flux = self.step(finger, objects, first, resistance, counts[0])
        beside = self.step(other, objects, second, resistance, counts[1])
        finger[:size] = (1.0 - part) * finger[:size] + part * other[:size]
        finger[tail + HEAT] = (1.0 - part) * finger[tail + HEAT] + part * other[tail + HEAT]
        return (1.0 - part) * flux + part * beside
