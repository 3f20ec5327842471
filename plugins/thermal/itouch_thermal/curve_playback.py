"""Playback of a recorded curve in place of a computed flux: what the model finger undergoes meanwhile."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from contact_heat.collocation import STAGES, points, quadrature
from contact_heat.packing import DECAY, DRIVE, HEAD, HEAT, PERIOD, PHASE, SIZE, TAIL
from itouch_thermal.flux.curve import Curve

Array = NDArray[np.float64]


def flux_step(model: Array, state: Array, before: float, after: float) -> None:
    """Advance a side by one step in which a given flux [W/m2] leaves it, linear from ``before`` to ``after``.

    ``model`` and ``state`` are those of `contact_heat.live`; a touch or air that follows starts anew.

    ``model`` (n,) and ``state`` (size,) are laid out as in `contact_heat.packing`.
    """
    n, tail = int(model[SIZE]), int(model[TAIL])
    rows = model[HEAD : HEAD + (DRIVE + STAGES) * n].reshape(-1, n)
    stages = before + (after - before) * points()
    phase = state[tail + PHASE]
    state[:n] = rows[DECAY] * state[:n] - stages @ rows[DRIVE:]
    state[tail + PHASE] = max(0.0, phase) + 1.0
    state[tail + HEAT] -= float(quadrature() @ stages) * float(model[PERIOD])


class CurvePlayback:
    """The curves that are played for the objects of a scene, and their effect on the finger."""

    def __init__(self, curves: tuple[Curve | None, ...], period: float) -> None:
        self.curves, self._period = curves, period

    def plays(self, index: int) -> bool:
        """Tell whether a curve is played for an object; -1 is no object."""
        return index >= 0 and self.curves[index] is not None

    def step(self, finger: Array, state: Array, index: int, count: int) -> float:
        """Advance the finger by step ``count`` of a touch, starting at 1; return the flux at its end [W/m2].

        ``finger`` (n,) is its model, and ``state`` (size,) its state, changed in place.
        """
        curve = self.curves[index]
        if curve is None:
            raise ValueError(f"no curve is played for object {index}")
        before, after = curve.at(self._period * np.array([max(1, count - 1), count])).tolist()
        flux_step(finger, state, before, after)
        return float(after)
