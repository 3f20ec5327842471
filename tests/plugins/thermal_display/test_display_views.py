"""Single steps of the views of a thermal display, with stand-ins for what is around them."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch_thermal.display import DisplayParams
from itouch_thermal.display.column import plate_capacity
from itouch_thermal.flux import approach, flux_error, flux_tick, published
from itouch_thermal.flux.modality import FluxControl


@pytest.mark.parametrize(("way", "extreme"), [(-1.0, 1e9), (1.0, -1e9)])
def test_the_greatest_rate_is_a_mean_over_the_last_half_second(way: float, extreme: float) -> None:
    """From the flux at the bound it is seen with which earlier temperature of the plate it was reckoned."""
    display, period = DisplayParams(), 1e-3
    names = SimpleNamespace(begun="begun", fresh="fresh", heat_flux="heat_flux")
    model: Any = SimpleNamespace(name="f", names=names, display=display, period=period, band=(100.0, 500.0))
    state: Any = {"f.passed": np.zeros(published.PIECES), "begun": np.array(100), "fresh": np.array(1),
                  "heat_flux": np.array(0.0)}  # fmt: skip
    capacity = plate_capacity(display.plate) / published.STOPPING
    swing = published.RATE * published.RATE_OVER * published.RATE_USED
    ages = list[float]()
    for tick in range(100, 1900):
        plate = 300.0 + way * 2.0 * (tick - 100) * period
        flux = published._bounded(model, state, extreme, plate, tick, period)
        state["fresh"][...] = 0
        before = plate - flux / capacity - way * swing
        if tick > 100 + published.RATE_OVER / period:
            ages.append((plate - before) / (way * 2.0))
    piece = published.RATE_OVER / published.PIECES
    assert published.RATE_OVER - 2.1 * piece < min(ages)
    assert published.RATE_OVER - 1.2 * piece < max(ages) < published.RATE_OVER


def test_a_virtual_rig_compares_an_estimate_only_when_it_is_new(monkeypatch: pytest.MonkeyPatch) -> None:
    found = list[tuple[float, float, float]]()
    monkeypatch.setattr(flux_error, "scored", lambda *_: True)
    monkeypatch.setattr(flux_error, "note_ground_truth", lambda state, name, *numbers: found.append(numbers))
    names = SimpleNamespace(
        truth="truth", touching="touching", object="object", heat_desired="desired", begun="begun", obtained="obtained"
    )
    model: Any = SimpleNamespace(
        name="f", params=SimpleNamespace(display="plate"), names=names, in_contact=lambda state: True, period=1e-3,
        hold=20, curves=[None],
    )  # fmt: skip
    state: Any = {"touching": np.array(1), "object": np.array(0), "desired": np.array(-900.0),
                  "obtained": np.array(-950.0), "f.account": np.zeros(9)}  # fmt: skip
    for tick in range(1, 62):
        FluxControl.on_ground_truth(
            SimpleNamespace(),
            model,
            state | {"tick": np.array(tick)},
            {"plate": {"truth": np.array(-1000.0)}},  # type: ignore[arg-type, dict-item]
        )
    assert len(found) == 61
    assert [tick for tick, (_, estimate, _) in enumerate(found) if not math.isnan(estimate)] == [0, 20, 40, 60]
    assert found[20] == (-1000.0, -950.0, -900.0)


@pytest.mark.parametrize(("load", "force"), [((0.0, 0.0, -1.5, 0.0, 0.0, 0.0), 1.5), ((), 2.5)])
def test_the_force_on_the_plate_is_what_is_measured_else_the_virtual_one(load: tuple[float, ...], force: float) -> None:
    scene = SimpleNamespace(load=np.array(load), normal_force=np.array([2.5]))
    assert flux_tick._force(scene) == force


@pytest.mark.parametrize(
    ("heat", "resistance", "force", "touches"),
    [
        (False, math.inf, 0.4, True), (False, 3e-4, 0.0, False),
        (True, 3e-4, 0.0, True), (True, math.inf, 0.4, False),
    ],
)  # fmt: skip
def test_a_finger_presses_by_its_resistance_where_there_is_heat_else_by_its_force(
    heat: bool, resistance: float, force: float, touches: bool
) -> None:
    scene = SimpleNamespace(resistance=np.array([resistance]), normal_force=np.array([force]))
    assert approach.in_contact(scene, heat) is touches
