"""The column of tissue under what is worn: a step is the solution of its implicit equations, whatever it starts from."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_in_python import python_of

from itouch.twin import skin_under_devices as worn
from itouch.world.state_fields import CELLS


@pytest.mark.parametrize(("period", "out"), [(1e-3, 0.0), (1e-3, 800.0), (0.25, -300.0)])
def test_a_step_solves_the_equations_of_all_cells(period: float, out: float) -> None:
    grid = worn.column(period)
    thick = worn.FIRST * worn.GROWTH ** np.arange(CELLS)
    between = worn.CONDUCTIVITY / (0.5 * (thick + np.append(thick[1:], 0.0)))
    blood = np.where(np.cumsum(thick) > worn.EPIDERMIS, worn.BLOOD * thick, 0.0)
    kept = worn.CAPACITY * thick / period
    equations = np.diag(kept + np.append(0.0, between[:-1]) + between + blood)
    equations -= np.diag(between[:-1], 1) + np.diag(between[:-1], -1)
    before = np.linspace(-2.0, 3.0, CELLS) ** 2
    tissue = before.copy()
    surface = python_of(worn._step)(grid, tissue, out)
    assert tissue == pytest.approx(np.linalg.solve(equations, kept * before - out * np.eye(CELLS)[0]), abs=1e-9)
    assert surface == pytest.approx(tissue[0] - 0.5 * worn.FIRST / worn.CONDUCTIVITY * out)
