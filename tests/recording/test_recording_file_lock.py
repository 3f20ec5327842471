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


def test_a_snapshot_does_not_take_the_place_of_the_recording(tmp_path: Path) -> None:
    path, link = tmp_path / "one.mcap", tmp_path / "link.itouch"
    with itouch.build(SCENES / "first_touch.xml") as session:
        session.save(path)  # no recording yet: it may go anywhere
        session.record(path)
        session.run(0.2)
        link.symlink_to(path)
        for place in (path, str(path), link, tmp_path / "." / "one.mcap"):
            with pytest.raises(itouch.SessionError, match="the session is being recorded to it"):
                session.save(place)
            with pytest.raises(itouch.SessionError, match="the session is being recorded to it"):
                session.saving(place, 0.1)
        session.run(0.2)
    assert len(itouch.read(path).ticks) == 400
