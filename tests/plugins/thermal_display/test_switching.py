"""How fast the plate goes from one start temperature to another, and the least time that physics leaves."""

from dataclasses import replace

import pytest

from itouch_thermal.display import DisplayParams, Mismatch
from itouch_thermal.display.column import plate_capacity
from itouch_thermal.display.switching import least_time
from itouch_thermal.rendering.plants import corners
from itouch_thermal.rendering.switch_times import CLOSE, least_time_of_plant, switching_time

COLD, WARM = 295.75, 303.65


def test_least_time_is_what_the_heat_takes_and_a_little_more():
    display = DisplayParams()
    capacity = 0.8e-3 * 3800.0 * 880.0 + 37.5e-6 * 8933.0 * 385.0
    heat_alone = capacity * (WARM - COLD - CLOSE) / display.flux_limit
    for begin, end in ((COLD, WARM), (WARM, COLD)):
        assert heat_alone < least_time_of_plant(display, begin, end) < heat_alone + 0.05


def test_least_time_grows_with_the_plate_and_with_a_weak_module():
    plain = least_time_of_plant(DisplayParams(), WARM, COLD)
    heavy = least_time_of_plant(DisplayParams(mismatch=Mismatch(plate_effusivity=0.1)), WARM, COLD)
    assert heavy == pytest.approx(1.1 * plain, rel=0.02)
    weak = least_time_of_plant(DisplayParams(max_current=3.0), WARM, COLD)
    assert weak > 1.3 * plain


@pytest.mark.parametrize(("begin", "end"), [(COLD, WARM), (WARM, COLD)])
@pytest.mark.parametrize("part", [1.0, 0.5])
def test_the_time_that_a_session_tells_is_what_the_heat_takes_and_a_little_more(begin, end, part):
    display = DisplayParams()
    limit = part * display.flux_limit
    heat_alone = plate_capacity(display.plate) * (WARM - COLD - CLOSE) / limit
    told = least_time(display, begin, end, limit=None if part == 1.0 else limit)
    assert heat_alone < told < heat_alone + 0.05
    assert least_time(display, begin, begin + 0.9 * CLOSE) == 0.0
    assert least_time(display, begin, end, limit=1.0) == pytest.approx(heat_alone * limit)  # slow: heat and no more


@pytest.mark.parametrize(("begin", "end"), [(COLD, WARM), (WARM, COLD)])
@pytest.mark.parametrize("corner", [None, 1, 9])
def test_model_switches_nearly_as_fast_as_can_be(begin, end, corner):
    display = DisplayParams() if corner is None else replace(DisplayParams(), mismatch=corners()[corner])
    least = least_time_of_plant(display, begin, end)
    took = switching_time(display, begin, end, seed=2)
    assert least <= took <= (1.1 if corner is None else 1.25) * least + 0.02
