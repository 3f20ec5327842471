"""The exact evaluator against solved cases, an oracle in long arithmetic, closed forms and its own energy."""

import heat_cases
import numpy as np
import oracle
import pytest
from campaign import seeds
from hypothesis import given, settings
from hypothesis import strategies as st

from contact_heat import analytic
from contact_heat.casefile import CELSIUS
from contact_heat.contact import case_of
from contact_heat.energy import energy_balance
from contact_heat.exact import imbalance
from contact_heat.stack import Stack
from contact_heat.steady import initial_profile
from contact_heat.trial_functions import trial_span
from itouch_thermal import Back, Contact, Initial, Layer, Side, solve

SKIN = Layer(conductivity=0.34, density=1200, specific_heat=3340)
WOOD = Layer(conductivity=0.11, density=415, specific_heat=2720)


def uniform(layer, celsius):
    return Side(layers=(layer,), initial=Initial(kind="uniform", temperature=celsius + CELSIUS))


def errors(solution, case, wanted):
    """Return the errors as the figures are stated: flux, heat, temperatures and probes."""
    flux = np.maximum(np.abs(wanted["j"]), 1.0)
    found = {
        "j": (np.abs(solution.flux - wanted["j"]) / flux, 1e-10),
        "Q": (np.abs(solution.heat - wanted["Q"]) / np.abs(wanted["Q"]), 1e-9),
        "T_skin": (np.abs(solution.skin_temperature - CELSIUS - wanted["T_skin"]), 1e-9),
        "T_object": (np.abs(solution.object_temperature - CELSIUS - wanted["T_object"]), 1e-9),
    }
    for probe in case.get("probes", []):
        name, where = probe["name"], (probe["side"], probe["depth"])
        if probe["what"] == "T":
            found[name] = (np.abs(solution.temperature(*where) - CELSIUS - wanted[name]), 1e-9)
        else:
            found[name] = (np.abs(solution.flux_at(*where) - wanted[name]) / flux, 1e-9)
    return {name: (float(np.max(error)), limit) for name, (error, limit) in found.items()}


@pytest.mark.parametrize("name", heat_cases.SOLVED)
def test_solutions_agree_with_solved_cases(name):
    case, wanted = heat_cases.solved(name)
    late = wanted["t"] >= 1e-5
    wanted = {key: column[late] for key, column in wanted.items()}
    found = errors(solve(case_of(case), wanted["t"]), case, wanted)
    assert {key: error for key, (error, limit) in found.items() if error > limit} == {}


@pytest.mark.parametrize("seed", seeds(3, 14))
def test_random_cases_against_the_oracle(seed):
    case = heat_cases.random_case(seed)
    times = np.geomspace(1e-5, 100.0, 4) * np.array([1.0, 1.7, 0.6, 1.0])
    wanted = {key: np.array(column) for key, column in oracle.solve(case, times.tolist()).items()}
    found = errors(solve(case_of(case), times), case, wanted)
    assert {key: error for key, (error, limit) in found.items() if error > limit} == {}


def test_the_oracle_agrees_with_a_closed_form():
    case = {
        "finger": {"layers": [{"L": None, "k": 0.34, "rho": 1200, "c": 3340}], "initial": {"type": "uniform", "T": 33}},
        "object": {"layers": [{"L": None, "k": 0.11, "rho": 415, "c": 2720}], "initial": {"type": "uniform", "T": 23}},
        "Rth": 1e-4,
    }
    times = [1e-5, 1e-2, 10.0]
    wanted = analytic.resistance_flux(SKIN.effusivity, WOOD.effusivity, 10.0, 1e-4, np.array(times))
    assert oracle.solve(case, times)["j"] == pytest.approx(wanted, rel=1e-14)


def test_half_spaces_follow_equations_1_2_and_7():
    times = np.geomspace(1e-5, 100.0, 15)
    solution = solve(Contact(uniform(SKIN, 33.0), uniform(WOOD, 23.0), 0.0), times)
    contact = analytic.contact_temperature(WOOD.effusivity, 23.0 + CELSIUS, SKIN.effusivity, 33.0 + CELSIUS)
    assert solution.flux == pytest.approx(
        analytic.contact_flux(SKIN.effusivity, contact, 33.0 + CELSIUS, times), rel=1e-12
    )
    assert solution.skin_temperature == pytest.approx(np.full(15, contact), abs=1e-11)
    alpha = analytic.diffusivity(0.34, 1200, 3340)
    wanted = [analytic.half_space_temperature(contact, 33.0 + CELSIUS, alpha, np.array([2e-4]), t)[0] for t in times]
    assert solution.temperature("finger", 2e-4) == pytest.approx(np.array(wanted), abs=1e-11)


def test_equation_3_starts_the_display_at_the_right_flux():
    beta_p = 9502.0
    start = analytic.display_temperature(beta_p, beta_m=352.0, material=23.0, beta_s=1167.0, skin=34.45)
    assert analytic.contact_temperature(beta_p, start, 1167.0, 34.45) == pytest.approx(
        analytic.contact_temperature(352.0, 23.0, 1167.0, 34.45), abs=1e-12
    )


def test_equation_9_is_the_field_under_a_constant_flux():
    alpha, k, time, step = 1e-7, 0.3, 2.0, 1e-6
    face = analytic.constant_flux_temperature(300.0, 500.0, k, alpha, np.array([0.0, step]), time)
    assert (face[0] - face[1]) / step * k == pytest.approx(500.0, rel=2e-3)
    assert face[0] - 300.0 == pytest.approx(2.0 * 500.0 * np.sqrt(time / np.pi) / (k / np.sqrt(alpha)), rel=1e-12)


@pytest.mark.parametrize("seed", seeds(6, 30, first=20))
def test_the_energy_balance_closes(seed):
    contact = case_of(heat_cases.random_case(seed))
    solution = solve(contact, np.geomspace(1e-4, 100.0, 9))
    for name in ("finger", "object"):
        side = contact.side(name)
        endless_drive = side.semi_infinite and side.layers[-1].perfusion > 0.0 and imbalance(side) is not None
        if not endless_drive:
            assert energy_balance(solution, name).residual.max() < 1e-8


@settings(max_examples=40, deadline=None)
@given(
    st.floats(1e-5, 100.0), st.floats(0.0, 1e-2), st.floats(250.0, 350.0), st.floats(0.02, 400.0), st.floats(1e-6, 0.05)
)
def test_flux_falls_with_resistance_and_turns_with_the_sign(time, resistance, temperature, conductivity, thickness):
    body = Side(
        layers=(Layer(thickness=thickness, conductivity=conductivity, density=1000, specific_heat=1000),),
        initial=Initial(kind="uniform", temperature=temperature),
        back=Back(kind="temperature", temperature=temperature),
    )
    finger = uniform(SKIN, 33.0)
    flux = solve(Contact(finger, body, resistance), [time]).flux[0]
    less = solve(Contact(finger, body, resistance + 1e-3), [time]).flux[0]
    assert flux * (33.0 + CELSIUS - temperature) >= 0.0
    assert abs(less) <= abs(flux) * (1.0 + 1e-12)
    assert abs(flux) <= SKIN.effusivity * abs(33.0 + CELSIUS - temperature) / np.sqrt(np.pi * time) * (1.0 + 1e-9)


def test_steady_profile_in_air_loses_what_the_film_takes():
    case, _ = heat_cases.solved("b_wood_R0")
    profile = initial_profile(case_of(case).finger)
    assert profile.flux == pytest.approx(-10.0 * (profile.surface - 23.0 - CELSIUS), rel=1e-13)
    assert profile.faces[-1] == pytest.approx(37.0 + CELSIUS, abs=1e-12)


@pytest.mark.parametrize("times", [[], [0.0], [-1.0], [1.0, 0.5], [1.0, 1.0], [np.nan], [np.inf]])
def test_bad_times_are_refused(times):
    contact = Contact(uniform(SKIN, 33.0), uniform(WOOD, 23.0), 0.0)
    if not times:
        assert len(solve(contact, times).flux) == 0
        return
    with pytest.raises(ValueError, match=r"times\[\d\]"):
        solve(contact, times)


def test_depths_outside_are_refused():
    solution = solve(case_of(heat_cases.solved("b_wood_R0")[0]), [1.0])
    with pytest.raises(ValueError, match="depth"):
        solution.temperature("finger", 1.0)
    with pytest.raises(ValueError, match="side"):
        solution.temperature("plate", 0.0)


@pytest.mark.parametrize(
    ("thickness", "back", "more"), [(2e-3, 0.0, 1), (2e-3, 40.0, 0), (2e-3, np.inf, 0), (np.inf, 0.0, 0)]
)
def test_only_heat_that_nothing_lets_out_needs_a_constant_field(thickness, back, more):
    """An insulated layer keeps what has entered it: no response to a flux that decays has that."""
    one = np.ones(1)
    stack = Stack(thickness * one, 0.34 * one, 4e6 * one, 0.0 * one, back)
    span = trial_span(stack, np.array([0.1, 1.0, 10.0]), [np.linspace(0.0, 1e-3, 5)], back_port=False, drive=None)
    assert span.values.shape[1] == 3 + more
    if more:
        assert np.ptp(span.values[:, -1]) == 0.0 != span.values[0, -1]
