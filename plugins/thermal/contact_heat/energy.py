"""Where the heat of a side goes: storage, contact, back face, and blood.

Each term is computed by itself, the stored heat from the temperature field, so that their balance is a check.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_heat.contour import Z
from contact_heat.exact import ContactSolution, side_waves
from contact_heat.laplace import RAMP, STEP
from contact_heat.layers import SideName
from contact_heat.stack import Array
from contact_heat.steady import Profile, initial_profile


@dataclass(frozen=True, slots=True, eq=False)
class EnergyBalance:
    """Heat of one side since the touch [J/m2], all of shape (times,).

    ``stored`` is the change of the layers' heat, ``contact`` came in through the contact, ``back`` left through the
    back face, and ``blood`` was brought by perfusion: ``stored = contact - back + blood``.
    """

    stored: Array
    contact: Array
    back: Array
    blood: Array

    @property
    def residual(self) -> Array:
        """The error of the balance relative to the largest term, shape (times,)."""
        terms = np.abs(np.stack((self.stored, self.contact, self.back, self.blood)))
        return np.asarray(np.abs(self.stored - self.contact + self.back - self.blood) / terms.max(axis=0))


def energy_balance(solution: ContactSolution, side: SideName) -> EnergyBalance:
    """Return the energy balance of a side of an exact solution.

    Raises
    ------
    ValueError
        For an endless perfused side that did not start in equilibrium: its blood warms it everywhere.
    """
    body = solution.contact.side(side)
    start, times = initial_profile(body), solution.times
    found = side_waves(body, (Z / times[:, None]).ravel())
    if found.stack.endless and np.any(found.source[-1] != 0.0):
        raise ValueError(f"{side}: the last layer is endless, perfused and not in balance; its heat has no bound")
    sign = -1.0 if side == "finger" else 1.0
    entering = found.entering(sign * solution.transforms.ravel() - start.flux)
    shape = solution.transforms.shape
    stored, blood = np.zeros(len(times)), np.zeros(len(times))
    for i, (capacity, perfusion) in enumerate(zip(found.stack.capacity, found.stack.perfusion, strict=True)):
        content = found.content(i, entering[i]).reshape(shape)
        stored += capacity * (STEP * content).real.sum(axis=1)
        blood -= perfusion * (RAMP * content).real.sum(axis=1) * times
        blood += perfusion * times * _deficit(start, perfusion, body.arterial, i)
    back = np.zeros(len(times))
    if not found.stack.endless:
        last = len(entering) - 1
        leaving = found.flux_within(last, found.stack.thickness[-1:], entering[last])[0].reshape(shape)
        back = float(start.fluxes[-1]) * times + (RAMP * leaving).real.sum(axis=1) * times
    return EnergyBalance(stored, sign * solution.heat, back, blood)


def _deficit(start: Profile, perfusion: float, arterial: float | None, index: int) -> float:
    """Return the integral of (arterial - initial temperature) over a perfused layer [K m]."""
    if perfusion == 0.0 or arterial is None:
        return 0.0
    if np.any(start.fluxes):
        return float(start.fluxes[index + 1] - start.fluxes[index]) / perfusion
    gap = arterial - float(start.faces[index])
    return gap * float(start.stack.thickness[index]) if gap else 0.0
