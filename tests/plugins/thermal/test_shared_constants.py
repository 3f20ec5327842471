"""Numbers that the plugin shares with rooms that no plugin imports are the same there."""

from __future__ import annotations

from itouch.monitors.default_limits import PLATE_RATE, PLATE_TEMPERATURE
from itouch.monitors.thresholds import CONTACT_RATE_TIME
from itouch_thermal.flux import limits
from itouch_thermal.rendering import score
from itouch_tools.study import observers


def test_controllers_keep_to_the_limits_that_safety_has_by_default() -> None:
    assert limits.BAND == PLATE_TEMPERATURE
    assert (limits.RATE, limits.RATE_OVER) == (PLATE_RATE, CONTACT_RATE_TIME)


def test_what_is_noticed_is_the_same_for_simulated_observers_and_for_the_score() -> None:
    assert score.WEBER == observers.WEBER
