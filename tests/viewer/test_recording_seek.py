"""A recording that is wound: the State of any tick, in whatever order they are asked for; its curves and time line."""

from __future__ import annotations

import contextlib
import random
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.recording import RecordingError
from itouch_tools.viewer.played_session import FASTEST, Playback
from itouch_tools.viewer.recording_seek import SeekableRecording
from itouch_tools.viewer.signals import Ring
from itouch_tools.viewer.timeline import Timeline

SECONDS = 3.2


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """A recording, the State after every tick, and the curves of the session as it ran."""
    path = tmp_path_factory.mktemp("reel") / "r.mcap"
    session = itouch.build(SCENES / "first_touch.xml", seed=4)
    session.record(path)
    states, ring = [], Ring(session.model)

    def note(tick: int) -> None:
        states.append(session.state.tobytes())
        ring.add(session.state)

    session.taps.append(note)
    session.run(1.0)
    session.mark("trial", {"number": 1})
    session.run(SECONDS - 1.0)
    session.close()
    return path, states, ring


def bring(reel: SeekableRecording, row: int) -> bytes:
    reel.row = row
    while not reel.work(0.02):
        pass
    return reel.state.tobytes()


def test_any_tick_is_shown_as_it_was(ran):
    path, states, _ = ran
    reel = SeekableRecording(itouch.read(path))
    assert len(reel.ticks) == len(states) == round(SECONDS * 1000)
    generator = random.Random(7)
    for row in [0, len(states) - 1, 1, *(generator.randrange(len(states)) for _ in range(25))]:
        assert bring(reel, row) == states[row], row
    for row in range(1500, 1520):
        assert bring(reel, row) == states[row]
    for row in range(1519, 1499, -1):
        assert bring(reel, row) == states[row]


def test_all_is_read_in_the_end_and_the_curves_are_those_of_the_session(ran):
    path, states, ring = ran
    reel = SeekableRecording(itouch.read(path))
    assert not reel.known(50).any()
    reel.row = 2000
    while not reel.known(len(states)).all():
        assert reel.work(0.05) or reel.shown != reel.row
    bring(reel, len(states) - 1)
    for chart, other in zip(reel.curves.charts, ring.charts, strict=True):
        times, values = reel.curves.curves(chart)
        theirs, expected = ring.curves(other)
        assert np.isfinite(values).any() and len(times) == round(SECONDS * 100)
        # the ring notes ticks 1, 11, 21 ..., which are rows 0, 10, 20 ...
        np.testing.assert_allclose(times, theirs - reel.model.period, atol=1e-9)
        np.testing.assert_allclose(values, expected, rtol=1e-6, atol=1e-6)


def test_work_returns_when_its_time_is_over(ran):
    path, states, _ = ran
    reel = SeekableRecording(itouch.read(path))
    reel.row = len(states) - 1
    assert not reel.work(0.0)
    assert reel.known(100).mean() < 0.5
    bring(reel, len(states) - 1)


def test_the_time_line_tells_contacts_and_marks(ran):
    path, _, _ = ran
    line = Playback(SeekableRecording(itouch.read(path))).line
    contacts = [e for e in itouch.read(path).events if e["kind"] in ("BEGIN", "END")]
    assert [(begin, name) for begin, _, name in line.spans] == [
        (e["time"], e["object"]) for e in contacts if e["kind"] == "BEGIN"
    ]
    assert line.spans and all(begin < end <= line.last for begin, end, _ in line.spans)
    assert line.marks == ((1.0, "trial"),)
    assert line.first == 0.0 and line.last == pytest.approx(SECONDS - 0.001)
    assert {line.first, 1.0, line.spans[0][0], line.last} <= set(line.stops)


def test_playing_pausing_speeds_steps_and_jumps(ran):
    path, states, _ = ran
    playback = Playback(SeekableRecording(itouch.read(path)))
    line = playback.line

    def turn(seconds: float) -> None:
        playback.advance(seconds, playback.curves)
        while line.reading:
            playback.advance(0.0, playback.curves)

    assert line.playing and line.speed == 1.0
    for _ in range(10):
        turn(0.05)
    assert line.now == pytest.approx(0.5, abs=0.002)
    assert int(playback.state["tick"]) == round(line.now * 1000) + 1
    playback.pause()
    turn(0.2)
    assert line.now == pytest.approx(0.5, abs=0.002)
    playback.step(1)
    turn(0.0)
    assert playback.state.tobytes() == states[round(line.now * 1000)]
    now = line.now
    playback.step(-100)
    turn(0.0)
    assert line.now == pytest.approx(now - 0.1)
    playback.jump(1)
    turn(0.0)
    assert line.now == pytest.approx(min(stop for stop in line.stops if stop > now - 0.1))
    before = line.now
    playback.jump(1)
    turn(0.0)
    playback.jump(-1)
    turn(0.0)
    assert line.now == pytest.approx(before)
    playback.seek(1.0)
    playback.faster(2.0)
    playback.pause()
    turn(0.1)
    assert line.now == pytest.approx(1.2, abs=0.002)
    for _ in range(20):
        playback.faster(2.0)
    assert line.speed == FASTEST
    playback.seek(99.0)
    turn(0.1)
    assert line.now == line.last and not line.playing
    playback.pause()
    turn(0.01)
    assert line.playing and line.now < 0.5
    playback.seek(-5.0)
    turn(0.0)
    assert line.now == line.first


def test_a_recorded_fault_is_told_while_it_lasts(tmp_path: Path, scenes: Path):
    path = scenes / "four_materials.xml"
    fault = '<fault device="table" kind="disconnect" at="400 ms" for="200 ms"/></itouch>'
    path.write_text(path.read_text(encoding="utf-8").replace("</itouch>", fault), encoding="utf-8")
    session = itouch.build(path)
    session.record(tmp_path / "r.mcap")
    states = {}
    session.taps.append(lambda tick: states.__setitem__(tick, session.state.tobytes()))
    with contextlib.suppress(itouch.DeviceFaultError):
        session.run(1.0)
    failed = session.ticks
    session.rearm()
    session.run(0.3)
    session.close()
    reel = SeekableRecording(itouch.read(tmp_path / "r.mcap"))
    playback = Playback(reel)
    playback.pause()
    for tick in (failed + 100, failed - 20, 399, failed - 1, 405):
        playback.seek(tick * 0.001)
        playback.advance(0.0, playback.curves)
        while playback.line.reading:
            playback.advance(0.0, playback.curves)
        assert playback.state.tobytes() == states[tick], tick
        told = [fault["device"] for fault in playback.status.faults]
        assert told == (["table"] if 400 <= tick < failed else []), tick
    assert playback.line.faults == ((pytest.approx(0.4), "device-error"),)


def test_a_gap_does_not_stop_it(ran):
    path, states, _ = ran
    recording = itouch.read(path)
    for name in recording:
        table = recording[name]
        recording._content.rows[name] = table[(table["tick"] < 700) | (table["tick"] >= 900)]
    reel = SeekableRecording(recording)
    assert len(reel.ticks) == len(states) - 200
    assert bring(reel, 650) == states[650]
    bring(reel, 800)
    while not reel.known(len(reel.ticks)).all():
        reel.work(0.05)


def test_a_recording_without_a_tick_is_refused(ran):
    recording = itouch.read(ran[0])
    for name in recording:
        recording._content.rows[name] = recording[name][:0]
    with pytest.raises(RecordingError, match="no tick"):
        SeekableRecording(recording)


def test_a_recording_is_not_asked_for_what_only_sessions_do(ran):
    playback = Playback(SeekableRecording(itouch.read(ran[0])))
    for said in (playback.save(), playback.rearm(), playback.steer(None), playback.steer((0.1, 0.0, 0.0))):
        assert "recording" in said
    playback.hold(True)
    assert not playback.line.playing
    playback.stop()


def test_words_of_the_time_line():
    line = Timeline(1.0, 3.0, now=2.0)
    assert line.share(2.0) == 0.5 and line.share(-1.0) == 0.0 and line.share(9.0) == 1.0
    assert line.words().split() == ["playing", "1", "x", "2.000", "of", "3.000", "s"]
    line.playing, line.speed = False, 0.25
    assert line.words().split()[:3] == ["paused", "1/4", "x"]
    line.reading = True
    assert line.words().startswith("reading")
