"""What a model finger goes through while the display plays a recorded curve in the place of a computed flux."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from contact_heat.collocation import STAGES, points, quadrature
from contact_heat.packing import DECAY, DRIVE, HEAD, HEAT, PERIOD, PHASE, SIZE, TAIL
from itouch_thermal.flux.curve import Curve

Array = NDArray[np.float64]


def flux_step(model: Array, state: Array, before: float, after: float) -> None:
    """Advance a side by one step in which a given flux [W/m2] leaves it, linear from ``before`` to ``after``.

    ``model`` and ``state`` are those of `solver.live`; what follows, touch or air, begins anew after it.

    ``model`` (n,) and ``state`` (size,) as `contact_heat.packing` lays them out.
    """
    n, tail = int(model[SIZE]), int(model[TAIL])
    rows = model[HEAD : HEAD + (DRIVE + STAGES) * n].reshape(-1, n)
    stages = before + (after - before) * points()
    phase = state[tail + PHASE]
    state[:n] = rows[DECAY] * state[:n] - stages @ rows[DRIVE:]
    state[tail + PHASE] = max(0.0, phase) + 1.0
    state[tail + HEAT] -= float(quadrature() @ stages) * float(model[PERIOD])


class Playing:
    """The curves that are played for the objects of a scene, and the finger under them."""

    def __init__(self, curves: tuple[Curve | None, ...], period: float) -> None:
        self.curves, self._period = curves, period

    def plays(self, index: int) -> bool:
        """Tell whether a curve is played for an object; -1 is none."""
        return index >= 0 and self.curves[index] is not None

    def step(self, finger: Array, state: Array, index: int, count: int) -> float:
        """Advance the finger by step ``count`` of a touch, the first is 1; return the flux at its end [W/m2].

        ``finger`` (n,) is its model, ``state`` (size,) its state, changed in place.
        """
        curve = self.curves[index]
        if curve is None:
            raise ValueError(f"no curve is played for object {index}")
        before, after = curve.at(self._period * np.array([max(1, count - 1), count])).tolist()
        flux_step(finger, state, before, after)
        return float(after)
