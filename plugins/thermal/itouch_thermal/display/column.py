"""The column under the fingertip, tissue above and plate below, as modes packed for stepping.

Both halves are made of the solver's own layers.  A step takes the contact flux as linear in time, so that the heat that
leaves one half is, to the last bit, the heat that enters the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact_heat.layers import Back, Initial, Layer, Side
from contact_heat.modes import Modes, layer_modes
from contact_heat.steady import initial_profile, resting_profile
from itouch.plugin import building
from itouch_thermal.display.sideways import Sideways, fading, shares

Array = NDArray[np.float64]

#: Modes with rates up to this many per step are kept: faster ones decay within the step.
REACH = 4.0
#: Rows of the packed tissue: decay, port, weights of the flux at the start and at the end of a step.
F_DECAY, F_PORT, F_BEGIN, F_END = range(4)
#: Rows of the packed plate: decay, contact port, back port, weights of the contact flux at the start and at the end of
#: a step, weight of the pumped heat, heat in the film's upper half, film temperature, plate's mean, weight of air
#: beside the contact, and excess of the temperature under the finger over the plate's mean.
P_DECAY, P_PORT, P_BACK, P_BEGIN, P_END, P_PUMP, P_HALF, P_SENSE, P_MEAN, P_SPILL, P_EXCESS, P_ROWS = range(12)

#: Points, from -1 to 1, at which the heat in half of the plate's first layer is evaluated, and their weights.
_NODES = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """Packed halves for one step length: ``tissue`` (4, n) and ``plate`` (P_ROWS, m), and the tissue's resting surface.

    ``rise`` (n,) is the steady tissue field with 1 K more at the skin; ``flat`` (m,) the uniform plate field of 1 K.
    """

    period: float
    tissue: Array
    plate: Array
    rest: float
    rise: Array
    flat: Array
    resting_flux: float


def tissue_side(layers: Sequence[Layer], core: float, skin: float) -> Side:
    """Return a fingertip at rest with a skin temperature [K], and its back held at the core's temperature [K]."""
    start = Initial(kind="steady", surface=skin)
    return Side(layers=tuple(layers), initial=start, back=Back(kind="temperature", temperature=core), arterial=core)


def column(
    tissue: tuple[Layer, ...], core: float, skin: float, plate: tuple[Layer, ...], period: float, fastest: float,
    sideways: Sideways | None = None,
) -> Column:  # fmt: skip
    """Return the column for steps of ``period`` [s] with rates up to ``fastest`` [1/s].

    Without ``sideways`` the finger covers the plate.  With it, the plate's last modes are the fields of
    `display.sideways`; the ports are those for its covered part, or of 1 if that may change: see `sideways.table`.
    """
    build = _column if building() else _cached_column
    return build(tissue, core, skin, plate, period, fastest, sideways)


def _column(
    tissue: tuple[Layer, ...], core: float, skin: float, plate: tuple[Layer, ...], period: float, fastest: float,
    sideways: Sideways | None,
) -> Column:  # fmt: skip
    side = tissue_side(tissue, core, skin)
    above = layer_modes(side.layers, side.back, fastest)
    below = layer_modes(plate, Back(kind="insulated"), fastest, True)
    rows = _plate_rows(below, plate, period)
    if sideways is not None:
        rows = _spread_rows(rows, plate, period, sideways)
    found = Column(
        period,
        _tissue_rows(above, period),
        rows,
        resting_profile(side).surface,
        np.array(above.unit_rise),
        np.concatenate((below.content, np.zeros(rows.shape[1] - len(below.content)))),
        -float(initial_profile(side).flux_at(0.0)),
    )
    for array in (found.tissue, found.plate, found.rise, found.flat):
        array.setflags(write=False)
    return found


_cached_column = lru_cache(maxsize=32)(_column)


def ramp_weights(rates: Array, period: float) -> tuple[Array, Array]:
    """Return the weights [s] with which a flux linear over a step acts on modes, for its start and for its end.

    ``rates`` has shape (modes,) [1/s], ``period`` is in [s]; both results have shape (modes,).
    """
    x = np.maximum(rates * period, 1e-12)
    small = x < 1e-3
    safe = np.where(small, 1.0, x)
    begin = np.where(small, 0.5 - x / 3 + x * x / 8, (1.0 - np.exp(-safe) * (1.0 + safe)) / safe**2)
    end = np.where(small, 0.5 - x / 6 + x * x / 24, (safe - 1.0 + np.exp(-safe)) / safe**2)
    return begin * period, end * period


def _tissue_rows(modes: Modes, period: float) -> Array:
    begin, end = ramp_weights(modes.rates, period)
    return np.stack((np.exp(-modes.rates * period), modes.contact, begin * modes.contact, end * modes.contact))


def _plate_rows(modes: Modes, layers: Sequence[Layer], period: float) -> Array:
    begin, end = ramp_weights(modes.rates, period)
    half = 0.5 * (layers[0].thickness or 0.0)
    heat: Any = sum(w * modes.row(float(half * 0.5 * (x + 1.0))) for x, w in zip(*_NODES, strict=True))
    heat = heat * 0.5 * half * layers[0].heat_capacity
    capacity = float(modes.weights.sum())
    return np.stack(
        (
            np.exp(-modes.rates * period), modes.contact, modes.back, begin * modes.contact, end * modes.contact,
            (begin + end) * modes.back, heat, modes.row(half), modes.content / capacity,
            (begin + end) * modes.contact, np.zeros(len(modes.rates)),
        )
    )  # fmt: skip


def _spread_rows(rows: Array, layers: Sequence[Layer], period: float, sideways: Sideways) -> Array:
    """Return a plate's rows with those of the fields, by which heat spreads along the plate, appended."""
    depths, rates = rows.shape[1], fading(layers, sideways)
    begin, end = ramp_weights(rates, period)
    fields, capacity = np.zeros((P_ROWS, len(rates))), plate_capacity(layers)
    fields[P_DECAY], fields[P_BEGIN], fields[P_END] = np.exp(-rates * period), begin / capacity, end / capacity
    fields[[P_PORT, P_SENSE, P_EXCESS]] = 1.0
    fields[P_HALF] = 0.5 * (layers[0].thickness or 0.0) * layers[0].heat_capacity
    found = np.concatenate((rows, fields), axis=1)
    # All heat is in the slowest mode, uniform to the last bit: the other modes are for other parts of the field.
    found[P_BACK, 0], found[P_PUMP, 0] = found[P_PORT, 0], found[P_SPILL, 0]
    found[P_MEAN] = 0.0
    found[P_MEAN, 0] = 1.0 / (capacity * found[P_PORT, 0])
    if sideways.cover is not None:
        ((into,), (out,)) = shares(np.array([sideways.cover]), depths)
        found[[P_BEGIN, P_END]] *= into
        found[[P_PORT, P_SENSE, P_HALF, P_EXCESS]] *= out
    return found


def plate_capacity(layers: Sequence[Layer]) -> float:
    """Return the heat capacity of the plate [J/m2K]."""
    return sum((layer.thickness or 0.0) * layer.heat_capacity for layer in layers)
