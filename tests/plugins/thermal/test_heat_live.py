"""The live stepper: accuracy at constant and changing resistance, histories, exact continuation, heat."""

import heat_cases
import numpy as np
import pytest
from campaign import seeds

from contact_heat import live
from contact_heat.casefile import CELSIUS
from contact_heat.closed_loop import close_loop
from contact_heat.contact import case_of
from contact_heat.fields import waves
from contact_heat.measure import changing, fine, relative_error
from contact_heat.modes import side_modes
from contact_heat.packing import pair_of
from contact_heat.published_cases import SENSOR, published_cases
from contact_heat.stack import stack_of
from itouch_thermal import Back, Contact, Initial, Layer, LockStep, Side, Stepper, solve, solve_many

PERIOD = 1e-3
STEPS = np.unique(np.round(np.geomspace(1, 20_000, 40)).astype(int))


def case(name):
    return case_of(heat_cases.solved(name)[0])


@pytest.mark.parametrize("name", heat_cases.SOLVED)
def test_constant_resistance_from_the_first_step_on(name):
    contact = case(name)
    stepper = Stepper(contact, PERIOD)
    flux = stepper.advance(contact.resistance, int(STEPS[-1]))[STEPS - 1]
    wanted = solve(contact, STEPS * PERIOD)
    assert relative_error(flux, wanted.flux).max() < 1e-7
    assert stepper.skin_temperature == pytest.approx(wanted.skin_temperature[-1], abs=1e-6)
    assert stepper.object_temperature == pytest.approx(wanted.object_temperature[-1], abs=1e-6)
    assert stepper.heat == pytest.approx(wanted.heat[-1], rel=1e-7)


@pytest.mark.parametrize("seed", seeds(6, 30, first=60))
def test_random_cases_at_constant_resistance(seed):
    contact = case_of(heat_cases.random_case(seed))
    flux = Stepper(contact, PERIOD).advance(contact.resistance, int(STEPS[-1]))[STEPS - 1]
    assert relative_error(flux, solve(contact, STEPS * PERIOD).flux).max() < 1e-7


@pytest.mark.parametrize("period", [1e-4, 4e-3, 0.1])
def test_other_periods_are_as_accurate(period):
    contact = case("b_wood_R0")
    steps = np.array([1, 2, 10, 100])
    flux = Stepper(contact, period).advance(1e-3, 100)[steps - 1]
    wanted = solve(Contact(contact.finger, contact.object, 1e-3), steps * period).flux
    assert relative_error(flux, wanted).max() < 1e-7


@pytest.mark.parametrize("resistance", [1e-5, 2e-4, 2e-3])
@pytest.mark.parametrize("name", ["wood, R 0", "sensor + al, R 1e-4", "polystyrene, R 2e-3"])
def test_changing_resistance(name, resistance):
    contact = published_cases()[name]
    history = changing(resistance, 120)
    error = relative_error(Stepper(contact, PERIOD).advance(history), fine(contact, history, 8))
    assert error[0] < 1e-7
    assert error.max() < 1e-4
    assert error[5:].max() < 1e-5
    assert error[20:].max() < 1e-6


def test_press_release_and_touch_again():
    contact = published_cases()["sensor + al, R 1e-4"]
    history = 1e-3 / (1.0 - np.exp(-np.arange(1, 301) / 20.0))
    history[100:150] = np.inf
    flux = Stepper(contact, PERIOD).advance(history)
    parts = np.concatenate([fine_touch(contact, history)])
    assert np.all(flux[100:150] == 0.0)
    touching = np.isfinite(history)
    assert relative_error(flux, parts)[touching].max() < 1e-6
    # The finger has not recovered and the object is still warm: the second touch draws less.
    assert flux[150] < Stepper(contact, PERIOD).advance(history[150:151])[0]


def fine_touch(contact, history, parts=8):
    """Step a history with separations in parts of a step."""
    fast, before = [], np.inf
    for value in history:
        if np.isinf(value) or np.isinf(before):
            fast += [value] * parts
        else:
            fast += (before + (value - before) * np.arange(1, parts + 1) / parts).tolist()
        before = value
    return Stepper(contact, PERIOD / parts).advance(np.array(fast))[parts - 1 :: parts]


def test_a_separated_finger_goes_back_to_rest():
    contact = case("c_al_R1e-4_sensor37um")
    stepper = Stepper(contact, 0.01)
    rest = stepper.skin_temperature
    stepper.advance(1e-4, 300)
    assert stepper.skin_temperature < rest - 5.0
    stepper.advance(np.inf, 500_000)
    assert stepper.skin_temperature == pytest.approx(rest, abs=1e-6)


def test_a_history_in_parts_gives_the_same_bits():
    contact = case("c_al_R1e-4_sensor37um")
    rng = np.random.default_rng(5)
    history = np.repeat(rng.uniform(1e-4, 3e-3, 40), rng.integers(1, 25, 40))
    history[60:90] = np.inf
    straight = Stepper(contact, PERIOD)
    wanted = straight.advance(history)
    found, done, stepper = [], 0, Stepper(contact, PERIOD)
    while done < len(history):
        count = int(rng.integers(1, 30))
        found.append(stepper.advance(history[done : done + count]))
        done += count
        stepper, saved = Stepper(contact, PERIOD), stepper.state.copy()
        stepper.state[:] = saved
    assert np.array_equal(np.concatenate(found), wanted)
    assert np.array_equal(stepper.state, straight.state)
    one = Stepper(contact, PERIOD)
    assert np.array_equal([one.step(value) for value in history], wanted)


def test_equal_values_count_as_constant():
    contact = case("b_wood_R0")
    assert np.array_equal(
        Stepper(contact, PERIOD).advance(np.full(500, 1e-3)), Stepper(contact, PERIOD).advance(1e-3, 500)
    )


@pytest.mark.parametrize(
    ("values", "steps"), [(-1.0, 3), (np.nan, 3), ([1e-3, np.nan], None), (1e-3, None), ([1e-3], 2)]
)
def test_bad_resistances_are_refused(values, steps):
    with pytest.raises(ValueError, match="resistance|steps"):
        Stepper(case("b_wood_R0"), PERIOD).advance(values, steps)
    with pytest.raises(ValueError, match="period"):
        Stepper(case("b_wood_R0"), 0.0)


@pytest.mark.parametrize("name", ["finger", "object"])
def test_modes_have_the_impedance_of_the_side(name):
    side = case("c_al_R1e-4_sensor37um").side(name)
    modes = side_modes(side, PERIOD)
    shifts = np.geomspace(1e-4, 1e5, 10)
    found = (modes.contact**2 / (shifts[:, None] + modes.rates)).sum(axis=1)
    assert found == pytest.approx(waves(stack_of(side), shifts).impedance, rel=1e-10)
    assert (
        np.abs(modes.shapes.T @ (modes.weights[:, None] * modes.shapes) - np.eye(len(found := modes.rates))).max()
        < 1e-12
    )
    assert modes.row(0.0) == pytest.approx(modes.contact, rel=1e-4, abs=1e-9)
    assert np.all(found >= 0.0)


def test_a_back_port_moves_all_heat():
    plate = Layer(thickness=8e-4, conductivity=27, density=3800, specific_heat=880)
    side = Side(layers=(SENSOR, plate), initial=Initial(kind="uniform", temperature=300.0), back=Back(kind="insulated"))
    modes = side_modes(side, PERIOD, back_port=True)
    assert modes.content @ modes.contact == pytest.approx(1.0, rel=1e-11)
    assert modes.content @ modes.back == pytest.approx(1.0, rel=1e-11)
    assert modes.rates[0] < 1e-12


def test_closed_loops_are_orthonormal_and_conserve():
    contact = case("b_wood_R0")
    pair = pair_of(contact.finger, contact.object, PERIOD)
    for resistance in (0.0, 1e-5, 1e-2):
        loop = close_loop(pair.rates, pair.port, pair.level, resistance, PERIOD)
        kept = loop.vectors[loop.decay > 0.0]
        assert np.abs(kept @ kept.T - np.eye(len(kept))).max() < 1e-13


def test_equal_sides_share_their_rates():
    side = Side(
        layers=(Layer(conductivity=0.3, density=1000, specific_heat=3000),),
        initial=Initial(kind="uniform", temperature=310.0),
    )
    cold = Side(layers=side.layers, initial=Initial(kind="uniform", temperature=290.0))
    flux = Stepper(Contact(side, cold, 0.0), PERIOD).advance(0.0, 1000)
    wanted = solve(Contact(side, cold, 0.0), np.arange(1, 1001) * PERIOD).flux
    assert relative_error(flux, wanted).max() < 1e-7


def test_live_steps_agree_with_the_stepper():
    contact = case("c_al_R1e-4_sensor37um")
    finger = live.side_model(contact.finger, PERIOD, finger=True)
    body = live.side_model(contact.object, PERIOD, finger=False)
    states = [
        live.initial_state(contact.finger, PERIOD, finger=True),
        live.initial_state(contact.object, PERIOD, finger=False),
    ]
    history = changing(1e-3, 60)
    flux = [live.contact_step(finger, states[0], body, states[1], value) for value in history]
    assert flux == pytest.approx(Stepper(contact, PERIOD).advance(history), rel=1e-9)
    live.air_step(finger, states[0])
    live.air_step(body, states[1])
    before = live.surface_temperature(finger, states[0])
    live.shift_surface(finger, states[0], 0.25)
    assert live.surface_temperature(finger, states[0]) == pytest.approx(before + 0.25, abs=1e-12)
    again = live.contact_step(finger, states[0], body, states[1], 1e-3)
    assert 0.0 < again < flux[0]


def test_probes_of_the_stepper():
    contact = case("c_al_R1e-4_sensor37um")
    stepper = Stepper(contact, PERIOD)
    stepper.advance(contact.resistance, 700)
    wanted = solve(contact, [0.7])
    assert stepper.temperature("finger", 5e-4) == pytest.approx(wanted.temperature("finger", 5e-4)[0], abs=1e-5)
    assert stepper.flux_at("object", 1e-2) == pytest.approx(wanted.flux_at("object", 1e-2)[0], rel=1e-3)


def test_batches_agree_with_single_solutions():
    contacts = [case_of(heat_cases.random_case(seed)) for seed in range(100, 106)]
    contacts += [Contact(contacts[0].finger, contacts[0].object, resistance) for resistance in (0.0, 1e-3)]
    times = np.geomspace(1e-3, 50.0, 20)
    batch = solve_many(contacts, times, workers=2)
    for n, contact in enumerate(contacts):
        single = solve(contact, times)
        assert batch.flux[n] == pytest.approx(single.flux, rel=1e-11, abs=1e-10)
        assert batch.skin_temperature[n] == pytest.approx(single.skin_temperature, abs=1e-10)
        assert batch.heat[n] == pytest.approx(single.heat, rel=1e-10)
    with pytest.raises(ValueError, match="workers"):
        solve_many(contacts, times, workers=0)


def test_lock_step_solutions_agree_with_single_ones():
    base = published_cases()["polystyrene, R 2e-3"]
    resistances = np.linspace(0.0, 5e-3, 5)
    together = LockStep([base] * 5, PERIOD, workers=2)
    flux = together.advance(resistances, 400, every=100)
    for n, resistance in enumerate(resistances):
        wanted = solve(Contact(base.finger, base.object, float(resistance)), np.arange(1, 5) * 0.1).flux
        assert relative_error(flux[:, n], wanted).max() < 1e-7
    more = together.advance(np.tile(resistances * 1.1 + 1e-4, (10, 1)))
    single = Stepper(base, PERIOD)
    single.advance(resistances[2], 400)
    assert more[:, 2] == pytest.approx(single.advance(np.full(10, resistances[2] * 1.1 + 1e-4)), rel=1e-9)
    with pytest.raises(ValueError, match="multiple"):
        together.advance(resistances, 401, every=100)
    assert base.finger.back.temperature == 37.0 + CELSIUS
