"""Heat that spreads under a small finger: against a known solution, the twin, and what the pages say of it."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contact_heat.layers import Layer
from itouch.plugin import Field, Record, Touch
from itouch_thermal import bench_spread
from itouch_thermal.display import DisplayParams
from itouch_thermal.display import plant as at
from itouch_thermal.display.device import DisplayTwin
from itouch_thermal.rendering.spread import EVEN, Touched, error, flux, one_dimensional, passed

FINGER = Touched(1.1e-4)


def disc(radius, conductivity, diffusivity, time):
    """Return the mean temperature [K m2/W] of a disc through which a flux enters a half-space from a time on.

    2 a / k * integral of J1(b)^2 erf(b sqrt(alpha t) / a) / b^2 db (Carslaw and Jaeger 1959, 10.5, averaged).
    """
    angles, steps = (np.arange(200) + 0.5) * math.pi / 200, (np.arange(6000) + 0.5) * 0.02
    bessel = np.cos(angles - steps[:, None] * np.sin(angles)).mean(axis=1)
    reach = np.array([math.erf(step * math.sqrt(diffusivity * time) / radius) for step in steps.tolist()])
    return 2.0 * radius / conductivity * float((bessel**2 * reach / steps**2).sum()) * 0.02


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


@pytest.mark.parametrize("area", [1.1e-4, 4e-4])
def test_without_spreading_it_is_the_twin_of_the_display(area):
    twin = DisplayTwin(DisplayParams(contact_area=area))
    state, command = Record.of(twin.fields()), Record.of([Field("current", "f8", 1)])
    twin.reset(state, np.random.default_rng(3))
    twin.step(state, command, Touch(force=0.0, gap=0.1), 1e-3)
    loss, found = state["memory"][at.FINGER_AIR], []
    for _ in range(3000):
        twin.step(state, command, Touch(force=1.0, gap=0.0), 1e-3)
        found.append(state["true_flux"].item())
    times = np.arange(1, 3001) * 1e-3
    own = 10.0 * flux(one_dimensional(Touched(area, air=loss / 10.0)), times)  # skin 33, plate and room 23 degC
    assert own[49:] == pytest.approx(np.array(found[49:]), rel=0.01)


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
    small, whole = rows
    by_time = dict(zip(small["times_s"], small["error"], strict=True))
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
