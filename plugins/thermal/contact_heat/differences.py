"""The paper's own scheme: explicit finite differences, with the first moments of contact split off analytically.

Equations 4 to 6 are explicit central differences, ``F = alpha dt / dx**2`` and ``H = w dt / (rho c)``, stable for
``2 F + H <= 1``.  By superposition (section II-E) the field is split in two.  Problem 1 is the contact of two uniform
half-spaces, made of the outermost layers, in closed form: eq. 7 without resistance, and with it the half-spaces joined
by a constant resistance, whose flux is bounded and stays right for longer than the constant flux of eq. 9.
Problem 2 is the remainder: it starts smoothly and is solved by differences.  Equation 10 as printed leaves out problem
1's temperatures; with them ``j2 = (T_skin - T_object) / R - j1``, with the total temperatures.

Cells are equal within a layer; a node at an interface has half a cell on either side (eq. 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from contact_heat.casefile import check_times
from contact_heat.contact import Contact
from contact_heat.layers import Side, SideName
from contact_heat.splitting import Chain, first_problem, march
from contact_heat.stack import Array, stack_of
from contact_heat.steady import initial_profile

#: An endless layer is cut off at this many diffusion lengths of the last time.
_FAR = 8.0
#: Fraction of the greatest stable step that is used by default.
_SAFETY = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class DifferencesSolution:
    """Flux [W/m2], face temperatures [K] and heat [J/m2] at ``times`` [s]; fields of shape (times, nodes)."""

    contact: Contact
    times: Array
    flux: Array
    skin_temperature: Array
    object_temperature: Array
    heat: Array
    chains: tuple[Chain, Chain]
    fields: tuple[Array, Array]
    step: float

    def temperature(self, side: SideName, depth: float) -> Array:
        """Return the temperature [K] at a depth [m], linear between nodes."""
        index = 0 if side == "finger" else 1
        return np.array([np.interp(depth, self.chains[index].depths, row) for row in self.fields[index]])

    def flux_at(self, side: SideName, depth: float) -> Array:
        """Return the flux [W/m2] at a depth [m], linear between the middles of cells."""
        index, sign = (0, 1.0) if side == "finger" else (1, -1.0)
        chain, rows = self.chains[index], self.fields[index]
        middles = 0.5 * (chain.depths[1:] + chain.depths[:-1])
        fluxes = sign * chain.conductance * np.diff(rows, axis=1)
        return np.array([np.interp(depth, middles, row) for row in fluxes])


def solve_differences(
    contact: Contact, times: ArrayLike, *, spacing: float = 1e-4, step: float | None = None, split: bool = True
) -> DifferencesSolution:
    """Solve a contact with the paper's scheme.

    Parameters
    ----------
    contact
        The problem; constant resistance.
    times
        Times in ascending order, greater than 0 [s], shape (n,).
    spacing
        Greatest distance between nodes [m]; every layer has at least one cell.
    step
        Time step [s]; by default 0.9 of the stable one.
    split
        Whether to split off the first moments analytically; if not, the plain scheme of eqs 5 and 6 is used.

    Raises
    ------
    ValueError
        If times, spacing or step are out of range; the message gives the stable step.
    """
    moments = np.atleast_1d(np.array(times, dtype=np.float64))
    check_times(moments)
    if not 1e-8 <= spacing <= 1.0:
        raise ValueError(f"spacing = {spacing!r} is out of range: 1e-08 to 1 m")
    finger, body = (chain_of(side, spacing, float(moments[-1])) for side in (contact.finger, contact.object))
    bound = 1.0 / max(finger.fastest(contact.resistance), body.fastest(contact.resistance))
    step = _SAFETY * bound if step is None else step
    if not 0.0 < step <= bound:
        raise ValueError(f"step = {step!r} is out of range: above 0 s, and stable up to {bound:.3g} s")
    problem = first_problem(finger.effusivity, body.effusivity, finger.initial[0], body.initial[0], contact.resistance)
    flux, skin, face, heat, fields = march(finger, body, problem, contact.resistance, moments, step, split=split)
    return DifferencesSolution(contact, moments, flux, skin, face, heat, (finger, body), fields, step)


def chain_of(side: Side, spacing: float, duration: float, *, growth: float = 1.0) -> Chain:
    """Divide a side into nodes for a time span [s]; cells start at ``spacing`` [m] and grow by a ratio."""
    stack = stack_of(side)
    widths, slabs = [], []
    for index, length in enumerate(stack.thickness):
        diffusion = np.sqrt(stack.conductivity[index] / stack.capacity[index] * duration)
        reach = max(_FAR * diffusion, 4.0 * spacing) if np.isinf(length) else length
        cells = _cells(float(reach), spacing, growth)
        spacing = cells[-1] * growth if growth > 1.0 else spacing
        widths += cells
        slabs += [index] * len(cells)
    width, slab = np.array(widths), np.array(slabs)
    depths = np.concatenate(([0.0], np.cumsum(width)))
    profile = initial_profile(side)
    back = side.back.temperature if side.back is not None and side.back.temperature is not None else 0.0
    end = float(np.inf) if stack.endless else stack.back
    layer = side.layers[0]
    return Chain(
        depths,
        _nodal(width * stack.capacity[slab]),
        stack.conductivity[slab] / width,
        _nodal(width * stack.perfusion[slab]),
        profile.temperature(np.minimum(depths, side.depth)),
        end,
        float(profile.faces[-1]) if stack.endless else back,
        side.arterial or 0.0,
        slabs.count(0),
        layer.conductivity / layer.heat_capacity,
        layer.effusivity,
    )


def _cells(reach: float, first: float, growth: float) -> list[float]:
    """Divide a layer into cells that grow by a ratio and fill it exactly."""
    if growth == 1.0:
        count = max(1, int(np.ceil(reach / first)))
        return [reach / count] * count
    count = max(1, int(np.ceil(np.log1p(reach / first * (growth - 1.0)) / np.log(growth))))
    cells = first * growth ** np.arange(count)
    return [float(cell) for cell in cells * (reach / cells.sum())]


def _nodal(cells: Array) -> Array:
    """Assign half of each cell to the nodes at its ends, shape (cells + 1,)."""
    nodes = np.zeros(len(cells) + 1)
    nodes[:-1] += 0.5 * cells
    nodes[1:] += 0.5 * cells
    return nodes
