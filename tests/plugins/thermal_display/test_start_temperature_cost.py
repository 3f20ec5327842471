"""What a start temperature costs: the skin may differ by so much at once, by less later, and the flux by its share."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch_thermal.flux import start

PERIOD, STEPS = 0.01, 40
TIMES = PERIOD * np.arange(1, STEPS + 1)


def cost(skin: np.ndarray, flux: np.ndarray) -> float:
    """Return the cost of a contact whose skin [K] and flux [W/m2] differ from what is desired."""
    trial: Any = object.__new__(start.Trial)
    tissue = np.zeros((start.F_PORT + 1, 1))
    tissue[start.F_PORT] = 2.0
    trial.law, trial.steps = SimpleNamespace(period=PERIOD, fine=SimpleNamespace(rest=300.0, tissue=tissue)), STEPS
    trial.run = lambda *words: (5000.0 + flux, skin[:, None] / 2.0)
    touched: Any = SimpleNamespace(flux=np.full(STEPS, 5000.0), skin=np.full(STEPS, 300.0), effusivity=1e4)
    return float(trial.cost(300.0, np.zeros(1), touched))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_skin_may_differ_by_more_at_first_than_later(sign: float) -> None:
    sooner, later = np.where(TIMES < start.LATER - 1e-9, sign, 0.0), np.where(TIMES > start.LATER, sign, 0.0)
    still = np.zeros(STEPS)
    assert cost(20.0 * start.SKIN_EVER * sooner, still) == pytest.approx(20.0)
    assert cost(20.0 * start.SKIN_LATER * later, still) == pytest.approx(20.0)
    assert cost(20.0 * start.SKIN_EVER * sooner + 30.0 * start.SKIN_LATER * later, still) == pytest.approx(30.0)


def test_flux_costs_from_where_it_counts_and_costs_extra_where_it_is_past_what_is_allowed() -> None:
    still = np.zeros(STEPS)
    before, after = (
        np.where(part, 500.0, 0.0) for part in (TIMES < start.COUNTED_FROM - 1e-9, TIMES > start.COUNTED_FROM)
    )
    assert cost(still, before) == cost(still, still) < 1.0
    assert 1.0 < cost(still, 0.5 * after) < cost(still, after) < cost(still, 2.0 * after)
