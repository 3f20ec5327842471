"""Records of calibrations beside a scene: what was measured, when, and until when it holds.

The file is ``NAME.calibration.json`` beside ``NAME.xml``.  Its records are put into the scene as it is loaded: poses
into mounts, values into the plugin's parameters, so that a saved session has them.  A record of a twin is for the twin,
one of hardware for hardware.  One that has expired refuses the scene until it is made anew or extended.
"""

from __future__ import annotations

import datetime
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from itouch.plugin import poses
from itouch.scene import Scene
from itouch.schema import ItouchError, Problem, SceneError

FORMAT = "itouch-py calibration 1"


@dataclass(frozen=True, slots=True)
class CalibrationRecord:
    """The result of one calibration; ``mount`` is the device's pose in its carrier, shape (7,), or empty."""

    device: str
    kind: str
    twin: bool
    made: str
    expires: str
    values: Mapping[str, float]
    mount: tuple[float, ...]
    residual: float
    unit: str
    samples: int

    def stale(self, now: datetime.datetime) -> bool:
        """Tell whether it has expired."""
        return datetime.datetime.fromisoformat(self.expires) <= now


def now() -> datetime.datetime:
    """Return the time, in UTC."""
    return datetime.datetime.now(datetime.UTC).replace(microsecond=0)


def file_of(scene: str | os.PathLike[str]) -> Path:
    """Return where the records of a scene file are."""
    return Path(scene).with_suffix(".calibration.json")


def read_records(path: Path) -> list[CalibrationRecord]:
    """Return the records of a file, none if there is none.

    Raises
    ------
    ItouchError
        If it is no file of records.
    """
    if not path.exists():
        return []
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["format"] != FORMAT:
            raise ValueError(f"its format is '{data['format']}', not '{FORMAT}'")
        records = [CalibrationRecord(**{**entry, "mount": tuple(entry["mount"])}) for entry in data["records"]]
        for record in records:
            record.stale(now())
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ItouchError(f"calibration file '{path}' cannot be used: {error}") from error
    return records


def write_records(path: Path, records: Sequence[CalibrationRecord]) -> None:
    """Write the records.

    Raises
    ------
    ItouchError
        If the file cannot be written.
    """
    text = json.dumps({"format": FORMAT, "records": [asdict(record) for record in records]}, indent=1)
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise ItouchError(f"calibration file '{path}' cannot be written: {error.strerror or error}") from error


def store(path: Path, record: CalibrationRecord) -> None:
    """Put a record into a file in place of the one of the same device and kind."""
    key = (record.device, record.kind, record.twin)
    others = [r for r in read_records(path) if (r.device, r.kind, r.twin) != key]
    write_records(path, [*others, record])


def calibrated(scene: Scene) -> Scene:
    """Return the scene with the records beside its file put in.

    Raises
    ------
    SceneError
        If one has expired, or does not fit its device any more.
    """
    path = file_of(scene.source)
    records = read_records(path) if scene.source.endswith(".xml") else []
    problems: list[Problem] = []
    devices = []
    for device in scene.devices:
        changed = device
        for record in records:
            if record.device != device.name or record.twin != bool(device.twin):
                continue
            try:
                changed = _with(changed, record)
            except (ValueError, AttributeError, TypeError) as error:
                problems.append(_misfit(scene, device, record, path, error))
        devices.append(_placed(scene, device, changed))
    if problems:
        raise SceneError(problems)
    return replace(scene, devices=tuple(devices)) if records else scene


def _with(device: Any, record: CalibrationRecord) -> Any:
    if record.stale(now()):
        raise ValueError(f"it expired on {record.expires[:10]}")
    if record.mount:
        mount = replace(device.mount, pos=record.mount[:3], quat=record.mount[3:], rpy=None)
        device = replace(device, mount=mount)
    if not record.values:
        return device
    parts = list(device.parts)
    if not parts:
        raise ValueError("the device has no element of its plugin any more")
    params = parts[0].params
    for name, value in record.values.items():
        params = _set(params, name.split("."), value)
    return replace(device, parts=(replace(parts[0], params=params), *parts[1:]))


def _set(params: Any, names: list[str], value: float) -> Any:
    """Return parameters with one value changed, in a child if the name has parts."""
    inner = getattr(params, names[0])
    return replace(params, **{names[0]: value if len(names) == 1 else _set(inner, names[1:], value)})


def _misfit(scene: Scene, device: Any, record: CalibrationRecord, path: Path, error: Exception) -> Problem:
    sentence = f"calibration '{record.kind}' of device '{device.name}' cannot be used: {error}"
    advice = f"calibrate anew, or say that it holds: itouch-py calibrate SCENE --device {device.name} --extend"
    return Problem("calibration-stale", f"{sentence} ({path.name})", scene.places.of(device), advice)


def _placed(scene: Scene, device: Any, changed: Any) -> Any:
    """Let a changed device point to the same place of the file."""
    place = scene.places.of(device)
    if changed is not device and place is not None:
        names = ("name", "plugin", "twin")
        spots = {name: spot for name in names if (spot := scene.places.of(device, name)) is not None}
        scene.places.put(changed, place, spots)
    return changed


def mount_pose(mount: Any) -> tuple[float, ...]:
    """Return a mount's pose, shape (7,)."""
    turn = poses.quaternion_from_rpy(mount.rpy) if mount.rpy is not None else mount.quat or (1.0, 0.0, 0.0, 0.0)
    return (*mount.pos, *poses.normalized(turn))
