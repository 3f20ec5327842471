"""What a channel declares must be numbers that can limit something: told when the plugin is loaded, not in a run."""

from __future__ import annotations

import math
from typing import Any

import pytest

from itouch.plugin import Channel, current, wrench


@pytest.mark.parametrize(
    ("declared", "why"),
    [
        ({"low": (math.nan,), "high": (1.0,)}, "low = (nan,) must consist of numbers"),
        ({"low": (0.0,), "high": (math.nan,)}, "high = (nan,) must consist of numbers"),
        ({"low": ("0 A",), "high": (1.0,)}, "low = ('0 A',) must consist of numbers"),
        ({"low": (2.0,), "high": (1.0,)}, "low = (2.0,) is above high = (1.0,)"),
        ({"slew": (math.nan,)}, "slew = (nan,) must consist of numbers"),
        ({"slew": (-1.0,)}, "slew = (-1.0,) is the size of a change, never below 0"),
        ({"safe": (math.nan,)}, "safe = (nan,) must consist of numbers"),
        ({"magnitude": math.nan}, "magnitude = nan must be a length, 0 or more"),
        ({"magnitude": -1.0}, "magnitude = -1.0 must be a length, 0 or more"),
        ({"locked": (6,)}, "locked = (6,) has numbers that are none of 0..5"),
        ({"locked": (-1,)}, "locked = (-1,) has numbers that are none of 0..5"),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_what_can_limit_nothing_is_refused(declared: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError) as caught:
        Channel("drive", 1, "A", **declared)
    assert str(caught.value) == f"channel 'drive': {why}"


def test_no_limit_at_all_can_be_declared() -> None:
    channel = Channel("drive", 1, "A", high=(math.inf,), slew=(math.inf,))
    assert channel.low == (-math.inf,)


def test_a_ceiling_of_nan_is_none() -> None:
    with pytest.raises(ValueError, match="force = nan must be more than 0 N"):
        wrench(force=math.nan)
    with pytest.raises(ValueError, match="limit = nan must be more than 0 A"):
        current(limit=math.nan)
