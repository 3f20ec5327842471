"""Temperature fields of a side in the Laplace domain, for real or complex s: no mesh, nothing that can overflow.

In a layer the deviation is ``F exp(-g x) + B exp(-g (L - x)) + p`` with ``g = sqrt((s rho c + w) / k)``; both
exponentials are at most one.  What lies behind a face enters only through its reflection coefficient.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch_thermal.solver.stack import Array, Stack

#: Real or complex values.
Values = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Waves:
    """Propagation in every layer, shape (layers, points): ``growth`` g, ``admittance`` k g, ``decay`` exp(-g L).

    ``reflection`` is the coefficient of each layer's inner face, ``open`` the temperature [K] which what lies
    behind that face would take by itself, ``source`` the particular solution p [K].
    """

    stack: Stack
    growth: Values
    admittance: Values
    decay: Values
    reflection: Values
    open: Values
    source: Values

    @property
    def impedance(self) -> Values:
        """Contact temperature per unit inward flux [m2K/W], shape (points,)."""
        echo = self.reflection[0] * self.decay[0] ** 2
        return np.asarray((1.0 + echo) / ((1.0 - echo) * self.admittance[0]))

    @property
    def surface(self) -> Values:
        """Contact temperature [K] without flux, shape (points,)."""
        return np.asarray(self.lift(0, self.open[0]))

    def lift(self, index: int, behind: Values) -> Values:
        """Carry an open temperature [K] from a layer's inner face to its outer one."""
        echo = self.reflection[index] * self.decay[index] ** 2
        drive = self.decay[index] * (1.0 - self.reflection[index]) * (behind - self.source[index])
        return np.asarray(self.source[index] + drive / (1.0 - echo))

    def amplitudes(self, flux: Values) -> tuple[Values, Values]:
        """Return F and B of every layer, shape (layers, points), for an inward flux at the contact."""
        ahead, behind = np.empty_like(self.growth), np.empty_like(self.growth)
        for i, (y, e, r) in enumerate(zip(self.admittance, self.decay, self.reflection, strict=True)):
            drive = 0.5 * (1.0 - r) * (self.open[i] - self.source[i])
            ahead[i] = (flux / y + e * drive) / (1.0 - r * e * e)
            behind[i] = drive + r * ahead[i] * e
            flux = y * (ahead[i] * e - behind[i])
        return ahead, behind

    def at(self, index: int, x: Array, amplitudes: tuple[Values, Values]) -> tuple[Values, Values]:
        """Return temperature [K] and inward flux [W/m2] at depths x in a layer, shape (depths, points)."""
        ahead, behind = amplitudes[0][index], amplitudes[1][index]
        x = np.asarray(x)[:, None]
        length = self.stack.thickness[index]
        fall = ahead * np.exp(-self.growth[index] * x)
        rise = behind * np.exp(-self.growth[index] * (length - x)) if np.isfinite(length) else 0.0 * fall
        return fall + rise + self.source[index], self.admittance[index] * (fall - rise)


def waves(stack: Stack, s: Values, *, arterial: Values | float = 0.0, back: Values | float = 0.0) -> Waves:
    """Work out the propagation at the points s, shape (points,).

    ``arterial`` and ``back`` are the transforms of the arterial and the back (held or ambient) temperature.
    """
    k, c, w = (np.asarray(a)[:, None] for a in (stack.conductivity, stack.capacity, stack.perfusion))
    growth = np.sqrt((s * c + w) / k)
    admittance = k * growth
    length = np.where(np.isinf(stack.thickness), 0.0, stack.thickness)[:, None]
    decay = np.where(np.isinf(stack.thickness)[:, None], 0.0, np.exp(-growth * length))
    source = w * arterial / (s * c + w)
    found = Waves(stack, growth, admittance, decay, np.zeros_like(growth), np.zeros_like(growth), source)
    _look_back(found, back)
    return found


def _look_back(found: Waves, back: Values | float) -> None:
    """Fill reflection and open temperature from the back to the contact."""
    last = len(found.growth) - 1
    y = found.admittance
    if found.stack.endless:
        found.open[last] = found.source[last]
    else:
        h = found.stack.back
        found.reflection[last] = -1.0 if np.isinf(h) else (y[last] - h) / (y[last] + h)
        found.open[last] = found.source[last] if h == 0.0 else back
    for i in range(last - 1, -1, -1):
        echo = found.reflection[i + 1] * found.decay[i + 1] ** 2
        near, far = y[i] * (1.0 + echo), y[i + 1] * (1.0 - echo)
        found.reflection[i] = (near - far) / (near + far)
        found.open[i] = found.lift(i + 1, found.open[i + 1])
