"""Another phase of a device's exchange changes no figure by more than its interval: what is counted is time."""

from __future__ import annotations

import math

from hypothesis import example, given, settings
from hypothesis import strategies as st
from small_devices import PLATE, TABLE, Asked

from itouch.monitors import Heat, Surface, TripError

K0 = 273.15
#: An exchange of a device [s], and two phases of it.
INTERVAL = st.sampled_from([0.007, 0.01, 0.02, 0.023])
PHASES = st.tuples(st.floats(0.0, 0.99), st.floats(0.0, 0.99))
#: Rounding of sums of periods [s].
ROUND = 1e-6


def _heated(start: float, slope: float, interval: float, phase: float, seconds: float) -> tuple[Asked, float]:
    """Let a touched plate go from a temperature [degC] at a slope [K/s]; return the monitor, and when it tripped [s]."""
    asked, passed, index = Asked(Heat, PLATE), phase * interval, 0
    asked.moment.touched = True
    asked.reading["sink_temperature"] = K0 + 25.0
    while passed < seconds:
        asked.reading["plate_temperature"] = K0 + start + slope * passed + 1e-5 * (index % 3)
        try:
            asked.check(interval if index else ROUND)
        except TripError:
            return asked, passed
        passed, index = passed + interval, index + 1
    return asked, math.inf


@settings(max_examples=15, deadline=None)
@given(st.floats(30.0, 38.0), st.floats(0.5, 1.9), INTERVAL, PHASES)
def test_a_plate_that_warms_trips_at_the_same_time(
    start: float, slope: float, interval: float, phases: tuple[float, float]
) -> None:
    first, second = (_heated(start, slope, interval, phase, 30.0)[1] for phase in phases)
    assert math.isfinite(first)
    assert abs(first - second) <= interval + ROUND


@settings(max_examples=15, deadline=None)
@given(st.sampled_from([13.0, 41.0]), INTERVAL, PHASES)
def test_budgets_of_heat_and_cold_are_those_of_the_time_that_passed(
    plate: float, interval: float, phases: tuple[float, float]
) -> None:
    used = []
    for phase in phases:
        asked, _ = _heated(plate, 0.0, interval, phase, 1.0)
        used.append((asked.state["dose"].item(), asked.state["cold_time"].item()))
    (dose, cold), (other_dose, other_cold) = used
    assert max(dose, cold) > 0.0
    assert abs(cold - other_cold) <= interval + ROUND
    assert abs(dose - other_dose) <= (interval + ROUND) * dose / (1.0 - 2 * interval)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.2, 70.0), INTERVAL, PHASES)
@example(4.8809550374548785, 0.007, (0.02144803580234499, 0.8883327007824331))
def test_the_time_of_a_contact_is_that_of_the_finger(
    lasts: float, interval: float, phases: tuple[float, float]
) -> None:
    found = []
    for phase in phases:
        asked, now = Asked(Surface, TABLE), phase * interval
        assert isinstance(asked.monitor, Surface)
        code = 1.0
        while now < 0.1 + lasts and code > 0.0:
            now = round(now + interval, 9)
            code = asked.monitor.count(asked.state, now, 0.1 <= now < 0.1 + lasts)
        found.append((asked.state["contact_time"].item(), now if code < 0.0 else math.inf))
    (touched, tripped), (also_touched, also_tripped) = found
    look = interval * math.ceil((0.01 - 1e-7) / interval)  # it turns at the first exchange 10 ms after the last turn
    turn = max(interval, 2 * look)  # one more at the begin, one less at the end
    assert abs(touched - also_touched) <= turn + ROUND
    assert (tripped == also_tripped) or min(tripped, also_tripped) > 59.0
    assert not (math.isfinite(tripped) and math.isfinite(also_tripped)) or abs(tripped - also_tripped) <= turn + ROUND
