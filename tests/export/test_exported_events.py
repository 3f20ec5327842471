"""What happened in a session, in its tables: who touched, and which device failed."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from program import program
from shipped import SCENES

from itouch.recording import Recording, read
from itouch_tools.export.contacts import contacts_of


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A recording in which two fingers touch a block, and the arm of one is then lost."""
    folder = tmp_path_factory.mktemp("happened")
    text = (SCENES / "two_fingers.xml").read_text(encoding="utf-8")
    fault = '<fault device="right" kind="disconnect" at="0.7 s"/>'
    (folder / "lost.xml").write_text(text.replace("</interaction>", f"</interaction>{fault}"), encoding="utf-8")
    done = program("run", "lost.xml", "--headless", "--for", "1s", "--record", "lost.mcap", cwd=folder)
    assert done.returncode == 1, done.stderr
    done = program("export", "lost.mcap", "--bids", "bids", "--csv", "csv", "--task", "lost", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def table(path: Path, separator: str) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream, delimiter=separator))


def test_events_of_bids_say_which_finger_touched_and_which_device_failed(kept: Path) -> None:
    events = table(kept / "bids" / "sub-01" / "beh" / "sub-01_task-lost_events.tsv", "\t")
    touched = {(row["source"], row["value"]) for row in events if row["trial_type"] == "contact"}
    assert touched == {("thumb", "block"), ("index", "block")}
    assert {row["source"] for row in events if row["trial_type"] == "fault"} == {"right"}
    begins = [float(row["onset"]) for row in events]
    assert begins == sorted(begins) and begins[-1] == pytest.approx(0.7, abs=0.01)  # whatever happened, in time's order


def test_what_a_fault_consists_of_is_json_in_its_table(kept: Path) -> None:
    rows, faults = table(kept / "csv" / "faults.csv", ","), read(kept / "lost.mcap").faults
    assert len(rows) == len(faults) > 0
    for row, fault in zip(rows, faults, strict=True):
        for name in ("safe", "injected"):
            assert (json.loads(row[name]) if row[name] else None) == fault.get(name)


@pytest.fixture(scope="module")
def resumed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording that begins in a touch: its session goes on from a snapshot."""
    folder = tmp_path_factory.mktemp("resumed")
    for words in (
        ("run", SCENES / "first_touch.xml", "--headless", "--for", "1s", "--save", "half.itouch"),
        ("run", "half.itouch", "--headless", "--record", "rest.mcap", "--report", "rest.json"),
    ):
        done = program(*map(str, words), cwd=folder)
        assert done.returncode == 0, done.stderr
    return folder


def test_a_touch_that_began_before_the_recording_is_among_its_contacts(resumed: Path) -> None:
    (contact,) = json.loads((resumed / "rest.json").read_text(encoding="utf-8"))["contacts"]
    assert contact["begin_s"] < 1.0 < contact["end_s"]
    done = program("inspect", "rest.mcap", "--json", cwd=resumed)
    (span,) = json.loads(done.stdout)["contacts"]
    assert span == {"probe": "finger", "object": "block", "begin": contact["begin_s"], "end": contact["end_s"]}
    assert program("export", "rest.mcap", "--bids", "bids", "--task", "rest", cwd=resumed).returncode == 0
    (row,) = table(resumed / "bids" / "sub-01" / "beh" / "sub-01_task-rest_events.tsv", "\t")
    assert (row["trial_type"], row["value"], row["source"]) == ("contact", "block", "finger")
    assert float(row["onset"]) == contact["begin_s"]
    assert float(row["duration"]) == contact["end_s"] - contact["begin_s"]


def test_without_a_report_such_a_touch_counts_from_the_first_tick(
    resumed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = read(resumed / "rest.mcap")
    monkeypatch.setattr(Recording, "report", None)  # as in a recording that was cut off before its end
    (span,) = contacts_of(recording)
    assert span == ("finger", "block", 1.0, recording.events[0]["time"])
