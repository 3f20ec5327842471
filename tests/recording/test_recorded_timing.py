"""The timing that a recording notes of its session."""

from __future__ import annotations

from pathlib import Path

from program import program
from shipped import SCENES

from itouch.recording import read


def test_no_percentile_is_above_the_longest_tick(tmp_path: Path) -> None:
    # of a single tick every percentile is in the bin of the longest one, and its estimate within the bin above that
    scene = str(SCENES / "first_touch.xml")
    for run in range(3):
        path = str(tmp_path / f"{run}.mcap")
        assert program("run", scene, "--headless", "--for", "1ms", "--record", path).returncode == 0
        recording = read(path)
        note, report = recording.timing[-1], recording.report
        assert report is not None
        assert note["p50"] <= note["p99"] <= note["max"]
        figures = report["servo"]["tick_us"]
        assert [note[key] for key in ("p50", "p99", "max")] == [figures[key] for key in ("p50", "p99", "max")]
