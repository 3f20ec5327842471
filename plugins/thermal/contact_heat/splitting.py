"""Problem 1 of the paper's superposition in closed form, and the explicit time steps of problem 2."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from contact_heat.analytic import scaled_erfc
from contact_heat.hosting import kernel
from contact_heat.stack import Array


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """A side divided into nodes, the first on the contact; shape (nodes,), and (nodes - 1,) for ``conductance``."""

    depths: Array
    capacity: Array
    conductance: Array
    blood: Array
    initial: Array
    back: float
    back_temperature: float
    arterial: float
    first: int
    alpha: float
    effusivity: float

    def fastest(self, resistance: float) -> float:
        """Return the largest rate [1/s] of a node: the reciprocal of the stable step."""
        joined = np.zeros_like(self.capacity)
        joined[:-1] += self.conductance
        joined[1:] += self.conductance
        joined[0] += 1.0 / resistance if resistance > 0.0 else 0.0
        joined[-1] += self.back if np.isfinite(self.back) else 0.0
        return float(((joined + self.blood) / self.capacity).max())


def first_problem(beta_s: float, beta_m: float, skin: float, material: float, resistance: float) -> Array:
    """Return an array of the quantities of problem 1, shape (6,).

    They are: skin and material temperature [K], each face's share of their difference, H [s^-1/2] (0 without R), and
    the effusivity in the flux [W s^0.5/m2K].
    """
    total = beta_s + beta_m
    rate = (1.0 / beta_s + 1.0 / beta_m) / resistance if resistance > 0.0 else 0.0
    return np.array((skin, material, beta_m / total, beta_s / total, rate, beta_s * beta_m / total))


def first_flux(problem: Array, times: Array) -> tuple[Array, Array]:
    """Return flux [W/m2] and heat [J/m2] of problem 1 at times [s].

    ``problem`` (6,) is from `first_problem`; ``times``, flux and heat have shape (times,).
    """
    skin, material, _, _, rate, beta = problem
    difference = skin - material
    if rate == 0.0:
        return difference * beta / np.sqrt(np.pi * times), 2.0 * difference * beta * np.sqrt(times / np.pi)
    z = rate * np.sqrt(times)
    rise = np.where(z > 1e-2, scaled_erfc(z) - 1.0 + 2.0 * z / math.sqrt(math.pi), z**2 - 4.0 * z**3 / 5.3173615527)
    return difference * beta * rate * scaled_erfc(z), difference * beta / rate * rise


@kernel
def _erfcx(z: float) -> float:
    """Return ``exp(z**2) erfc(z)`` for z >= 0."""
    if z < 5.0:
        return float(math.exp(z * z) * math.erfc(z))
    fraction = z
    for n in range(40, 0, -1):
        fraction = z + 0.5 * n / fraction
    return float(1.0 / (math.sqrt(math.pi) * fraction))


@kernel
def _first(x: float, time: float, initial: float, rise: float, alpha: float, rate: float) -> float:
    """Return the temperature of problem 1 [K]; ``rise`` is the final change of the face's temperature."""
    if time <= 0.0:
        return float(initial + (rise if x == 0.0 and rate == 0.0 else 0.0))
    u = x / (2.0 * math.sqrt(alpha * time))
    if u > 6.0:
        return initial
    part = math.erfc(u)
    if rate > 0.0:
        part -= math.exp(-u * u) * _erfcx(u + rate * math.sqrt(time))
    return float(initial + rise * part)


@kernel
def _explicit(nodes: Array, numbers: Array, now: Any, after: Any, field: Any, time: float, step: float) -> None:
    """Step problem 2 of one side, without the contact flux.

    ``nodes`` has the rows depth, heat capacity, conductance to the next node, and perfusion; ``numbers`` is laid out as
    in `_numbers`.  ``now`` and ``after`` hold problem 1 at both ends of the step, from the first node at which it is
    needed.  Within the first layer problem 1 solves the equation by itself; its imbalance from that layer's inner face
    on is a source of problem 2.
    """
    first, lowest, initial, rise, alpha, rate, back, back_temperature, arterial = numbers
    last = field.shape[0] - 1
    for i in range(int(lowest), last + 1):
        after[i] = _first(nodes[0, i], time + step, initial, rise, alpha, rate)
    flow = 0.0
    for i in range(last + 1):
        gained = flow + nodes[3, i] * (arterial - now[i] - field[i])
        if i >= first:
            gained += nodes[2, i - 1] * (now[i - 1] - now[i]) - nodes[1, i] * (after[i] - now[i]) / step
        flow = 0.0
        if i < last:
            flow = nodes[2, i] * (field[i] - field[i + 1])
            gained -= flow
            if i >= first:
                gained -= nodes[2, i] * (now[i] - now[i + 1])
        elif back < np.inf:
            gained += back * (back_temperature - now[i] - field[i])
        field[i] += step * gained / nodes[1, i]
    if back == np.inf:
        field[last] = back_temperature - after[last]
    for i in range(int(lowest), last + 1):
        now[i] = after[i]


class Side(NamedTuple):
    """One side: its nodes and numbers as the compiled steps take them, its field at the start, and room for the fields.

    ``fields`` [K] have the shape (times, nodes).
    """

    nodes: Array
    numbers: Array
    start: Array
    fields: Array


def march(
    finger: Chain, body: Chain, problem: Array, resistance: float, times: Array, step: float, *, split: bool
) -> tuple[Array, Array, Array, Array, tuple[Array, Array]]:
    """Return flux, face temperatures of finger and object, heat, shape (times,), and the fields of both sides.

    ``problem`` (6,) is from `first_problem`; ``resistance`` [K m2/W], ``times`` and ``step`` [s]; flux [W/m2],
    temperatures [K], heat [J/m2]; the fields [K] (times, nodes of the side).
    """
    rise = (problem[1] - problem[0]) * problem[2], (problem[0] - problem[1]) * problem[3]
    level = (problem[0], problem[1]) if split else (0.0, 0.0)
    rises = rise if split else (0.0, 0.0)
    chains = (finger, body)
    fields = [np.zeros((len(times), len(chain.depths))) for chain in chains]
    flux, heat = np.zeros(len(times)), np.zeros(len(times))
    sides = [
        Side(_nodes(chain), _numbers(chain, level[n], rises[n], float(problem[4])), chain.initial - level[n], fields[n])
        for n, chain in enumerate(chains)
    ]
    _march(sides[0], sides[1], resistance, times, step, flux, heat)
    if split:
        alone = first_flux(problem, times)
        flux, heat = flux + alone[0], heat + alone[1]
    return flux, fields[0][:, 0], fields[1][:, 0], heat, (fields[0], fields[1])


def _nodes(chain: Chain) -> Array:
    return np.stack((chain.depths, chain.capacity, np.append(chain.conductance, 0.0), chain.blood))


#: Places in the numbers of a side.
FIRST, LOWEST, LEVEL, RISE, ALPHA, RATE, BACK, BACK_TEMPERATURE, ARTERIAL = range(9)


def _numbers(chain: Chain, level: float, rise: float, rate: float) -> Array:
    # If blood flows in the first layer, problem 1 is needed throughout that layer.
    lowest = 0 if chain.blood[: chain.first].any() else chain.first - 1
    back = (chain.back, chain.back_temperature, chain.arterial)
    return np.array((chain.first, lowest, level, rise, chain.alpha, rate, *back))


@kernel
def _march(
    finger_side: Side, body_side: Side, resistance: float, times: Array, step: float, flux: Array, heat: Array
) -> None:
    """Step to the last time; between two steps, problem 2 is interpolated linearly and problem 1 is exact."""
    finger, finger_numbers, finger_fields = finger_side.nodes, finger_side.numbers, finger_side.fields
    body, body_numbers, body_fields = body_side.nodes, body_side.numbers, body_side.fields
    f, b = finger_side.start.copy(), body_side.start.copy()
    f_old, b_old = f.copy(), b.copy()
    f_now, b_now = np.full(len(f), finger_numbers[LEVEL]), np.full(len(b), body_numbers[LEVEL])
    f_next, b_next = f_now.copy(), b_now.copy()
    join = finger[1, 0] * body[1, 0] / (finger[1, 0] + body[1, 0])
    j = (f[0] - b[0]) / resistance if resistance > 0.0 else 0.0
    total, time, out = 0.0, 0.0, 0
    while out < len(times):
        for i in range(len(f)):
            f_old[i] = f[i]
        for i in range(len(b)):
            b_old[i] = b[i]
        _explicit(finger, finger_numbers, f_now, f_next, f, time, step)
        _explicit(body, body_numbers, b_now, b_next, b, time, step)
        j_old, total_old = j, total
        passed = join * (f[0] - b[0]) / step if resistance == 0.0 else j_old
        f[0] -= passed * step / finger[1, 0]
        b[0] += passed * step / body[1, 0]
        # Without resistance, the flux is the one that makes both faces equal at the end of the step.
        j = passed if resistance == 0.0 else (f[0] - b[0]) / resistance
        total += passed * step
        time += step
        while out < len(times) and times[out] <= time * (1.0 + 1e-12):
            part = min((times[out] - (time - step)) / step, 1.0)
            flux[out] = j_old + part * (j - j_old)
            heat[out] = total_old + part * (total - total_old)
            _write(finger, finger_numbers, f_old, f, part, times[out], finger_fields[out])
            _write(body, body_numbers, b_old, b, part, times[out], body_fields[out])
            out += 1


@kernel
def _write(nodes: Array, numbers: Array, old: Array, new: Array, part: float, time: float, row: Any) -> None:
    for i in range(len(new)):
        alone = _first(nodes[0, i], time, numbers[LEVEL], numbers[RISE], numbers[ALPHA], numbers[RATE])
        row[i] = alone + old[i] + part * (new[i] - old[i])
