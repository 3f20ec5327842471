"""Heat that spreads under a small finger: against a known solution, the twin, and what the pages say of it."""

import json
import math
from dataclasses import replace

import campaign
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contact_heat.layers import Layer
from itouch_thermal import bench_spread
from itouch_thermal.display import DisplayParams
from itouch_thermal.display.sideways import FIELDS, Sideways, bessel, fading, shares
from itouch_thermal.rendering.spread import (
    EVEN,
    Touched,
    error,
    flux,
    flux_of_twin,
    one_dimensional,
    passed,
    resting_loss,
)

FINGER = Touched(1.1e-4)


def disc(radius, conductivity, diffusivity, time):
    """Return the mean temperature [K m2/W] of a disc through which a flux enters a half-space from a time on.

    2 a / k * integral of J1(b)^2 erf(b sqrt(alpha t) / a) / b^2 db (Carslaw and Jaeger 1959, 10.5, averaged).
    """
    angles, steps = (np.arange(200) + 0.5) * math.pi / 200, (np.arange(6000) + 0.5) * 0.02
    bessel = np.cos(angles - steps[:, None] * np.sin(angles)).mean(axis=1)
    reach = np.array([math.erf(step * math.sqrt(diffusivity * time) / radius) for step in steps.tolist()])
    return 2.0 * radius / conductivity * float((bessel**2 * reach / steps**2).sum()) * 0.02


@pytest.mark.long
def test_a_disc_warms_a_half_space_as_is_known():
    """A contact of 1 K m2/W makes the flux the same all the time.

    What the plate does to it is the difference from a plate along which all is even, which is all but cold.
    """
    block = Layer(name="block", thickness=0.04, conductivity=27.0, density=3800.0, specific_heat=880.0)
    display = replace(DisplayParams(), area=0.005, film_coefficient=0.0)
    thick, times = Touched(1e-4, 1.0, display, (block,), air=0.0), np.array([0.5, 2.0])
    off = flux(replace(thick, along_plate=EVEN), times) - flux(thick, times)
    for time, found in zip(times.tolist(), off.tolist(), strict=True):
        mean = disc(math.sqrt(1e-4 / math.pi), 27.0, 27.0 / (3800.0 * 880.0), time)
        even = 2.0 * math.sqrt(time / math.pi) / math.sqrt(27.0 * 3800.0 * 880.0) * 1e-4 / 0.005
        assert found == pytest.approx(mean - even, rel=0.02)
    assert disc(1.0, 1.0, 1.0, 1e6) == pytest.approx(8.0 / (3.0 * math.pi), rel=2e-3)


@pytest.mark.parametrize(
    ("area", "resistance"), campaign.some([(1.1e-4, 5e-4), (0.5e-4, 2e-3), (1.1e-4, 2e-3), (4e-4, 2e-3)], 1)
)
def test_the_twin_of_the_display_spreads_heat_in_the_plate_as_the_rings_do(area, resistance):
    touched = Touched(area, resistance, air=resting_loss(DisplayParams()))
    times = np.array([0.05, 0.1, 0.3, 1.0, 3.0, 10.0])
    rings = flux(replace(touched, along_finger=0.0), times)
    assert flux_of_twin(touched, times) == pytest.approx(rings, rel=5e-3)
    even = flux(one_dimensional(touched), times)
    assert np.abs(even / rings - 1.0).max() > 0.03


def test_a_plate_that_is_covered_whole_is_one_dimension():
    touched = Touched(16e-4, air=resting_loss(DisplayParams()))
    times = np.array([0.05, 0.3, 3.0])
    assert flux_of_twin(touched, times) == pytest.approx(flux(one_dimensional(touched), times), rel=5e-3)


def test_bessel_functions_are_those_of_the_tables():
    """Abramowitz and Stegun 1964, tables 9.1 and 9.5."""
    assert bessel(0, np.array([1.0, 10.0])) == pytest.approx([0.7651976866, -0.2459357645], abs=1e-9)
    assert bessel(1, np.array([1.0, 3.83170597, 7.01558667])) == pytest.approx([0.4400505857, 0.0, 0.0], abs=1e-8)


@given(st.floats(0.0, 1.0))
def test_at_first_the_plate_under_the_finger_is_as_if_covered_whole(cover):
    into, out = shares(np.array([cover]), 3)
    assert into.shape == out.shape == (1, 3 + FIELDS + 1)
    slow = np.r_[0, 3 : 3 + FIELDS + 1]
    assert float((into * out)[0, slow].sum()) == pytest.approx(1.0, abs=5e-3)
    assert np.all(into * out >= 0.0)  # what comes in shows with the same sign: no step can create heat


def test_with_time_heat_in_the_plate_is_the_covered_part():
    params = DisplayParams()
    rates = fading(params.plate, Sideways(params.area, params.conductance / params.area))
    assert np.all(np.diff(rates) > 0.0) and rates[0] == pytest.approx(0.348, abs=2e-3)


@given(st.floats(0.3, 16.0), st.floats(3e-4, 1e-2))
@settings(max_examples=6)
def test_a_plate_that_is_covered_whole_has_nothing_to_spread(centimetres, resistance):
    whole = replace(DisplayParams(), area=centimetres * 1e-4, contact_area=centimetres * 1e-4,
                    sensor_area=centimetres * 1e-4)  # fmt: skip
    touched = replace(Touched(16e-4), contact_area=centimetres * 1e-4, display=whole, resistance=resistance)
    times = np.array([0.05, 0.5, 2.0])
    flat = flux(replace(one_dimensional(touched), along_plate=0.0), times)
    assert flux(replace(touched, along_finger=0.0), times) == pytest.approx(flat, rel=1e-6)
    assert np.all(np.diff(flat) < 0.0)


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """What the bench writes of two areas."""
    path = tmp_path_factory.mktemp("spread") / "rows.json"
    assert bench_spread.main(["--area", "1.1", "--area", "16", "--json", str(path)]) == 0
    return json.loads(path.read_text())


def test_a_fingertip_is_off_by_1_and_3_percent_and_a_covered_plate_by_nothing(rows):
    small, twin, whole, _ = rows
    by_time = dict(zip(small["times_s"], small["error"], strict=True))
    of_twin = dict(zip(twin["times_s"], twin["error"], strict=True))
    assert (small["plate"], twin["plate"]) == ("even", "twin")
    assert abs(of_twin[0.3]) < 0.003 and of_twin[1.0] == pytest.approx(-0.0085, abs=0.003)
    assert of_twin[10.0] == pytest.approx(-0.068, abs=0.005)
    assert twin["since_s"][0] == pytest.approx(1.1, abs=0.2) and twin["since_s"][1] == pytest.approx(3.4, abs=0.5)
    assert by_time[0.1] == pytest.approx(0.020, abs=0.003)
    assert by_time[1.0] == pytest.approx(0.076, abs=0.005)
    assert by_time[3.0] == pytest.approx(0.089, abs=0.006)
    assert small["since_s"][0] < 0.05 and 0.15 < small["since_s"][1] < 0.3 and small["since_s"][2] is None
    assert max(map(abs, whole["error"])) < 1e-6 and whole["since_s"] == [None, None, None]


def test_an_error_is_seen_where_it_begins():
    times = np.array([0.1, 0.2, 0.3])
    assert passed(times, np.array([0.0, -0.02, 0.02]), 0.01) == 0.2
    assert passed(times, np.zeros(3), 0.01) is None
    assert error(FINGER, times).shape == (3,)


@pytest.mark.parametrize(
    ("words", "said"), [(["--area", "17"], "at most the plate's"), (["--resistance", "0"], "above 0")]
)
def test_a_wrong_word_is_one_message(words, said, capsys):
    assert bench_spread.main(words) == 2
    assert said in capsys.readouterr().err
