"""A file that is being recorded to is not taken by a second session."""

from __future__ import annotations

from pathlib import Path

import pytest
from shipped import SCENES

import itouch


def test_a_file_has_one_writer(tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    with itouch.build(SCENES / "first_touch.xml") as first, itouch.build(SCENES / "first_touch.xml") as second:
        first.record(path)
        first.run(0.2)
        with pytest.raises(itouch.RecordingError, match=r"two\.mcap': another session is recording to it"):
            second.record(path)
        first.run(0.2)
    assert len(itouch.read(path).ticks) == 400
    with itouch.build(SCENES / "first_touch.xml") as third:  # what is finished may be replaced
        third.record(path)
        third.run(0.1)
    assert len(itouch.read(path).ticks) == 100
