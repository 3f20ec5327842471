"""A recording as a folder in the Brain Imaging Data Structure: tables with JSON sidecars that state every unit.

Continuous recordings (``_physio``) are gzipped tables without a header, whose columns the sidecar names; poses are
written a second time as ``_motion``, with a table of their channels; events are one table.
"""

from __future__ import annotations

import gzip
import io
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from itouch.plugin import Role
from itouch.recording.recording import Recording
from itouch.recording.tracks import Column, Track
from itouch.schema.durable import replacing, write_whole
from itouch_tools.export.contacts import contacts_of
from itouch_tools.export.tables import columns_of, distinct, lines, meanings_of

#: Version of the specification, and of its vocabulary of event tags, of which none is used.
VERSION, HED = "1.10.0", "8.3.0"
#: The authors where none were given: a data set has people behind it, and readers ask for them.
UNNAMED = ("the laboratory (export names it with --author)", "itouch-py")
#: Kinds of motion channel that are not written.
_UNUSED = ("ACCEL", "ANGACCEL", "GYRO", "JNTANG", "LATENCY", "MAGN", "MISC", "VEL")
#: What only the laboratory knows, and where terms for tasks can be found.
_TASK = {
    "TaskDescription": "touch of virtual objects", "Instructions": "n/a", "InstitutionName": "n/a",
    "InstitutionAddress": "n/a", "InstitutionalDepartmentName": "n/a",
    "CogAtlasID": "https://www.cognitiveatlas.org/", "CogPOID": "http://www.cogpo.org/",
}  # fmt: skip
_README = """# {task}

Touch recorded with itouch-py: positions, forces, temperatures and commands to devices, of scene {scene}.
Continuous tables (`_physio`) and their sidecars say of each column its unit and what it is; `_motion` holds the poses
once more; `_events` holds contacts, marks and faults. Time counts from the start of the session, in seconds.
"""
#: Components of a pose as BIDS names them: kind and unit of each.
_COMPONENTS = (
    *((part, "POS", "m") for part in "xyz"), *((f"quat_{part}", "ORNT", "n/a") for part in "wxyz"),
)  # fmt: skip
#: The axes of the world and its origin: x to the operator's right, y away from the operator, z up.
WORLD = ("RAS", "in the world: x to the operator's right, y away from the operator, z up")


def export_bids(
    recording: Recording, target: str, *, subject: str = "01", task: str = "", authors: Sequence[str] = ()
) -> list[str]:
    """Write the folder and return its files.

    Parameters
    ----------
    recording
        The recording to export.
    target
        The folder; it may exist already, with other subjects.
    subject, task
        Labels, of letters and digits only; default for the task: the scene's name.
    authors
        Names of those who made the data.

    Raises
    ------
    ValueError
        If a label has other characters than letters and digits.
    OSError
        If a file can't be written.
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
    made = [{"Name": "itouch-py", "Description": "export of a recorded session"}]
    named = list(authors) or list(UNNAMED)
    _json(description, {"Name": label, "BIDSVersion": VERSION, "HEDVersion": HED, "DatasetType": "raw",
                        "License": "n/a", "Authors": named, "GeneratedBy": made,
                        "SourceDatasets": [{"URL": f"urn:itouch:recording:{label}"}]})  # fmt: skip
    readme = os.path.join(target, "README")
    write_whole(readme, _README.format(task=label, scene=Path(source).name or "of its own").encode())
    written = [description, readme]
    # labels are of letters and digits only: tracks 'arm-1' and 'arm_1' would have one file
    words = [re.sub("[^A-Za-z0-9]", "", name)[:100] or "track" for name in recording.tracks]
    labels = dict(zip(recording.tracks, distinct(words, joint="x"), strict=True))
    for of in recording.tracks:
        written += _continuous(recording, of, f"{stem}_recording-{labels[of]}_physio", label)
    moved = os.path.join(target, f"sub-{subject}", "motion")
    for track in recording.tracks.values():
        poses = [column for column in track.columns if track.replay and column.unit == "m" and column.size in (3, 7)]
        if poses:
            os.makedirs(moved, exist_ok=True)
            name = os.path.join(moved, f"sub-{subject}_task-{label}_tracksys-{labels[track.name]}")
            written += _motion(recording, track, poses, name, label)
    if os.path.isdir(moved):
        written += _events(recording, os.path.join(moved, f"sub-{subject}_task-{label}_events"), label)
    return [*written, *_events(recording, f"{stem}_events", label)]


def _json(path: str, content: dict[str, Any]) -> None:
    with replacing(path) as new, open(new, "w", encoding="utf-8") as stream:
        json.dump(content, stream, indent=2)
        stream.write("\n")


def _continuous(recording: Recording, track: str, stem: str, task: str) -> list[str]:
    described = recording.tracks[track]
    columns = columns_of(recording, described, celsius=True)
    meanings = meanings_of(described)
    begin = float(recording[track]["time"][0]) if len(recording[track]) else 0.0
    sidecar: dict[str, Any] = {
        "SamplingFrequency": 1.0 / (described.every * recording.period),
        "StartTime": begin,
        "Columns": list(columns),
        "TaskName": task,
        "PhysioType": "generic",
        "Description": f"what {track} read, which commands it got, and its status, in every period that was recorded",
    }
    for name, (unit, _) in columns.items():
        said = {"Description": meanings[name]} if name in meanings else {}
        sidecar[name] = {"Units": unit or "1", **said}
    _json(stem + ".json", sidecar)
    with (
        replacing(stem + ".tsv.gz") as new,
        open(new, "wb") as file,
        gzip.GzipFile("", "wb", mtime=0, fileobj=file) as packed,  # no name in its head: it could reveal a user's name
        io.TextIOWrapper(packed, encoding="utf-8", newline="") as stream,
    ):
        stream.writelines(lines(columns, "\t"))
    return [stem + ".json", stem + ".tsv.gz"]


def _motion(recording: Recording, track: Track, poses: list[Column], stem: str, task: str) -> list[str]:
    """Write the poses of a track and the descriptions of its channels; return the files."""
    rows, rate = recording[track.name], 1.0 / (track.every * recording.period)
    # a pose that a device measures has a role and is in the device's own frame; one that the loop computes is in the
    # world's
    own = any(column.role is not Role.SIGNAL for column in poses)
    axes, frame = ("n/a", "in the device's own frame; its mount in the scene says where that is") if own else WORLD
    channels, numbers = ["name\tcomponent\ttype\ttracked_point\tunits\tsampling_frequency\tdescription"], []
    for column in poses:
        for place, (component, kind, unit) in enumerate(_COMPONENTS[: column.size]):
            said = (column.doc or f"{column.name} of {track.name}").replace("\t", " ").replace("\n", " ")
            label = f"{column.name}_{component}".replace(".", "_")
            channels.append(f"{label}\t{component}\t{kind}\t{track.name}\t{unit}\t{rate!r}\t{said}")
            numbers.append(rows[column.name][:, place].tolist())
    _json(stem + "_motion.json", {
        "SamplingFrequency": rate, "TaskName": task, **_TASK, "TrackedPointsCount": len(poses),
        "MotionChannelCount": len(numbers),
        "POSChannelCount": sum(min(3, column.size) for column in poses),
        "ORNTChannelCount": sum(max(0, column.size - 3) for column in poses),
        "RecordingDuration": len(rows) / rate, "RecordingType": "continuous", "MissingValues": "n/a",
        "SamplingFrequencyEffective": rate, "SubjectArtefactDescription": "n/a", "SpatialAxes": axes,
        "TrackingSystemName": track.name, "Manufacturer": "n/a", "ManufacturersModelName": "n/a",
        "SoftwareVersions": "n/a", "DeviceSerialNumber": "n/a", "RotationRule": "right-hand",
        **{f"{kind}ChannelCount": 0 for kind in _UNUSED},
        "Description": f"poses of {track.name} {frame}", "EpochLength": 0,
    })  # fmt: skip
    with replacing(stem + "_motion.tsv") as new, open(new, "w", encoding="utf-8", newline="") as stream:
        stream.writelines("\t".join(map(repr, row)) + "\n" for row in zip(*numbers, strict=True))
    with replacing(stem + "_channels.tsv") as new, open(new, "w", encoding="utf-8", newline="") as stream:
        stream.writelines(line + "\n" for line in channels)
    return [f"{stem}_motion.json", f"{stem}_motion.tsv", f"{stem}_channels.tsv"]


def _events(recording: Recording, stem: str, task: str) -> list[str]:
    rows: list[tuple[float, float | None, str, str, str]] = []
    for contact in contacts_of(recording):
        duration = None if contact.end is None else contact.end - contact.begin
        rows.append((contact.begin, duration, "contact", contact.object, contact.probe))
    rows += [(mark["time"], 0.0, "mark", f"{mark['name']} {mark['payload']}".strip(), "") for mark in recording.marks]
    rows += [(fault["time"], 0.0, "fault", str(fault.get("cause", "")), str(fault.get("device", "")))
             for fault in recording.faults]  # fmt: skip
    with replacing(stem + ".tsv") as new, open(new, "w", encoding="utf-8") as stream:
        stream.write("onset\tduration\ttrial_type\tvalue\tsource\n")
        for onset, duration, kind, *words in sorted(rows, key=lambda row: row[0]):
            texts = "\t".join(word.replace("\t", " ").replace("\n", " ") or "n/a" for word in words)
            stream.write(f"{onset!r}\t{'n/a' if duration is None else repr(duration)}\t{kind}\t{texts}\n")
    _json(
        stem + ".json",
        {
            "TaskName": task,
            **_TASK,
            "StimulusPresentation": {"SoftwareName": "itouch-py"},
            "Description": "contacts, marks and faults of the session",
            "onset": {"Units": "s", "Description": "session time"},
            "duration": {"Units": "s", "Description": "of a contact; n/a if it was still open"},
            "trial_type": {"Levels": {"contact": "a touch", "mark": "a mark or trial marker", "fault": "a fault"}},
            "value": {"Description": "object of a contact, name and payload of a mark, cause of a fault"},
            "source": {"Description": "probe of a contact, device of a fault; n/a of a mark"},
        },
    )
    return [stem + ".tsv", stem + ".json"]
