"""A replay knows which readings were new: their age comes out as it was, from the first tick to the safe sequence."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_hardware import SCENE, catalog, stick

import itouch
from itouch.plugin import Record
from itouch.recording import read
from itouch.session.replay import Replay


@pytest.mark.parametrize("every", [1, 3, 7])
@pytest.mark.parametrize("phase", [0, 1, 2])
def test_ages_of_readings_are_replayed(tmp_path: Path, every: int, phase: int) -> None:
    class Slow(stick()):  # type: ignore[misc]
        """Has something new in one tick of some."""

        def open(self) -> None:
            super().open()
            self.calls = -1

        def read(self, reading: Record) -> bool | None:
            self.calls += 1
            return super().read(reading) if self.calls == 0 or (self.calls + phase) % every == 0 else False

    plugins = catalog(Slow)
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    session = itouch.build(tmp_path / "scene.xml", catalog=plugins)
    session.record(tmp_path / "run.mcap")
    with session:
        session.enable()
        session.run(0.4)
    recording = read(tmp_path / "run.mcap")
    work, ages = Replay(recording, catalog=plugins), []
    work.session.taps.append(lambda tick: ages.append(int(work.session.state["stick.age"])))
    while work.step():
        pass
    outcome = work.outcome()
    assert outcome.mismatches == outcome.skipped == 0 and outcome.ticks == len(recording.ticks)
    assert ages == recording["stick"]["age"].tolist()
