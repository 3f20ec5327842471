"""A recording as a BIDS-like folder: tables with JSON sidecars that say every column's unit.

After the Brain Imaging Data Structure's continuous recordings (``_physio``) and events: gzipped tables without a
header whose columns the sidecar names, and one table of events.
"""

from __future__ import annotations

import gzip
import json
import os
import re
from pathlib import Path
from typing import Any

from itouch.recording.contacts import contacts_of
from itouch.recording.recording import Recording
from itouch.recording.tables import columns_of, lines, meanings_of, safe_name

VERSION = "1.10.0"


def export_bids(recording: Recording, target: str, *, subject: str = "01", task: str = "") -> list[str]:
    """Write the folder and return its files.

    Parameters
    ----------
    recording
        What was recorded.
    target
        The folder; it may be there already, with other subjects.
    subject, task
        Labels of letters and digits; default for the task: the scene's name.

    Raises
    ------
    ValueError
        If a label is not of letters and digits.
    OSError
        If it can't be written.
    """
    source = str(recording.session.get("manifest", {}).get("source", ""))
    label = task or re.sub(r"[^A-Za-z0-9]", "", Path(source).stem) or "touch"
    for word in (subject, label):
        if not re.fullmatch(r"[A-Za-z0-9]+", word):
            raise ValueError(f"a label is of letters and digits, not '{word}'")
    folder = os.path.join(target, f"sub-{subject}", "beh")
    os.makedirs(folder, exist_ok=True)
    stem = os.path.join(folder, f"sub-{subject}_task-{label}")
    description = os.path.join(target, "dataset_description.json")
    _json(description, {"Name": label, "BIDSVersion": VERSION, "GeneratedBy": [{"Name": "itouch-py"}]})
    written = [description]
    for track in recording.tracks.values():
        name = f"{stem}_recording-{re.sub('[^A-Za-z0-9]', '', safe_name(track.name))}_physio"
        written += _continuous(recording, track.name, name)
    return [*written, *_events(recording, f"{stem}_events")]


def _json(path: str, content: dict[str, Any]) -> None:
    with open(path, "w", encoding="utf-8") as stream:
        json.dump(content, stream, indent=2)
        stream.write("\n")


def _continuous(recording: Recording, track: str, stem: str) -> list[str]:
    described = recording.tracks[track]
    columns = columns_of(recording, described, celsius=True)
    meanings = meanings_of(described)
    begin = float(recording[track]["time"][0]) if len(recording[track]) else 0.0
    sidecar: dict[str, Any] = {
        "SamplingFrequency": 1.0 / (described.every * recording.period),
        "StartTime": begin,
        "Columns": list(columns),
    }
    for name, (unit, _) in columns.items():
        said = {"Description": meanings[name]} if name in meanings else {}
        sidecar[name] = {"Units": unit or "1", **said}
    _json(stem + ".json", sidecar)
    with gzip.GzipFile(stem + ".tsv.gz", "wb", mtime=0) as stream:
        for line in lines(columns, "\t"):
            stream.write(line.encode())
    return [stem + ".json", stem + ".tsv.gz"]


def _events(recording: Recording, stem: str) -> list[str]:
    rows: list[tuple[float, float | None, str, str]] = []
    for contact in contacts_of(recording):
        duration = None if contact.end is None else contact.end - contact.begin
        rows.append((contact.begin, duration, "contact", contact.object))
    rows += [(mark["time"], 0.0, "mark", f"{mark['name']} {mark['payload']}".strip()) for mark in recording.marks]
    rows += [(fault["time"], 0.0, "fault", str(fault.get("cause", ""))) for fault in recording.faults]
    with open(stem + ".tsv", "w", encoding="utf-8") as stream:
        stream.write("onset\tduration\ttrial_type\tvalue\n")
        for onset, duration, kind, value in sorted(rows, key=lambda row: row[0]):
            text = value.replace("\t", " ").replace("\n", " ") or "n/a"
            stream.write(f"{onset!r}\t{'n/a' if duration is None else repr(duration)}\t{kind}\t{text}\n")
    _json(
        stem + ".json",
        {
            "onset": {"Units": "s", "Description": "session time"},
            "duration": {"Units": "s", "Description": "of a contact; n/a if it was still open"},
            "trial_type": {"Levels": {"contact": "a touch", "mark": "a mark or trial marker", "fault": "a fault"}},
            "value": {"Description": "object of a contact, name and payload of a mark, cause of a fault"},
        },
    )
    return [stem + ".tsv", stem + ".json"]
