"""The controllers in closed loop: promises on materials that the bench does not know, and the bound."""

import json

import numpy as np
import pytest
from campaign import seeds

from itouch_thermal import bench_display
from itouch_thermal.display import DisplayParams, Mismatch
from itouch_thermal.flux.start import equation_three
from itouch_thermal.heat import ThermalMaterial
from itouch_thermal.rendering.bound import bound
from itouch_thermal.rendering.closedloop import Case, desired_course, simulate
from itouch_thermal.rendering.materials import made_up
from itouch_thermal.rendering.plantfile import read_plant
from itouch_thermal.rendering.plants import SIGNS, corners
from itouch_thermal.rendering.score import largest, rms, skin_error

DENSE = ThermalMaterial(conductivity=0.6, specific_heat=1100.0, density=1900.0)
FOAM = ThermalMaterial(conductivity=0.035, specific_heat=1400.0, density=90.0)
LIGHT = ThermalMaterial(conductivity=0.055, specific_heat=1900.0, density=125.0)
METAL = ThermalMaterial(conductivity=200.0, specific_heat=900.0, density=2750.0)


def rendered(material, controller="model", plant=None, seconds=3.0, **kwargs):
    case_keys = {"object_temperature", "resistance", "press", "press_off"}
    case = Case(material, seconds=seconds, **{k: kwargs.pop(k) for k in case_keys & kwargs.keys()})
    kwargs.setdefault("seed", 5)
    return simulate(case, desired_course(case), plant or DisplayParams(), controller, **kwargs)


@pytest.mark.parametrize("material", [DENSE, FOAM, LIGHT], ids=["dense", "foam", "light"])
@pytest.mark.parametrize("seed", seeds(1, 3, first=1))
def test_model_follows_on_the_nominal_plant(material, seed):
    run = rendered(material, seconds=10.0, seed=seed)
    assert rms(run) <= 0.3
    assert skin_error(run) <= 0.12
    assert skin_error(run, 0.3) <= 0.02


@pytest.mark.parametrize(
    "corner", [0, pytest.param(5, marks=pytest.mark.long), 10, pytest.param(15, marks=pytest.mark.long)]
)
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


@pytest.mark.parametrize("controller", ["model", "paper", "hold"])
@pytest.mark.parametrize("temperature", [278.15, 318.15])
def test_limits_hold_when_the_object_is_out_of_range(controller, temperature):
    run = rendered(METAL, controller, object_temperature=temperature)
    assert run.plate.min() >= 288.15
    assert run.plate.max() <= 313.15
    assert np.abs(run.current).max() <= 6.4
    assert np.abs(run.pump).max() <= 35e3
    assert np.abs(run.plate[500:] - run.plate[:-500]).max() / 0.5 <= 10.0


def test_model_uses_the_whole_band():
    run = rendered(METAL, object_temperature=278.15)
    assert run.plate[1000:].max() < 288.15 + 0.5


def test_rate_of_the_plate_is_held_back():
    nimble = ThermalMaterial(conductivity=279.0, specific_heat=1000.0, density=21.0)
    run = rendered(nimble, object_temperature=289.15)
    moved = np.abs(run.plate[500:] - run.plate[:-500]) / 0.5
    assert 8.0 < moved.max() <= 10.0


def test_same_seed_same_run():
    first, second = rendered(FOAM, seconds=0.5), rendered(FOAM, seconds=0.5)
    np.testing.assert_array_equal(first.flux, second.flux)


def test_bound_is_tiny_in_range_and_says_what_limits_out_of_it():
    case = Case(DENSE, seconds=10.0)
    assert bound(case, desired_course(case), DisplayParams()).rms_pct < 0.05
    cold = Case(METAL, object_temperature=278.15)
    found = bound(cold, desired_course(cold), DisplayParams())
    assert found.limited == "lowest plate temperature"
    assert 25.0 < found.rms_pct < 40.0
    hot = Case(METAL, object_temperature=318.15)
    assert bound(hot, desired_course(hot), DisplayParams()).limited == "highest plate temperature"


def test_a_plant_with_less_contact_is_limited_sooner():
    case = Case(METAL, object_temperature=289.15)
    course = desired_course(case)
    assert bound(case, course, DisplayParams()).limited is None
    off = Mismatch(contact_resistance=0.1, finger_effusivity=-0.1)
    assert bound(case, course, DisplayParams(), [off]).limited == "lowest plate temperature"


def test_corners_are_balanced_in_pairs():
    signs = np.array(SIGNS)
    assert signs.shape == (16, 8)
    assert (signs.T @ signs == 16 * np.eye(8)).all()


def test_equation_three_of_a_conductor_is_near_the_object():
    plate = equation_three(22249.0, 9502.0, 1167.0, 296.15, 306.15)
    assert plate - 273.15 == pytest.approx(22.33, abs=0.01)


def faults(capsys, *argv):
    assert bench_display.main([*argv, "--seconds", "0.5", "--no-bound"]) == 2
    text = capsys.readouterr().err
    assert text.startswith("error")
    assert "Traceback" not in text
    return text


def test_bench_names_what_is_wrong(capsys, tmp_path):
    assert "'a:-1:900:1000'" in faults(capsys, "--materials", "a:-1:900:1000")
    assert "'louder'" in faults(capsys, "--controller", "louder")
    assert "--object-temperature" in faults(capsys, "--object-temperature", "hot")
    assert "--resistance" in faults(capsys, "--resistance", "-1")
    assert "--rate" in faults(capsys, "--rate", "0 Hz")
    assert "--seeds" in faults(capsys, "--seeds", "0", "--plant", "worst")
    with pytest.raises(SystemExit):
        bench_display.main(["--json", str(tmp_path / "nowhere" / "rows.json")])
    assert "nowhere" in capsys.readouterr().err
    assert "missing.xml" in faults(capsys, "--plant", str(tmp_path / "missing.xml"))
    for text in ("<itouch", "<other/>", '<itouch version="1.0"><devices/></itouch>', PLANT.replace("seebeck", "sebek")):
        file = tmp_path / "plant.xml"
        file.write_text(text, encoding="utf-8")
        assert "plant.xml" in faults(capsys, "--plant", str(file))


PLANT = """<?xml version="1.0" encoding="utf-8"?>
<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal">
  <devices>
    <device name="mine" plugin="thermal">
      <thermal:hardware contact-resistance="0.0022 m^2*K/W" delay="30 ms">
        <thermal:mismatch seebeck="10 %" flux-gain="2 %"/>
      </thermal:hardware>
    </device>
  </devices>
</itouch>
"""


def test_a_plant_from_a_file(tmp_path, capsys):
    file = tmp_path / "plant.xml"
    file.write_text(PLANT, encoding="utf-8")
    plant = read_plant(str(file), 2e-3)
    assert plant.delay == pytest.approx(0.03)
    assert plant.mismatch == Mismatch(contact_resistance=plant.mismatch.contact_resistance, seebeck=0.1, flux_gain=0.02)
    assert plant.mismatch.contact_resistance == pytest.approx(0.1)
    rows = tmp_path / "rows.json"
    assert bench_display.main(["--materials", "wood", "--plant", str(file), "--no-bound", "--json", str(rows)]) == 0
    (row,) = json.loads(rows.read_text())
    assert row["plant"] == str(file)
    assert row["rms_pct"] == pytest.approx(2.0, abs=0.4)


@pytest.mark.long
def test_every_promise_holds_on_materials_that_nobody_knows(capsys, tmp_path):
    file = tmp_path / "table.json"
    argv = ["--table", "--quick", "--materials", "gneiss:2.4:810:2650,felt:0.043:1350:110", "--json", str(file)]
    assert bench_display.main(argv) == 0
    lines = json.loads(file.read_text())
    missed = [(line["case"], line["figure"], line["value"]) for line in lines if line["holds"] is False]
    assert not missed
    cases = {line["case"] for line in lines}
    assert {"dense, worst", "foam, worst", "nominal, noise on", "switch, worst", "skin, nominal", "limits"} <= cases
    assert sum(line["holds"] is True for line in lines) >= 30
    assert "MISSED" not in capsys.readouterr().out


def test_made_up_materials_span_the_range():
    drawn = [what.effusivity for _, what in made_up(200, 3)]
    assert min(drawn) < 40.0
    assert max(drawn) > 12000.0
    assert made_up(3, 3) == made_up(3, 3)


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
