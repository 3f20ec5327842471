"""The controllers in closed loop: promises on materials that the bench does not know, and the bound."""

import json

import numpy as np
import pytest

from itouch_thermal import bench_display
from itouch_thermal.display import DisplayParams, Mismatch
from itouch_thermal.flux.start import equation_three
from itouch_thermal.heat import ThermalMaterial
from itouch_thermal.rendering.bound import bound
from itouch_thermal.rendering.closedloop import Case, desired_course, simulate
from itouch_thermal.rendering.plants import SIGNS, corners
from itouch_thermal.rendering.score import largest, rms, skin_error

DENSE = ThermalMaterial(conductivity=0.6, specific_heat=1100.0, density=1900.0)
FOAM = ThermalMaterial(conductivity=0.035, specific_heat=1400.0, density=90.0)


def rendered(material, controller="model", plant=None, seconds=3.0, **kwargs):
    case_keys = {"object_temperature", "resistance", "press", "press_off"}
    case = Case(material, seconds=seconds, **{k: kwargs.pop(k) for k in case_keys & kwargs.keys()})
    return simulate(case, desired_course(case), plant or DisplayParams(), controller, seed=5, **kwargs)


@pytest.mark.parametrize(("material", "least"), [(DENSE, 0.3), (FOAM, 0.5)])
def test_model_follows_on_the_nominal_plant(material, least):
    run = rendered(material)
    assert rms(run) <= least
    assert skin_error(run) <= 0.15


@pytest.mark.parametrize("corner", [0, 5, 10, 15])
def test_model_follows_in_the_corners(corner):
    plant = DisplayParams(mismatch=corners()[corner])
    dense = rendered(DENSE, plant=plant)
    assert rms(dense) <= 1.0
    assert largest(dense, 0.3) <= 3.0
    foam = rendered(FOAM, plant=plant)
    assert rms(foam) <= 2.0
    assert largest(foam, 0.3) <= 6.0
    assert largest(foam, 1.0) <= 2.5


def test_model_beats_the_published_loop_and_that_beats_holding():
    errors = [rms(rendered(DENSE, controller)) for controller in ("model", "paper", "hold")]
    assert errors[0] < 0.3 * errors[1] < 0.3 * errors[2]


def test_published_loop_oscillates_at_little_resistance_and_the_model_does_not():
    assert rms(rendered(FOAM, "paper", resistance=1e-4)) > 30.0
    assert rms(rendered(FOAM, resistance=1e-4)) <= 1.0


def test_gain_of_the_flux_sensor_shows_one_to_one():
    run = rendered(DENSE, plant=DisplayParams(mismatch=Mismatch(flux_gain=0.01)))
    assert rms(run) == pytest.approx(1.0, abs=0.4)


@pytest.mark.parametrize("off", [0.5, 0.8, 1.25, 2.0])
def test_a_misjudged_press_is_borne(off):
    assert rms(rendered(DENSE, press=0.05, press_off=off)) <= (3.0 if 0.7 < off < 1.5 else 6.0)


def test_fifty_hertz_is_enough():
    assert rms(rendered(DENSE, hold=20)) <= 1.0
    assert rms(rendered(DENSE, hold=20, stream=20)) <= 1.2


def test_plate_stays_in_its_band_when_the_object_is_out_of_range():
    run = rendered(ThermalMaterial(conductivity=200.0, specific_heat=900.0, density=2750.0), object_temperature=280.15)
    assert run.plate.min() > 288.15 - 0.5
    assert run.start >= 288.15


def test_same_seed_same_run():
    first, second = rendered(FOAM, seconds=0.5), rendered(FOAM, seconds=0.5)
    np.testing.assert_array_equal(first.flux, second.flux)


def test_bound_is_tiny_in_range_and_says_what_limits_out_of_it():
    case = Case(DENSE, seconds=10.0)
    assert bound(case, desired_course(case), DisplayParams()).rms_pct < 0.05
    cold = Case(ThermalMaterial(conductivity=200.0, specific_heat=900.0, density=2750.0), object_temperature=278.15)
    found = bound(cold, desired_course(cold), DisplayParams())
    assert found.limited == "lowest plate temperature"


def test_corners_are_balanced_in_pairs():
    signs = np.array(SIGNS)
    assert signs.shape == (16, 8)
    assert (signs.T @ signs == 16 * np.eye(8)).all()


def test_equation_three_of_a_conductor_is_near_the_object():
    plate = equation_three(22249.0, 9502.0, 1167.0, 296.15, 306.15)
    assert plate - 273.15 == pytest.approx(22.33, abs=0.01)


def test_bench_writes_its_rows(tmp_path, capsys):
    file = tmp_path / "rows.json"
    argv = ["--materials", "mystery:0.3:1200:1500", "--seconds", "1", "--json", str(file), "--controller", "hold,model"]
    assert bench_display.main(argv) == 0
    rows = json.loads(file.read_text())
    assert [row["controller"] for row in rows] == ["hold", "model"]
    assert set(rows[0]) == {
        "material", "object_temperature_C", "controller", "plant", "rms_pct", "rms_pct_median",
        "max_after_300ms_pct", "max_after_1s_pct", "rms_W_m2", "skin_error_max_K", "skin_error_max_after_300ms_K",
        "skin_error_max_after_1s_K", "jnd_2afc", "bound_rms_pct", "plate_limited",
    }  # fmt: skip
    assert rows[0]["object_temperature_C"] == 23.0
    assert bench_display.main(["--materials", "unobtainium"]) == 2
    assert "unobtainium" in capsys.readouterr().err
