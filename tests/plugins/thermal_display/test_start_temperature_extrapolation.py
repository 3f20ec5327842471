"""A start temperature for a skin that is far from those for which it was looked for."""

from __future__ import annotations

import pytest

from itouch_thermal.flux import onset

LOW, MIDDLE, HIGH, SKIN = 296.0, 299.0, 301.0, 306.0
start_for = getattr(onset.start_for, "py_func", onset.start_for)


@pytest.mark.parametrize(
    ("skin", "start"), [(304.0, LOW), (305.0, 297.5), (306.0, MIDDLE), (308.0, HIGH), (309.0, 302.0)]
)
@pytest.mark.parametrize("goes_on", [True, False])
def test_between_and_a_little_beyond_them_it_is_linear(skin: float, start: float, goes_on: bool) -> None:
    assert start_for(LOW, MIDDLE, HIGH, SKIN, 296.15, goes_on, skin, 0.0) == pytest.approx(start)
    assert start_for(LOW, MIDDLE, HIGH, SKIN, 296.15, goes_on, skin + 5.0, 5.0) == pytest.approx(start + 5.0)


@pytest.mark.parametrize("temperature", [290.0, 320.0])
def test_far_from_them_it_goes_towards_a_plate_as_warm_as_finger_and_object_where_these_are_equally_warm(
    temperature: float,
) -> None:
    far = SKIN + (onset.FAR if temperature > SKIN else -onset.FAR) * onset.SKIN_STEP
    ends = start_for(LOW, MIDDLE, HIGH, SKIN, temperature, True, far, 0.0)
    assert start_for(LOW, MIDDLE, HIGH, SKIN, temperature, True, temperature, 0.0) == pytest.approx(temperature)
    half = start_for(LOW, MIDDLE, HIGH, SKIN, temperature, True, (far + temperature) / 2.0, 0.0)
    assert half == pytest.approx((ends + temperature) / 2.0)
    assert start_for(LOW, MIDDLE, HIGH, SKIN, temperature, False, temperature, 0.0) == pytest.approx(ends)  # held there
