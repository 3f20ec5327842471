"""Histograms of the loop's timing: from the loop through recordings and snapshots, whatever a file says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped import SCENES

import itouch
from itouch.loop.timing import BINS, bins, edges, merged
from itouch.recording import read
from itouch.recording.recording import histograms_us

JUNK = st.recursive(
    st.none() | st.booleans() | st.just(10**400) | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=12,
)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("timing")
    running = itouch.build(SCENES / "first_touch.xml")
    running.record(folder / "run.mcap")
    running.run(2.5)
    running.close()
    running.save(folder / "end.itouch")
    return running, folder


def total(histogram: list[list[float]]) -> int:
    return sum(int(count) for _, _, count in histogram)


def test_a_recording_counts_every_tick_in_the_bins_of_the_loop(session):
    running, folder = session
    found = read(folder / "run.mcap")
    assert len(found.timing) >= 3  # one a second and one at the end, each with what came since the one before
    assert found.histograms_us == {"tick": running.times.histogram(1)}
    assert total(found.histograms_us["tick"]) == running.ticks
    assert found.report == {**running.report(), "scene": "first_touch.xml"}


def test_a_snapshot_keeps_them_and_a_restored_session_goes_on_counting(session):
    running, folder = session
    again = itouch.restore(folder / "end.itouch")
    assert total(again.statistics.histograms()["tick"]) == running.ticks
    again.run(0.5)
    assert total(again.statistics.histograms()["tick"]) == running.ticks + 500
    assert again.times.ticks == 500


def test_snapshots_and_recordings_without_them_are_read(session):
    running, _ = session
    old = running.statistics.dump()
    del old["histograms_us"]
    running.statistics.load(old)
    assert running.statistics.earlier == {}
    assert histograms_us({}, [{"tick": 1, "p50": 2.0}]) == {}


def test_sums_of_histograms_are_those_of_their_ticks():
    rng = np.random.default_rng(3)
    first, second = (rng.integers(0, 5, BINS).astype("u4") for _ in range(2))
    assert merged([bins(first), bins(second)]) == bins(first + second)
    low, high = edges()[7:9] * 1e6
    assert bins(np.eye(1, BINS, 7, dtype="u4")[0]) == [[pytest.approx(low, abs=1e-3), pytest.approx(high, abs=1e-3), 1]]


@settings(max_examples=200, deadline=None)
@given(st.lists(JUNK, max_size=4), JUNK, JUNK)
def test_a_file_may_say_anything(histograms, edge_list, counts):
    for low, high, count in merged(histograms):
        assert 0.0 <= low < high < np.inf and count > 0
    found = histograms_us({"timing_edges_us": edge_list}, [{"lateness": counts, "ticks": counts}])
    for histogram in (*found.values(), *histograms_us({"timing_edges_us": [1, 2, 3]}, [{"ticks": counts}]).values()):
        assert all(count > 0 for _, _, count in histogram)
