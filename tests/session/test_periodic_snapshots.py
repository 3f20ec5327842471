"""Snapshots now and then: what cannot be saved is told once and counted, and the session goes on."""

from __future__ import annotations

import contextlib
import itertools
import time
from pathlib import Path

from shipped import SCENES

import itouch


def test_a_folder_that_goes_is_a_fault_and_the_session_runs_on(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    folder.mkdir()
    session = itouch.build(SCENES / "first_touch.xml")
    with session.saving(folder / "s.itouch", 0.1):
        session.run(0.25)
        deadline = time.monotonic() + 300.0  # a thread writes it
        while not (folder / "s.itouch").exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        for number in itertools.count():  # the thread may be writing the next one, and make the folder anew
            folder.rename(tmp_path / f"gone {number}")
            with contextlib.suppress(IsADirectoryError):
                folder.write_text("no folder any more")
                break
        session.run(0.5)
    assert session.ticks == 750
    *gone, fault = session.report()["faults"]
    assert len(gone) <= 1, "a folder that was not there, between the two lines above, is another cause than a file"
    assert {(one["device"], one["trip"]) for one in (*gone, fault)} == {("session", "saving")}
    assert "s.itouch" in fault["cause"] and fault["times"] > 1
    session.close()


def test_what_is_saved_last_is_what_the_session_was_then(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    with session.saving(tmp_path / "s.itouch", 0.1):
        session.run(0.35)
    assert int(itouch.restore(tmp_path / "s.itouch").state["tick"]) == 300
    session.close()
