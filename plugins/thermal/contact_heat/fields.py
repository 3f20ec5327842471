"""Temperature fields of a side in the Laplace domain, for real or complex s: without a mesh or overflow.

In a layer the deviation is ``F exp(-g x) + B exp(-g (L - x)) + p`` with ``g = sqrt((s rho c + w) / k)``; neither
exponential exceeds one.  All that lies behind a face enters only through its reflection coefficient r.  Where r is near
one, as behind thin layers on insulators, ``1 - r`` is computed separately so that fluxes keep their digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact_heat.stack import Array, Stack

#: Real or complex values.
Values = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Waves:
    """Propagation in every layer, all arrays of shape (layers, points).

    Attributes
    ----------
    growth, admittance
        g [1/m] and k g [W/m2K].
    decay, loss
        exp(-g L) and 1 - exp(-2 g L).
    reflection, passing
        r and 1 - r at each layer's inner face.
    open
        The temperature [K] that the part behind that face would take at zero flux.
    source
        The particular solution p [K].
    """

    stack: Stack
    growth: Values
    admittance: Values
    decay: Values
    loss: Values
    reflection: Values
    passing: Values
    open: Values
    source: Values

    @property
    def surface(self) -> Values:
        """Contact temperature [K] without flux, shape (points,)."""
        return self.lift(0)

    @property
    def impedance(self) -> Values:
        """Contact temperature per unit inward flux [m2K/W], shape (points,)."""
        return np.asarray((1.0 + self.reflection[0] * self.decay[0] ** 2) / (self.closed(0) * self.admittance[0]))

    def closed(self, index: int) -> Values:
        """Return ``1 - r exp(-2 g L)`` of a layer, shape (points,)."""
        return np.asarray(self.passing[index] + self.reflection[index] * self.loss[index])

    def lift(self, index: int) -> Values:
        """Transfer the open temperature [K] from a layer's inner face to its outer one."""
        drive = self.decay[index] * self.passing[index] * (self.open[index] - self.source[index])
        return np.asarray(self.source[index] + drive / self.closed(index))

    def entering(self, flux: Values) -> Values:
        """Return the inward flux [W/m2] at the outer face of every layer, shape (layers, points)."""
        found = np.empty_like(self.growth)
        for i, length in enumerate(self.stack.thickness):
            found[i] = flux
            flux = self.flux_within(i, np.array([length]), flux)[0] if np.isfinite(length) else 0.0 * flux
        return found

    def flux_within(self, index: int, x: Array, flux: Values) -> Values:
        """Return the inward flux [W/m2] at depths x in a layer that ``flux`` enters, shape (depths, points)."""
        g, length = self.growth[index], float(self.stack.thickness[index])
        x = np.asarray(x)[:, None]
        if np.isinf(length):
            return np.asarray(flux * np.exp(-g * x))
        rest = length - x
        ahead = self.passing[index] - self.reflection[index] * np.expm1(-2.0 * g * rest)
        drive = self.passing[index] * (self.open[index] - self.source[index]) * np.exp(-g * rest)
        gain = 0.5 * drive * self.admittance[index] * np.expm1(-2.0 * g * x)
        return np.asarray((ahead * np.exp(-g * x) * flux + gain) / self.closed(index))

    def temperature_within(self, index: int, x: Array, flux: Values) -> Values:
        """Return the deviation [K] at depths x in a layer that ``flux`` enters, shape (depths, points)."""
        g, length = self.growth[index], self.stack.thickness[index]
        ahead, behind = self._amplitudes(index, flux)
        x = np.asarray(x)[:, None]
        fall = ahead * np.exp(-g * x) + self.source[index]
        if np.isinf(length):
            return np.asarray(fall)
        return np.asarray(fall + behind * np.exp(-g * (length - x)))

    def content(self, index: int, flux: Values) -> Values:
        """Return the integral of the deviation [K m] over a layer that ``flux`` enters, shape (points,)."""
        ahead, behind = self._amplitudes(index, flux)
        length = float(self.stack.thickness[index])
        if np.isinf(length):
            return np.asarray(ahead / self.growth[index])
        spread = -np.expm1(-self.growth[index] * length) / self.growth[index]
        return np.asarray((ahead + behind) * spread + self.source[index] * length)

    def _amplitudes(self, index: int, flux: Values) -> tuple[Values, Values]:
        """Return F and B of a layer, shape (points,)."""
        e = self.decay[index]
        drive = 0.5 * self.passing[index] * (self.open[index] - self.source[index])
        ahead = (flux / self.admittance[index] + e * drive) / self.closed(index)
        return ahead, drive + self.reflection[index] * ahead * e


def waves(stack: Stack, s: Values, *, arterial: Values | float = 0.0, back: Values | float = 0.0) -> Waves:
    """Compute the propagation at the points s [1/s], shape (points,).

    ``arterial`` and ``back`` are the transforms of the arterial and the back (held or ambient) temperature [K s]; if
    they are given times s [K], the result is times s, too.
    """
    k, c, w = (np.asarray(a)[:, None] for a in (stack.conductivity, stack.capacity, stack.perfusion))
    growth = np.sqrt((s * c + w) / k)
    endless = np.isinf(stack.thickness)[:, None]
    length = np.where(np.isinf(stack.thickness), 0.0, stack.thickness)[:, None]
    decay = np.where(endless, 0.0, np.exp(-growth * length))
    loss = np.where(endless, 1.0, -np.expm1(-2.0 * growth * length))
    source = w * arterial / (s * c + w)
    reflection, passing, behind = (np.zeros_like(growth) for _ in range(3))
    found = Waves(stack, growth, k * growth, decay, loss, reflection, passing, behind, source)
    _look_back(found, back)
    return found


def _look_back(found: Waves, back: Values | float) -> None:
    """Fill in reflection, passing and open temperature, from the back to the contact."""
    last = len(found.growth) - 1
    y, h = found.admittance, found.stack.back
    if found.stack.endless:
        found.open[last], found.passing[last] = found.source[last], 1.0
    else:
        found.reflection[last] = -1.0 if np.isinf(h) else (y[last] - h) / (y[last] + h)
        found.passing[last] = 2.0 if np.isinf(h) else 2.0 * h / (y[last] + h)
        found.open[last] = found.source[last] if h == 0.0 else back
    for i in range(last - 1, -1, -1):
        near = y[i] * (1.0 + found.reflection[i + 1] * found.decay[i + 1] ** 2)
        far = y[i + 1] * found.closed(i + 1)
        found.reflection[i] = (near - far) / (near + far)
        found.passing[i] = 2.0 * far / (near + far)
        found.open[i] = found.lift(i + 1)
