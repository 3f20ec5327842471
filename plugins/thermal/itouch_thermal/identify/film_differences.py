"""The readings of a film on a sample in a touch, by finite volumes and implicit time steps.

It shares nothing with the closed form by which touches are fitted, so that a fit can be tested on the data of another
model.
"""

from __future__ import annotations

import math

import numpy as np

from contact_heat.layers import Layer
from itouch_thermal.display.column import Array
from itouch_thermal.identify.forward import Known, Values, tissue

#: Implicit time step [s]; numbers of cells of film, of a tissue layer, of a sample.
STEP, FILM, TISSUE, SAMPLE = 5e-4, 6, 48, 120
#: Ratio of a layer's last cell to the one at the contact; depth and diffusivity assumed for an unknown sample [m,
#: m2/s].
GROWTH, DEEP, DIFFUSIVITY = 30.0, 0.1, 1e-5
#: Heat transfer coefficient at the back of a sample [W/m2K].
BACK = 10.0
#: Number of steps whose outputs are computed at once.
_BLOCK = 64


def readings(known: Known, values: Values, times: Array) -> Array:
    """Return the film's readings [W/m2] at times [s], shape (touches, times); without the skin's flattening."""
    return np.stack([_touch(known, values, force, times) for force in known.forces])


def _touch(known: Known, values: Values, force: float, times: Array) -> Array:
    resistance = values.resistance * force ** -(values.exponent + values.curve * math.log(force))
    matrix, start, pick = _system(known, values, resistance)
    moved = np.maximum(times - values.late, 0.0)
    count = math.ceil(float(moved.max()) / STEP) + 1
    shown = _rows(matrix, start, pick, count)
    return values.gain * np.interp(moved, np.arange(count + 1) * STEP, shown) + values.offset


def _cells(layer: Layer, count: int, growth: float) -> Array:
    width: Array = np.geomspace(1.0, growth, count)
    found: Array = width / width.sum() * (layer.thickness or 0.0)
    return found


def _below(known: Known, values: Values) -> list[tuple[Layer, int, float]]:
    """Return the layers of film and sample from the contact on, with number and growth of their cells."""
    sample = known.sample
    if sample is None:  # only its effusivity matters
        conductivity = values.effusivity * math.sqrt(DIFFUSIVITY)
        sample = Layer(thickness=DEEP, conductivity=conductivity, density=conductivity / DIFFUSIVITY / 2000.0,
                       specific_heat=2000.0)  # fmt: skip
    film = [(known.film, FILM, 1.0)] if known.film is not None else []
    return [*film, (sample, SAMPLE, 10.0 * GROWTH)]


def _side(layers: list[tuple[Layer, int, float]]) -> tuple[Array, Array, Array]:
    """Return half the resistance [K m2/W], heat capacity [J/m2K] and perfusion [W/m2K] of cells from the contact on."""
    half, capacity, blood = [], [], []
    for layer, count, growth in layers:
        width = _cells(layer, count, growth)
        half.append(0.5 * width / layer.conductivity)
        capacity.append(width * layer.density * layer.specific_heat)
        blood.append(width * layer.perfusion)
    return np.concatenate(half), np.concatenate(capacity), np.concatenate(blood)


def _system(known: Known, values: Values, resistance: float) -> tuple[Array, Array, int]:
    """Return the matrix [1/s] of cells and film reading, the initial state, and the index of the reading.

    The cells are those of the finger from its core to the skin, then film and sample; the entry after them is the
    lagged reading, and the last entry is 1, which includes the sources in the matrix.
    """
    skin = _side([(layer, TISSUE, GROWTH) for layer in tissue(values)])
    body = _side(_below(known, values))
    half = np.concatenate((skin[0][::-1], body[0]))
    capacity = np.concatenate((skin[1][::-1], body[1]))
    blood = np.concatenate((skin[2][::-1], body[2]))
    joint, n = len(skin[0]), len(half)
    link = 1.0 / (half[:-1] + half[1:])
    touching = link.copy()
    touching[joint - 1] = 1.0 / (half[joint - 1] + half[joint] + resistance)
    core, back = 1.0 / half[0], 1.0 / (half[-1] + 1.0 / BACK)
    state = np.append(_rest(known, values, link[: joint - 1], blood[:joint], core, float(half[joint - 1])),
                      np.full(n - joint, known.room))  # fmt: skip
    matrix = np.zeros((n + 2, n + 2))
    for i, g in enumerate(touching):
        matrix[i, i] -= g
        matrix[i, i + 1] += g
        matrix[i + 1, i + 1] -= g
        matrix[i + 1, i] += g
    matrix[range(n), range(n)] -= blood
    matrix[range(n), n + 1] += blood * values.core
    for cell, g, outside in ((0, core, values.core), (n - 1, back, known.room)):
        matrix[cell, cell] -= g
        matrix[cell, n + 1] += g * outside
    matrix[:n] /= capacity[:, None]
    seen = joint + FILM // 2 - 1 if known.film is not None else joint - 1
    lag = max(values.lag, 1e-4)
    matrix[n, seen], matrix[n, seen + 1], matrix[n, n] = touching[seen] / lag, -touching[seen] / lag, -1.0 / lag
    return matrix, np.concatenate((state, (0.0, 1.0))), n


def _rest(known: Known, values: Values, link: Array, blood: Array, core: float, last: float) -> Array:
    """Return the finger's cells [K] at rest in air, from the core outwards, for the known skin temperature."""
    matrix = np.diag(blood + 0.0)
    for i, g in enumerate(link):
        matrix[i, i] += g
        matrix[i + 1, i + 1] += g
        matrix[i, i + 1] -= g
        matrix[i + 1, i] -= g
    source = blood * values.core
    for cell, g, outside in ((0, core, values.core), (len(blood) - 1, 1.0 / last, known.skin)):
        matrix[cell, cell] += g
        source[cell] += g * outside
    return np.asarray(np.linalg.solve(matrix, source))


def _rows(matrix: Array, start: Array, pick: int, count: int) -> Array:
    """Return one entry of the state after 0 to ``count`` steps, each of two implicit stages: L-stable, second order."""
    gamma, one = 1.0 - math.sqrt(0.5), np.eye(len(start))
    stage = np.linalg.inv(one - gamma * STEP * matrix) @ (STEP * matrix)
    step = one + (1.0 - gamma) * stage + gamma * stage @ (one + (1.0 - gamma) * stage)
    rows = [one[pick]]
    for _ in range(_BLOCK - 1):
        rows.append(rows[-1] @ step)
    shown, several = [], np.linalg.matrix_power(step, _BLOCK)
    state = start
    for _ in range(count // _BLOCK + 1):
        shown.append(np.array(rows) @ state)
        state = several @ state
    return np.concatenate(shown)[: count + 1]
