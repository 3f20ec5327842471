"""What happened in a session, in its tables: who touched, and which device failed."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from program import program
from shipped import SCENES

from itouch.recording import read


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


def test_what_a_fault_consists_of_is_json_in_its_table(kept: Path) -> None:
    rows, faults = table(kept / "csv" / "faults.csv", ","), read(kept / "lost.mcap").faults
    assert len(rows) == len(faults) > 0
    for row, fault in zip(rows, faults, strict=True):
        for name in ("safe", "injected"):
            assert (json.loads(row[name]) if row[name] else None) == fault.get(name)
