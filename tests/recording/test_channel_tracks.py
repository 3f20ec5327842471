"""Channels that a scene asks for: a track for each owner and rate, which its name says."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from shipped import SCENES

import itouch
from itouch.session.row_layout import chosen_tracks


@pytest.fixture(scope="module")
def session() -> Iterator[itouch.Session]:
    engine = itouch.build(SCENES / "first_touch.xml")
    yield engine
    engine.close()


def test_a_track_has_the_name_of_its_owner_and_the_rate_at_which_it_is_kept(session: itouch.Session) -> None:
    wishes = [
        (("finger.normal", "tick"), 1000.0),
        (("finger.v*",), 250.0),
        (("finger.velocity", "arm.felt"), 1.0 / 3.0),
    ]
    tracks = chosen_tracks(session.model, session.state, wishes)
    assert [(track.name, track.every) for track in tracks] == [
        ("chosen/finger/1000Hz", 1), ("chosen/session/1000Hz", 1), ("chosen/finger/250Hz", 4),
        ("chosen/finger/0.333333Hz", 3000), ("chosen/arm/0.333333Hz", 3000),
    ]  # fmt: skip
    assert [[column.name for column in track.columns] for track in tracks[:2]] == [["normal"], ["tick_"]]
    assert not any(track.replay for track in tracks)


@pytest.mark.parametrize(
    ("pattern", "rate", "says"),
    [("finger.normal", 400.0, "the rate 400 Hz does not divide the servo rate; the nearest that does is 500 Hz"),
     ("finger.normal", 2000.0, "the nearest that does is 1000 Hz"), ("fngr.*", 250.0, "no channel is named 'fngr.*'"),
     ("events.table", 250.0, "'events.table' cannot be chosen")],
)  # fmt: skip
def test_what_cannot_be_kept_is_told(session: itouch.Session, pattern: str, rate: float, says: str) -> None:
    with pytest.raises(ValueError, match=says.replace("*", "[*]")):
        chosen_tracks(session.model, session.state, [((pattern,), rate)])
