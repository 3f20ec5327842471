"""The paper's scheme: orders of convergence, what the superposition gains, and the stability bound."""

from dataclasses import replace

import numpy as np
import pytest

from contact_heat.differences import solve_differences
from contact_heat.measure import changing
from contact_heat.published_cases import FINGERTIP, WOOD, block, published_cases
from itouch_thermal import Contact, solve

CONTACT = Contact(FINGERTIP, block(WOOD), 1e-3)


def error(contact, times, **settings):
    found = solve_differences(contact, times, **settings).flux
    return np.abs(found / solve(contact, times).flux - 1.0)


def test_second_order_in_space():
    thicknesses = (8e-4, 1.6e-3, 4.8e-3)
    layers = tuple(replace(a, thickness=b) for a, b in zip(FINGERTIP.layers, thicknesses, strict=True))
    contact = Contact(replace(FINGERTIP, layers=layers), block(WOOD), 1e-3)
    found = [solve_differences(contact, [1.0, 5.0], spacing=s, step=5e-4) for s in (2e-4, 1e-4, 5e-5, 2.5e-5)]
    steps = np.diff([solution.skin_temperature for solution in found], axis=0)
    orders = np.log2(np.abs(steps[:-1] / steps[1:]))
    assert np.all(np.abs(orders - 2.0) < 0.2), orders


def test_first_order_in_time():
    times = [0.5, 1.0]
    steps = (0.02, 0.01, 0.005, 1e-4)
    found = [solve_differences(CONTACT, times, spacing=1.5e-4, step=step).flux for step in steps]
    errors = [float(np.abs(flux - found[-1]).max()) for flux in found[:-1]]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 1.0) < 0.25), (errors, orders)


@pytest.mark.parametrize("name", ["wood, R 0", "polystyrene, R 2e-3"])
def test_without_the_split_the_first_moments_are_lost(name):
    contact = published_cases()[name]
    times = np.geomspace(1e-5, 3e-3, 6)
    assert error(contact, times, spacing=1e-4, split=True).max() < 2e-3
    assert error(contact, times, spacing=1e-4, split=False).max() > 0.05


def test_half_spaces_are_exact():
    from test_heat_exact import SKIN, uniform
    from test_heat_exact import WOOD as BARE

    contact = Contact(uniform(SKIN, 33.0), uniform(BARE, 23.0), 1e-4)
    assert error(contact, np.geomspace(1e-4, 1.0, 5)).max() < 1e-11


def test_fields_and_heat():
    found = solve_differences(CONTACT, [1.0, 10.0], spacing=5e-5)
    wanted = solve(CONTACT, [1.0, 10.0])
    assert found.heat == pytest.approx(wanted.heat, rel=1e-3)
    assert found.temperature("finger", 5e-4) == pytest.approx(wanted.temperature("finger", 5e-4), abs=1e-2)
    assert found.flux_at("object", 1e-3) == pytest.approx(wanted.flux_at("object", 1e-3), rel=5e-2)
    assert solve(CONTACT, [1.0], method="paper").flux[0] == pytest.approx(wanted.flux[0], rel=1e-3)


def test_unstable_steps_are_refused():
    with pytest.raises(ValueError, match="stable up to"):
        solve_differences(CONTACT, [1.0], step=1.0)
    with pytest.raises(ValueError, match="method"):
        solve(CONTACT, [1.0], method="guess")


@pytest.mark.parametrize("spacing", [0.0, 9e-9, 1.1, float("nan")])
def test_a_distance_of_nodes_that_can_not_be_is_refused(spacing):
    with pytest.raises(ValueError, match="spacing = .* out of range: 1e-08 to 1 m"):
        solve_differences(CONTACT, [1.0], spacing=spacing)


def test_the_resistance_that_changes_swings_by_30_percent_twenty_times_a_second():
    history = changing(2e-3, 1000)
    assert history.shape == (1000,)
    assert history.min() == pytest.approx(1.4e-3, rel=1e-3)
    assert history.max() == pytest.approx(2.6e-3, rel=1e-3)
    assert history[:50].argmax() in (11, 12)  # a quarter of 50 ms
    np.testing.assert_allclose(history[50:], history[:-50], rtol=1e-9)
