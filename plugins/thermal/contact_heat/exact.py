"""The exact solution of a contact at constant resistance: no mesh, no time step.

In the Laplace domain each side is an open-circuit temperature and an impedance; the flux is the difference of the
temperatures over the sum of the impedances and the resistance, and everything else follows from it.  A field that is
steady before the touch enters exactly, through its surface temperature and flux alone; a uniform start that is not in
equilibrium with blood or back adds a drive.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from contact_heat.casefile import check_times
from contact_heat.contact import Contact
from contact_heat.contour import Complex, Z
from contact_heat.fields import Waves, waves
from contact_heat.laplace import NODES, STEP, combine, side_table, warmed_table
from contact_heat.layers import Side, SideName
from contact_heat.stack import Array, imbalance, stack_of
from contact_heat.steady import initial_profile

if TYPE_CHECKING:
    from contact_heat.differences import DifferencesSolution

NO_DRIVE: Complex = np.empty((0, NODES), dtype=np.complex128)


@dataclass(frozen=True, slots=True, eq=False)
class ContactSolution:
    """The course of a contact at the times asked for; all arrays of shape (times,).

    Attributes
    ----------
    times
        Time since the touch [s].
    flux
        Contact flux [W/m2], positive when heat leaves the finger.
    skin_temperature, object_temperature
        Temperatures of the two contact faces [K].
    heat
        Time integral of the flux [J/m2].
    """

    contact: Contact
    times: Array
    flux: Array
    skin_temperature: Array
    object_temperature: Array
    heat: Array
    transforms: Complex = field(repr=False)

    def temperature(self, side: SideName, depth: float) -> Array:
        """Return the temperature [K] at a depth [m] from the contact.

        Raises
        ------
        ValueError
            If the side is unknown or the depth is outside it.
        """
        return self._at(side, depth)[0]

    def flux_at(self, side: SideName, depth: float) -> Array:
        """Return the flux [W/m2] at a depth [m]; positive from the finger's core towards the object's.

        Raises
        ------
        ValueError
            If the side is unknown or the depth is outside it.
        """
        return self._at(side, depth)[1]

    def _at(self, side: SideName, depth: float) -> tuple[Array, Array]:
        body = self.contact.side(side)
        if not 0.0 <= depth <= min(body.depth, 1e6):
            raise ValueError(f"depth = {depth!r} is out of range: 0 to {body.depth:g} m on the {side}")
        start = initial_profile(body)
        sign = -1.0 if side == "finger" else 1.0
        points = (Z / self.times[:, None]).ravel()
        found = side_waves(body, points)
        index, x = found.stack.locate(depth)
        entering = found.entering(sign * self.transforms.ravel() - start.flux)[index]
        value = found.temperature_within(index, np.array([x]), entering)[0]
        flux = found.flux_within(index, np.array([x]), entering)[0]
        before = float(start.temperature(np.array([depth]))[0]), start.flux_at(depth)
        shape = self.transforms.shape
        change = ((STEP * part.reshape(shape)).real.sum(axis=1) for part in (value, flux))
        return before[0] + next(change), sign * (before[1] + next(change))


@overload
def solve(contact: Contact, times: ArrayLike, *, method: Literal["exact"] = "exact") -> ContactSolution: ...


@overload
def solve(contact: Contact, times: ArrayLike, *, method: Literal["paper"]) -> DifferencesSolution: ...


def solve(
    contact: Contact, times: ArrayLike, *, method: Literal["exact", "paper"] = "exact"
) -> ContactSolution | DifferencesSolution:
    """Solve a contact at constant resistance.

    Parameters
    ----------
    contact
        The problem; its resistance applies from t = 0 on.
    times
        Times in ascending order, greater than 0 [s], shape (times,) or a single one.
    method
        ``exact``, or ``paper`` for the paper's scheme at 0.1 mm; for other settings see
        `differences.solve_differences`.

    Raises
    ------
    ValueError
        If the times are not ascending, positive and finite, or the method is unknown.
    """
    if method == "paper":
        from contact_heat.differences import solve_differences

        return solve_differences(contact, times)
    if method != "exact":
        raise ValueError(f"method = {method!r} is unknown; allowed: exact, paper")
    return solve_exactly(contact, times)


def solve_exactly(contact: Contact, times: ArrayLike) -> ContactSolution:
    """Evaluate a contact at times (n,) [s] without time stepping; see `solve`."""
    moments = np.atleast_1d(np.array(times, dtype=np.float64))
    check_times(moments)
    finger, body = (side_table(stack_of(side), moments) for side in (contact.finger, contact.object))
    finger_drive, body_drive = (side_drive(side, moments) for side in (contact.finger, contact.object))
    flux, heat, skin, face = np.empty((4, len(moments)))
    transforms = np.empty((len(moments), NODES), dtype=np.complex128)
    numbers = start_numbers(contact)
    combine(finger, body, finger_drive, body_drive, numbers, moments, flux, heat, skin, face, transforms)
    return ContactSolution(contact, moments, flux, skin, face, heat, transforms)


def start_numbers(contact: Contact) -> Array:
    """Return the face temperatures [K] and inward fluxes [W/m2] of both sides before the touch, and the resistance."""
    finger, body = initial_profile(contact.finger), initial_profile(contact.object)
    return np.array((finger.surface, body.surface, finger.flux, body.flux, contact.resistance))


def side_drive(side: Side, times: Array) -> Complex:
    """Return the drive of blood and back on the contact face of a uniform start, shape (times, NODES) or (0, NODES).

    ``times`` (times,) [s].
    """
    warmth = imbalance(side)
    return NO_DRIVE if warmth is None else warmed_table(stack_of(side), warmth, times)


def side_waves(side: Side, points: Complex) -> Waves:
    """Return the waves of the deviation from the initial field at points s (n,) [1/s]; transforms are times s."""
    arterial, back = imbalance(side) or (0.0, 0.0)
    return waves(stack_of(side), points, arterial=arterial, back=back)
