"""The record of State: equal bytes are equal states."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import numpy as np
import pytest

from itouch.loop import Status
from itouch.plugin import Field, Record
from itouch.world.state import EVENT_DTYPE
from itouch.world.supervision import supervision


def test_records_are_equal_if_type_and_bytes_are() -> None:
    fields = (Field("pose", "f8", 7), Field("count", "i8"))
    one, two = Record.of(fields), Record.of(fields)
    assert one == two and (one != two) is False
    two["pose"] = np.arange(7.0)
    assert one != two and (one == two) is False
    assert one != Record.of(fields[:1]) and one != {"pose": 1} and one != dict(one)


def test_not_a_number_equals_itself_in_a_state() -> None:
    one = Record.of((Field("target", "f8"),))
    one["target"] = np.nan
    assert one == one.copy() and (one != one.copy()) is False


@pytest.mark.parametrize(
    "copied",
    [copy.copy, copy.deepcopy, lambda record: pickle.loads(pickle.dumps(record))],
    ids=["copy", "deep", "pickle"],
)
def test_copies_of_a_state_are_independent_records(copied: Callable[[Record], Record]) -> None:
    """Python's own ways to copy raised KeyError: a worker of `itouch.batch` could not hand a State over."""
    one = Record.of((Field("pose", "f8", 7), Field("count", "i8")))
    one["count"] = 3
    two = copied(one)
    assert type(two) is Record and two == one
    two["count"] = 4
    assert one["count"] == 3 and two["count"] == 4


def test_a_record_is_no_key() -> None:
    with pytest.raises(TypeError):
        hash(Record.of((Field("a", "f8"),)))


def test_vectors_of_an_event_have_three_components() -> None:
    event = np.dtype(EVENT_DTYPE)
    shapes = {name: event[name].shape for name in event.names or () if event[name].shape}
    assert shapes == dict.fromkeys(("point", "normal", "tangential_velocity"), (3,))


def test_what_supervision_chooses_from_is_all_that_its_fields_may_hold() -> None:
    """A stored State is checked by these: what is no choice of a supervisor must not come back into one."""
    ranges = {field.name: (field.low, field.high) for field in supervision(())}
    assert ranges["status"] == (min(Status), max(Status))
    assert ranges["touched"] == (0, 1)
    assert ranges["ramp"] == (0.0, 1.0)
    assert [name for name in ("age", "sequence", "clamped", "dropped", "missed") if ranges[name][0] != 0] == []
