"""Calibration records beside a scene: what was measured, when, and until when it is valid.

The file is ``NAME.calibration.json`` beside ``NAME.xml``.  Its records are put into the scene as it is loaded: poses
into mounts, values into the plugin's parameters, so that a saved session has them.  A record of a twin is for the twin,
one of hardware for hardware.  With an expired record a scene does not load until the record is renewed or extended.
"""

from __future__ import annotations

import datetime
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from itouch.plugin import poses
from itouch.scene import Scene
from itouch.schema import ItouchError, Problem, SceneError
from itouch.schema.fields import validate
from itouch.schema.files import open_regular

FORMAT = "itouch-py calibration 1"
#: How much of a file of records is read at most [bytes].
MOST = 8 << 20


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
    """Return the time in UTC, without fractions of a second."""
    return datetime.datetime.now(datetime.UTC).replace(microsecond=0)


def file_of(scene: str | os.PathLike[str]) -> Path:
    """Return the default file for the records of a scene file."""
    return Path(scene).with_suffix(".calibration.json")


def stored_in(scene: Scene, device: Any) -> Path:
    """Return the file with a device's records: the one that its ``<calibration>`` names, or the scene's."""
    named = device.calibration.stored_in if device.calibration is not None else ""
    return Path(scene.folder) / named if named else file_of(scene.source)


def read_records(path: Path) -> list[CalibrationRecord]:
    """Return the records in a file; none if the file does not exist.

    Raises
    ------
    ItouchError
        If it is not a file of records.
    """
    if not path.exists():
        return []
    try:
        with open_regular(path) as stream:
            data = json.loads(stream.read(MOST))
        if data["format"] != FORMAT:
            raise ValueError(f"its format is '{data['format']}', not '{FORMAT}'")
        return [_checked(CalibrationRecord(**entry)) for entry in data["records"]]
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise ItouchError(f"calibration file '{path}' cannot be used: {error}") from error


def _checked(record: CalibrationRecord) -> CalibrationRecord:
    """Return a record that was read, once checked: somebody may have changed its file by hand.

    Raises
    ------
    ValueError, TypeError
        Naming what is wrong.
    """
    for name in ("device", "kind", "unit"):
        if not isinstance(getattr(record, name), str):
            raise ValueError(f"'{name}' of a record is no text")
    if record.twin not in (True, False):
        raise ValueError(f"'twin' of '{record.kind}' is neither true nor false")
    numbers = [record.residual, record.samples, *record.mount, *record.values.values()]
    if not all(isinstance(n, (int, float)) and not isinstance(n, bool) and math.isfinite(n) for n in numbers):
        raise ValueError(f"'{record.kind}' of '{record.device}' holds something that is no finite number")
    if len(record.mount) not in (0, 7) or (record.mount and not any(record.mount[3:])):
        raise ValueError(f"mount of '{record.kind}' must be a position and a quaternion, 7 numbers")
    for text in (record.made, record.expires):
        if datetime.datetime.fromisoformat(text).tzinfo is None:
            raise ValueError(f"the time '{text}' says no zone")
    return replace(record, mount=tuple(float(n) for n in record.mount))


def write_records(path: Path, records: Sequence[CalibrationRecord]) -> None:
    """Write the records.

    Raises
    ------
    ItouchError
        If the file cannot be written.
    """
    text = json.dumps({"format": FORMAT, "records": [asdict(record) for record in records]}, indent=1, allow_nan=False)
    draft = path.with_name(path.name + ".new")
    try:
        draft.write_text(text + "\n", encoding="utf-8")
        os.replace(draft, path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise ItouchError(f"calibration file '{path}' cannot be written: {error.strerror or error}") from error


def store(path: Path, record: CalibrationRecord) -> None:
    """Store a record in a file, replacing the one of the same kind for the same device or twin."""
    key = (record.device, record.kind, record.twin)
    others = [r for r in read_records(path) if (r.device, r.kind, r.twin) != key]
    write_records(path, [*others, record])


def calibrated(scene: Scene, *, stale: bool = False) -> Scene:
    """Return the scene with the records of its devices put in.

    Parameters
    ----------
    scene
        As it was loaded.
    stale
        Whether records that have expired, or no longer fit, are passed over, as when they are about to be renewed.

    Raises
    ------
    SceneError
        If one has expired, or no longer fits its device.
    """
    problems: list[Problem] = []
    devices = []
    for device in scene.devices:
        path, changed = stored_in(scene, device), device
        records = read_records(path) if path.suffix == ".json" and scene.source.endswith(".xml") else []
        for record in records:
            if record.device != device.name or record.twin != bool(device.twin):
                continue
            try:
                changed = _with(changed, record)
            except (ValueError, AttributeError, TypeError) as error:
                problems.append(_misfit(scene, device, record, path, error))
        devices.append(_placed(scene, device, changed))
    if problems and not stale:
        raise SceneError(problems)
    same = all(one is other for one, other in zip(devices, scene.devices, strict=True))
    return scene if same else replace(scene, devices=tuple(devices))


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
    """Return parameters with one value changed, in a nested element if the name has several parts."""
    inner = getattr(params, names[0])
    changed = replace(params, **{names[0]: value if len(names) == 1 else _set(inner, names[1:], value)})
    validate(changed)
    return changed


def _misfit(scene: Scene, device: Any, record: CalibrationRecord, path: Path, error: Exception) -> Problem:
    sentence = f"calibration '{record.kind}' of device '{device.name}' cannot be used: {error}"
    advice = (
        f"calibrate again, or confirm that it still holds: itouch-py calibrate SCENE --device {device.name} --extend"
    )
    return Problem("calibration-stale", f"{sentence} ({path.name})", scene.places.of(device), advice)


def _placed(scene: Scene, device: Any, changed: Any) -> Any:
    """Let a changed device point to the same place in the scene's file."""
    place = scene.places.of(device)
    if changed is not device and place is not None:
        names = ("name", "plugin", "twin")
        spots = {name: spot for name in names if (spot := scene.places.of(device, name)) is not None}
        scene.places.put(changed, place, spots)
    return changed


def mount_pose(mount: Any) -> tuple[float, ...]:
    """Return a mount's pose, shape (7,) [m; quaternion]."""
    turn = poses.quaternion_from_rpy(mount.rpy) if mount.rpy is not None else mount.quat or (1.0, 0.0, 0.0, 0.0)
    return (*mount.pos, *poses.normalized(turn))
