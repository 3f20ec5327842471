"""The skin of a finger's twin under worn devices: the force on these, and the effect of their heat on the skin.

A column of tissue, computed by finite volumes, implicit in time, as the deviation from rest.  Skin at rest loses heat
to the air; a device that covers it takes heat instead of the air, and reports how much.  If a plate's twin has a model
of the finger's tissue, that is the skin, and it is told what the worn devices take besides the plate; of several such
plates the first one's model is the skin, and all are told.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.plugin import Bound, Record, TwinInputs
from itouch.world.state_fields import CELLS

Floats = NDArray[np.float64]

#: Thickness of the first cell of the column [m], and how much thicker each is than the one above: 9 mm in all.
FIRST, GROWTH = 5e-5, 1.15
#: Conductivity [W/mK] and heat capacity [J/m3K] of skin, heat exchange with blood [W/m3K] below the epidermis, and the
#: thickness of the epidermis [m]: epidermis and dermis of Torvi and Dale (1994), with the fingertip's thick epidermis.
CONDUCTIVITY, CAPACITY, BLOOD, EPIDERMIS = 0.34, 4.0e6, 5e3, 7e-4
#: Heat transfer coefficient [W/m2K] from skin at rest to the air.
AIR = 10.0

#: Rows of the column's constants, and their number.
_BELOW, _PIVOT, _KEPT, ROWS = 0, 1, 2, 3
#: Places of the skin's temperature now, and of its lowest and highest so far.
NOW, LOWEST, HIGHEST = 0, 1, 2


def column(period: float) -> Floats:
    """Return a step's constants (``period`` [s]), shape (ROWS, CELLS): the implicit step's elimination, done once."""
    thick = FIRST * GROWTH ** np.arange(CELLS)
    between = CONDUCTIVITY / (0.5 * (thick + np.append(thick[1:], 0.0)))  # the deepest cell is half above the core
    above = np.append(0.0, between[:-1])
    kept = CAPACITY * thick / period
    blood = np.where(np.cumsum(thick) > EPIDERMIS, BLOOD * thick, 0.0)
    pivot = kept + above + between + blood
    for i in range(1, CELLS):
        pivot[i] -= between[i - 1] ** 2 / pivot[i - 1]
    found = np.stack((between, pivot, kept))
    found.setflags(write=False)
    return found


@kernel
def wear(
    grid: Floats, tissue: Floats, skin: Floats, own: Floats, taken: Floats, beside: Floats, total: Floats,
    faces: Floats, rest: float, resting: float,
) -> int:  # fmt: skip
    """Advance the skin by one period, and write the force on each worn device; return 0.

    Parameters
    ----------
    grid, tissue
        The column's constants (`column`), and how much warmer its cells are than at rest [K], shape (CELLS,).
    skin
        Temperature now, lowest, highest [K], shape (3,); written.
    own
        The skin's temperature [K] from another model of the finger's tissue, shape (1,); (0,): there is none.
    taken, beside
        Heat flux that each worn device takes from the finger [W/m2], shape (n,); written: the sum of these, once for
        each other model of the tissue, shape (m,).
    total, faces
        Force on the finger [N], shape (1,); written: force [N] and gap [m] of each worn device, shape (n, 2).
    rest, resting
        The skin's temperature at rest [K], and the heat flux that it then loses to the air [W/m2].
    """
    drawn = 0.0
    for i in range(taken.shape[0]):
        drawn += taken[i]
        faces[i, 0], faces[i, 1] = total[0], 0.0
    for i in range(beside.shape[0]):
        beside[i] = drawn
    if own.shape[0] > 0:
        skin[NOW] = own[0]
    else:
        skin[NOW] = rest + _step(grid, tissue, drawn - resting)
    skin[LOWEST], skin[HIGHEST] = min(skin[LOWEST], skin[NOW]), max(skin[HIGHEST], skin[NOW])
    return 0


@kernel
def _step(grid: Floats, tissue: Floats, out: float) -> float:
    """Advance the column under a flux out of its surface [W/m2]; return how much warmer that is than at rest [K]."""
    n = tissue.shape[0]
    for i in range(n):
        tissue[i] *= grid[_KEPT, i]
    tissue[0] -= out
    for i in range(1, n):
        tissue[i] += grid[_BELOW, i - 1] / grid[_PIVOT, i - 1] * tissue[i - 1]
    tissue[n - 1] /= grid[_PIVOT, n - 1]
    for i in range(n - 2, -1, -1):
        tissue[i] = (tissue[i] + grid[_BELOW, i] * tissue[i + 1]) / grid[_PIVOT, i]
    return float(tissue[0] - 0.5 * FIRST / CONDUCTIVITY * out)


class Skin:
    """The skin of one finger's twin under worn devices, as views of State.

    Parameters
    ----------
    state, name, period
        The State, the name of the probe, and the servo period [s].
    worn
        The twin inputs of each worn device.
    owners
        The skin's temperature [K], shape (1,), and the twin inputs of each plate whose twin has a model of the finger's
        tissue.
    rest, ambient
        Temperatures of the skin at rest and of the room [K].
    """

    def __init__(
        self, state: Record, name: str, period: float, worn: Sequence[TwinInputs],
        owners: Sequence[tuple[Floats, TwinInputs]], rest: float, ambient: float,
    ) -> None:  # fmt: skip
        self._skin, self._tissue, self._rest = state[f"{name}.skin"], state[f"{name}.tissue"], rest
        taken: Any = state[f"{name}.taken"]
        faces = np.zeros((len(worn), 2))
        own, beside = owners[0][0] if owners else np.zeros(0), np.zeros(len(owners))
        for i, (_, touch) in enumerate(owners):
            touch.total_heat_flux = beside[i : i + 1]
        for i, touch in enumerate(worn):
            touch.force_and_gap, touch.heat_flux, touch.skin_temperature = faces[i], taken[i : i + 1], self._skin[:1]
            touch.finger_attached = True
        #: A step of one period as one compiled call.
        self.bound = Bound(
            wear, column(period), self._tissue, self._skin, own, taken, beside,
            state.flat(f"{name}.total_force", f"{name}.total_force"), faces, float(rest), float(AIR * (rest - ambient)),
        )  # fmt: skip

    def reset(self) -> None:
        """Start at rest."""
        self._tissue[:] = 0.0
        self._skin[:] = self._rest
