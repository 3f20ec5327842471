"""Blocks of messages: as many are counted as there are, and they come back as they were."""

from __future__ import annotations

import numpy as np
import pytest

from itouch.recording.codec import Codec
from itouch.recording.tracks import Column, Track

TRACK = Track(
    "finger", 1, True,
    (Column("finger.hip", "hip", "f8", 3, "m"), Column("finger.force", "force", "f8", 0, "N"),
     Column("finger.object", "object", "i8", 0, "1")),
)  # fmt: skip


def rows(count: int) -> np.ndarray:
    made = np.zeros(count, TRACK.dtype)
    made["tick"], made["time"] = np.arange(count), 1e-3 * np.arange(count)
    made["hip"] = np.arange(3 * count).reshape(count, 3)
    made["force"], made["object"] = np.arange(count) - 0.5, -np.arange(count)
    return made


@pytest.mark.parametrize("count", [0, 1, 2, 17])
def test_as_many_messages_are_counted_and_read_as_were_written(count: int) -> None:
    codec = Codec(TRACK, 4)
    data = memoryview(codec.encode(rows(count), 7, np.arange(count, dtype=np.uint64)))
    assert codec.count(data) == count
    if count:
        read, sequence = codec.decode(data, count)
        assert read.tobytes() == rows(count).tobytes()
        assert sequence.tolist() == list(range(7, 7 + count))


def test_what_is_cut_off_or_of_another_track_is_not_counted() -> None:
    codec, other = Codec(TRACK, 4), Codec(TRACK, 5)
    data = codec.encode(rows(3), 0, np.zeros(3, np.uint64))
    assert codec.count(memoryview(data[:-1])) == 2
    assert codec.count(memoryview(data + other.encode(rows(2), 0, np.zeros(2, np.uint64)))) == 3
    assert codec.count(memoryview(data[: codec.length - 1])) == 0
