"""The display's twin: energy, agreement with the solver, sensors, restore."""

import numpy as np
import pytest

from contact_heat.contact import Contact
from contact_heat.layers import Back, Initial, Side
from contact_heat.stepper import Stepper
from itouch.plugin import Field, Record, TwinInputs
from itouch_thermal.display import DisplayParams, Mismatch
from itouch_thermal.display import plant as at
from itouch_thermal.display.column import plate_capacity, ramp_weights, tissue_side
from itouch_thermal.display.display_twin import DisplayTwin
from itouch_thermal.display.peltier import Module, current_for, pumped_heat
from itouch_thermal.flux.condensation import dew_point
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.flux.observer import M_PART
from itouch_thermal.heat import FINGER
from itouch_thermal.laws import PressureLaw

PERIOD = 1e-3


def twin_of(**params):
    twin = DisplayTwin(DisplayParams(**params))
    state = Record.of(twin.fields())
    twin.reset(state, np.random.default_rng(3))
    return twin, state, Record.of([Field("current", "f8", 1)])


def test_contact_flux_is_that_of_the_solver_on_the_same_layers():
    twin, state, command = twin_of(film_coefficient=0.0, conductance=1e-3, contact_area=16e-4, area_exponent=0.0)
    params = twin.params
    body = Side(layers=params.plate, initial=Initial(kind="uniform", temperature=296.15), back=Back(kind="insulated"))
    exact = Stepper(Contact(finger=tissue_side(FINGER, 310.15, 306.15), object=body), PERIOD).advance(2e-3, 500)
    found = []
    for _ in range(500):
        twin.step(state, command, TwinInputs(force=1.0, gap=0.0), PERIOD)
        found.append(state["true_flux"].item())
    np.testing.assert_allclose(found, exact, rtol=2e-4)


def test_energy_closes_over_currents_touches_and_air():
    twin, state, command = twin_of(mismatch=Mismatch(seebeck=0.1, plate_effusivity=-0.1))
    params, memory = twin.params, state["memory"]
    capacity = plate_capacity(params.plate) * 0.9 * params.area
    begin = capacity * memory[at.MEAN] + params.sink_capacity * memory[at.SINK]
    rng = np.random.default_rng(0)
    for i in range(4000):
        if i % 200 == 0:
            command["current"] = rng.uniform(-5, 5)
        twin.step(state, command, TwinInputs(force=float(i % 1500 > 700), gap=0.0), PERIOD)
    end = capacity * memory[at.MEAN] + params.sink_capacity * memory[at.SINK]
    came = memory[at.ENERGY_ELECTRIC] + memory[at.ENERGY_FINGER] + memory[at.ENERGY_AIR] - memory[at.ENERGY_ROOM]
    assert abs(came) > 1.0
    assert end - begin == pytest.approx(came, rel=1e-9)


def skin_after(period, steps, worn):
    twin = DisplayTwin(DisplayParams())
    state, command, touch = Record.of(twin.fields()), Record.of([Field("current", "f8", 1)]), TwinInputs()
    twin.reset(state, np.random.default_rng(3))
    touch.total_heat_flux[0] = worn
    for _ in range(steps):
        twin.step(state, command, touch, period)
    return state["true_skin"].item()


@pytest.mark.parametrize(("period", "steps"), [(1e-3, 1), (1e-3, 10), (1e-2, 1)])
def test_worn_heat_cools_the_skin_from_the_first_step(period, steps):
    """A step of flux into a half-space: 2 q sqrt(t / pi) / e (Carslaw and Jaeger 1959, 2.9); 0.0306 K after 1 ms."""
    layer, flux = FINGER[0], 1000.0
    effusivity = np.sqrt(layer.conductivity * layer.density * layer.specific_heat)
    fall = skin_after(period, steps, 0.0) - skin_after(period, steps, flux)
    assert fall == pytest.approx(2.0 * flux * np.sqrt(period * steps / np.pi) / effusivity, rel=3e-3)


def test_heat_beside_the_sensor_enters_the_plate_unseen():
    twin, state, command = twin_of(contact_area=4e-4, sensor_area=8e-4, flux_noise=0.0, film_coefficient=0.0)
    heat = 0.0
    for _ in range(2000):
        twin.step(state, command, TwinInputs(force=1.0, gap=0.0), PERIOD)
        heat += PERIOD * state["true_flux"].item()
    flux, memory = state["true_flux"].item(), state["memory"]
    assert memory[at.READ_FLUX] == pytest.approx(0.5 * flux, rel=0.03)
    assert memory[at.ENERGY_FINGER] == pytest.approx(4e-4 * heat, rel=1e-3)


@pytest.mark.parametrize(("force", "seen"), [(0.02, 2.2 * 0.02 ** (1 / 3)), (0.05, 2.2 * 0.05 ** (1 / 3)), (2.0, 1.0)])
def test_a_light_finger_covers_a_part_of_the_sensor_and_the_controller_knows_which(force, seen):
    twin, state, command = twin_of(flux_noise=0.0, film_coefficient=0.0, flux_resolution=0.0)
    for _ in range(1500):
        twin.step(state, command, TwinInputs(force=force, gap=0.0), PERIOD)
    assert state["memory"][at.READ_FLUX] == pytest.approx(seen * state["true_flux"].item(), rel=0.03)
    assert twin.params.seen(force) == pytest.approx(seen, rel=1e-9)
    law = ModelLaw(twin.params, FINGER, 310.15, 306.15, 2e-3, 296.15, PERIOD, band=(288.15, 313.15), ceiling=6.4)
    memory = Record.of(law.fields())
    law.reset(memory)
    law.feel(memory, force)
    assert memory["memory"][M_PART] == pytest.approx(seen, rel=1e-9)


def test_a_law_of_the_force_brings_its_own_area():
    given = PressureLaw(contact_area=0.8e-4, area_exponent=0.25)
    params = DisplayParams(laws=(given,))
    assert params.pad == (0.8e-4, 0.25)
    assert params.cover == pytest.approx(0.05)
    with pytest.raises(ValueError, match="say the same thing"):
        DisplayParams(laws=(given,), contact_area=2e-4)


def test_a_small_plate_is_covered_whole_by_default():
    params = DisplayParams(area=0.4e-4)
    assert (params.contact_area, params.sensor_area, params.cover) == (0.4e-4, 0.4e-4, 1.0)


def test_command_is_delayed_saturated_and_counted():
    twin, state, command = twin_of(max_current=2.0, current_bits=8)
    command["current"] = 7.0
    for i in range(25):
        twin.step(state, command, TwinInputs(), PERIOD)
        assert (state["memory"][at.CURRENT] != 0.0) == (i >= 20)
    assert state["memory"][at.CURRENT] == pytest.approx(2.0, abs=4.0 / 256)


@pytest.mark.parametrize("differs", [-0.02, -5e-3, 4e-3])
def test_a_command_takes_as_much_longer_as_the_delay_differs(differs):
    twin, state, command = twin_of(delay=0.02, mismatch=Mismatch(delay=differs))
    command["current"] = 1.0
    for i in range(30):
        twin.step(state, command, TwinInputs(), PERIOD)
        assert (state["memory"][at.CURRENT] != 0.0) == (i >= round((0.02 + differs) / PERIOD))


def test_the_driver_gives_whole_steps_of_its_range():
    twin, state, command = twin_of(max_current=2.0, current_bits=8)
    for wanted, given in ((0.0125, 1), (0.02, 1), (-0.3, -19)):
        command["current"] = wanted
        for _ in range(25):
            twin.step(state, command, TwinInputs(), PERIOD)
        assert state["memory"][at.CURRENT] == pytest.approx(given * 4.0 / 256, abs=1e-12)


@pytest.mark.parametrize("decay", [0.0, 1e-6, 5e-4, 9.9e-4, 1.1e-3, 0.1, 3.0])
def test_a_flux_that_changes_evenly_leaves_what_its_integral_says(decay):
    period, (points, weights) = 0.02, np.polynomial.legendre.leggauss(20)
    when = 0.5 * (points + 1.0)
    left = 0.5 * period * weights * np.exp(-decay * (1.0 - when))  # of a flux at a part of the step, at its end
    begin, end = ramp_weights(np.array([decay / period]), period)
    assert begin[0] == pytest.approx(float(left @ (1.0 - when)), rel=1e-9)
    assert end[0] == pytest.approx(float(left @ when), rel=1e-9)


def test_infrared_holds_its_last_value_under_the_finger():
    twin, state, command = twin_of()
    twin.step(state, command, TwinInputs(gap=0.01), PERIOD)
    seen = state["memory"][at.READ_SKIN]
    for _ in range(50):
        twin.step(state, command, TwinInputs(force=1.0, gap=0.0), PERIOD)
    assert state["memory"][at.READ_VALID] == 0.0
    assert state["memory"][at.READ_SKIN] == seen
    assert state["true_skin"].item() < 306.0


def test_a_copied_state_goes_on_bit_for_bit():
    twin, state, command = twin_of()
    command["current"] = 1.5
    for _ in range(100):
        twin.step(state, command, TwinInputs(force=1.0, gap=0.0), PERIOD)
    other, copy = DisplayTwin(twin.params), state.copy()
    for _ in range(100):
        twin.step(state, command, TwinInputs(), PERIOD)
        other.step(copy, command, TwinInputs(), PERIOD)
    assert state == copy


def test_press_raises_the_resistance():
    twin, state, command = twin_of(full_force=1.0)
    twin.step(state, command, TwinInputs(force=0.25, gap=0.0), PERIOD)
    light = state["true_flux"].item()
    other, fresh, _ = twin_of(full_force=1.0)
    other.step(fresh, command, TwinInputs(force=2.0, gap=0.0), PERIOD)
    assert fresh["true_flux"].item() == pytest.approx(4.0 * light, rel=0.05)


def test_datasheet_gives_back_its_own_figures():
    module = Module.from_datasheet(voltage=15.4, current=6.4, difference=68.0, hot=300.0)
    assert module.seebeck == pytest.approx(15.4 / 300)
    cold = 300.0 - 68.0
    most = module.seebeck * cold / module.resistance
    assert most == pytest.approx(6.4, rel=1e-9)
    assert pumped_heat(module.seebeck, module.resistance, module.conductance, most, cold, 300.0) == pytest.approx(
        0.0, abs=1e-9
    )
    with pytest.raises(ValueError, match="difference"):
        Module.from_datasheet(voltage=15.4, current=6.4, difference=310.0, hot=300.0)


@pytest.mark.parametrize("heat", [-40.0, -1.0, 0.0, 5.0, 35.0])
def test_current_for_a_heat_pumps_it(heat):
    current = current_for(0.051, 1.86, 0.56, heat, 297.0, 305.0)
    assert pumped_heat(0.051, 1.86, 0.56, current, 297.0, 305.0) == pytest.approx(heat, abs=1e-9)


def test_dew_point_of_known_air():
    assert dew_point(298.15, 0.5) - 273.15 == pytest.approx(13.9, abs=0.1)
    assert dew_point(293.15, 1.0) == pytest.approx(293.15)
    with pytest.raises(ValueError, match="humidity"):
        dew_point(293.15, 1.2)


def test_areas_must_fit_the_plate():
    with pytest.raises(ValueError, match="contact_area"):
        DisplayParams(contact_area=20e-4)
