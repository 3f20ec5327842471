"""Lab Streaming Layer: a session's streams are seen by others, and their marks come into the session."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
from requirements import not_here
from shipped import SCENES

import itouch
from itouch.session.lsl import MARKS, Streams


@pytest.fixture
def network() -> None:
    """Leave out where no stream can be found at all: a network without multicast is no fault of ours."""
    import pylsl

    outlet = pylsl.StreamOutlet(pylsl.StreamInfo("probe", "Markers", 1, 0.0, "string", "probe-1"))
    if not pylsl.resolve_byprop("name", "probe", 1, 8.0):
        not_here("this network has no multicast: no stream can be found on it")
    del outlet


def test_marks_go_out_and_come_in(network: None) -> None:
    import pylsl

    session = itouch.build(SCENES / "first_touch.xml")
    session.clock = itouch.WallClock()
    theirs = pylsl.StreamOutlet(pylsl.StreamInfo("eeg triggers", "Markers", 1, 0.0, "string", "amp-1"))
    with Streams(session):
        deadline, inlet, arm, marks, samples = time.monotonic() + 300.0, None, None, [], []
        while time.monotonic() < deadline and not (marks and samples and session.marks[-1:] != []
                                                   and session.marks[-1]["name"] == "eeg triggers"):  # fmt: skip
            session.run(0.05)
            if inlet is None:
                found = {s.name(): s for s in pylsl.resolve_streams(0.3)}
                if MARKS in found and "itouch arm" in found:
                    inlet = pylsl.StreamInlet(found[MARKS])
                    arm = pylsl.StreamInlet(found["itouch arm"])
                    inlet.open_stream(2.0)
                    arm.open_stream(2.0)
            else:
                session.mark("trial", {"n": 1})
                theirs.push_sample(["stimulus 7"])
                session.run(0.1)
                marks += inlet.pull_chunk(timeout=0.2)[0]
                samples += arm.pull_chunk(timeout=0.2)[0]
    assert {"name": "trial", "payload": {"n": 1}} in [json.loads(row[0]) for row in marks]
    assert len(samples[0]) == sum(max(1, c.size) for c in _columns(session))
    taken = [mark for mark in session.marks if mark["name"] == "eeg triggers"]
    assert taken[0]["payload"]["value"] == "stimulus 7"
    for mark in taken:  # on one machine the clocks are the same one, and what happened did so before it was taken
        assert abs(mark["payload"]["correction_s"]) < 0.1
        assert 0 <= mark["payload"]["tick"] <= mark["tick"]


def test_a_mark_says_the_tick_at_which_it_happened() -> None:
    """A mark of another machine, whose clock is 100 s ahead, arrives 40 ms late."""

    class Clock:
        def local_clock(self) -> float:
            return 12.500

    class Inlet:
        left = [(["go"], 112.460)]

        def pull_sample(self, timeout: float) -> object:
            return self.left.pop() if self.left else (None, None)

        def time_correction(self, timeout: float) -> float:
            return -100.0

    session = itouch.build(SCENES / "first_touch.xml")
    session.run(0.1)
    streams = Streams.__new__(Streams)
    streams._session, streams._lsl = session, Clock()
    streams._take("trigger", Inlet())
    session.run(0.01)
    (mark,) = session.marks
    period = session.model.period
    happened = mark["tick"] - mark["payload"]["tick"]
    assert mark["name"] == "trigger" and mark["payload"]["correction_s"] == -100.0
    assert happened == pytest.approx(0.040 / period, abs=1.5)


def test_a_mark_whose_correction_is_not_found_is_not_lost() -> None:
    class Inlet:
        left = [(["go"], 112.460), (["stop"], 113.0)]
        asked: list[float] = []

        def pull_sample(self, timeout: float) -> object:
            return self.left.pop() if self.left else (None, None)

        def time_correction(self, timeout: float) -> float:
            self.asked.append(timeout)
            raise TimeoutError("the stream has gone")

    session = itouch.build(SCENES / "first_touch.xml")
    session.run(0.01)
    streams = Streams.__new__(Streams)
    streams._session = session
    streams._take("trigger", Inlet())
    session.run(0.01)
    assert [mark["name"] for mark in session.marks] == ["trigger", "trigger"]
    assert [mark["payload"] for mark in session.marks] == [
        {"value": "stop", "lsl_time": 113.0}, {"value": "go", "lsl_time": 112.460}
    ]  # fmt: skip
    assert max(Inlet.asked) < 0.01  # other streams' marks wait meanwhile


def _columns(session: itouch.Session) -> list[object]:
    from itouch.session.row_layout import replay_tracks

    return list(next(t for t in replay_tracks(session.model, session.state) if t.name == "arm").columns)


def test_without_pylsl_the_extra_to_install_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pylsl", None)
    with pytest.raises(itouch.SessionError, match=r"pip install 'itouch-py\[lsl\]'"):
        Streams(itouch.build(SCENES / "first_touch.xml"))


def test_samples_go_out_at_the_rate_of_their_stream() -> None:
    class Outlet:
        sent: list[list[float]] = []

        def push_sample(self, sample: object) -> None:
            self.sent.append(list(sample))  # type: ignore[call-overload]

    session = itouch.build(SCENES / "first_touch.xml")
    streams = Streams.__new__(Streams)
    streams._session, streams._told, streams._every = session, 0, 4
    value = np.zeros(2)
    streams._outlets = [(Outlet(), [value, np.array(7)])]
    for tick in range(10):
        value[:] = tick, -tick
        streams._tap(tick)
    assert Outlet.sent == [[0.0, 0.0, 7.0], [4.0, -4.0, 7.0], [8.0, -8.0, 7.0]]
