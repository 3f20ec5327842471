"""Calibration records beside a scene: what was measured, when, and until when it is valid.

The file is ``NAME.calibration.json`` beside ``NAME.xml``, or beside the rig's file if its devices replace those of the
scene: a record is of a device, and a device of the same name in another rig is another one.  Its records are put into
the scene as it is loaded: poses into mounts, values into the plugin's parameters, so that a saved session has them.  A
record of a twin is for the twin, one of hardware for hardware.  With an expired record a scene does not load until the
record is renewed or extended.
"""

from __future__ import annotations

import datetime
import json
import math
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from itouch.plugin import Fit, Role, poses
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene
from itouch.scene.elements import Mount
from itouch.schema import ItouchError, Problem, SceneError
from itouch.schema.diagnostics import Place, did_you_mean, meant
from itouch.schema.durable import write_whole
from itouch.schema.fields import Spec, check_range, specs, validate
from itouch.schema.regular_files import open_regular

FORMAT = "itouch-py calibration 1"
#: What to do with a file that cannot be read.
_ADVICE = "correct it, or remove it and calibrate again"
#: How many mistakes of a file are told.
_TOLD = 6
#: Number of digits from which a whole number is taken for infinite; Python refuses to read 4301.
_DIGITS = 400
#: By how much the clock of the machine where a record was made may be ahead of this one.
CLOCKS = datetime.timedelta(days=1)
#: How much of a file of records is read at most [bytes].
MOST = 8 << 20
#: For how much a disk must have room before anything is measured [bytes]: many records.
_ROOM = 1 << 14
#: How far a twin's mount may be from what is written [m].
FARTHEST = specs(Mount)["mount_error"].high


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

    def early(self, now: datetime.datetime) -> bool:
        """Tell whether it is dated in the future, by more than clocks differ: when it expires is not known then."""
        return datetime.datetime.fromisoformat(self.made) > now + CLOCKS


def now() -> datetime.datetime:
    """Return the time in UTC, without fractions of a second."""
    return datetime.datetime.now(datetime.UTC).replace(microsecond=0)


def file_of(scene: str | os.PathLike[str]) -> Path:
    """Return the default file for the records of a scene file, or of a rig's."""
    return Path(scene).with_suffix(".calibration.json")


def home_of(scene: Scene) -> Path:
    """Return the default file for the records of a scene's devices: beside the scene, or beside their rig."""
    return file_of((scene.swapped.rig if scene.swapped is not None else "") or scene.source)


def stored_in(scene: Scene, device: Any) -> Path:
    """Return the file with a device's records: the one that its ``<calibration>`` names, or that of all."""
    named = device.calibration.stored_in if device.calibration is not None else ""
    return Path(scene.folder) / named if named else home_of(scene)


def read_records(path: Path) -> list[CalibrationRecord]:
    """Return the records in a file; none if the file does not exist.

    Raises
    ------
    SceneError
        If it cannot be read, or is not a file of records.
    """
    try:
        with open_regular(path) as stream:
            text = stream.read(MOST + 1)
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise _unusable(path, error.strerror or f"{error}") from error
    if len(text) > MOST:
        raise _unusable(path, f"it is larger than {MOST >> 20} MiB")
    try:
        data = json.loads(text, parse_int=_integer, object_pairs_hook=_once)
    except json.JSONDecodeError as error:
        why = f"it is not JSON from {path}:{error.lineno}:{error.colno} on"
        raise _unusable(path, why, _ADVICE, error.lineno, error.colno) from error
    except RecursionError as error:
        raise _unusable(path, "it is nested too deep", _ADVICE) from error
    except UnicodeDecodeError as error:
        raise _unusable(path, "it is not UTF-8 text", _ADVICE) from error
    except ValueError as error:
        raise _unusable(path, f"{error}", _ADVICE) from error
    if not isinstance(data, dict) or not isinstance(data.get("records"), list) or "format" not in data:
        raise _unusable(path, 'it must be a JSON object, {"format": ..., "records": [...]}', _ADVICE)
    if data["format"] != FORMAT:
        raise _unusable(path, f"its format is '{data['format']}', this program reads '{FORMAT}'")
    wrong = [f"record {number}: {told}" for number, one in enumerate(data["records"], 1) for told in _wrong(one)]
    wrong = wrong or list(_repeated(data["records"]))
    if wrong:
        more = f"; and {len(wrong) - _TOLD} more" if len(wrong) > _TOLD else ""
        raise _unusable(path, "; ".join(wrong[:_TOLD]) + more, _ADVICE)
    return [_made_of(entry) for entry in data["records"]]


def _unusable(path: Path, why: str, advice: str = "", line: int = 1, column: int = 1) -> SceneError:
    sentence = f"calibration file '{path}' cannot be used: {why}"
    return SceneError([Problem("calibration-stale", sentence, Place(str(path), line, column), advice)])


def _integer(text: str) -> float:
    """Read a whole number; one of more digits than a float can have is infinite, which no value of a record may be."""
    return int(text) if len(text) < _DIGITS else math.inf


def _once(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object; of two values by one name, JSON itself would take the second without a word."""
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f"an object in it has '{name}' twice")
        found[name] = value
    return found


def _repeated(entries: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield which records are of the same device and kind as another: which of them holds would be a guess."""
    first: dict[tuple[str, str, bool], int] = {}
    for number, one in enumerate(entries, 1):
        before = first.setdefault((one["device"], one["kind"], one["twin"]), number)
        if before != number:
            yield f"record {number}: it is of the same device and kind as record {before}"


def _made_of(entry: Mapping[str, Any]) -> CalibrationRecord:
    return CalibrationRecord(**{**entry, "mount": tuple(float(n) for n in entry["mount"])})


def _wrong(entry: Any) -> Iterator[str]:
    """Yield what is wrong with a record as it was read: somebody may have changed its file by hand."""
    if not isinstance(entry, dict):
        yield "it must be a JSON object"
        return
    names = [each.name for each in fields(CalibrationRecord)]
    for name in names:
        if name not in entry:
            yield f"'{name}' is missing"
        elif told := _wrong_value(name, entry[name]):
            yield told
    for name in entry:
        if name not in names:
            yield f"no record has '{name}': {did_you_mean(name, names, 'it has')}"


def _wrong_value(name: str, value: Any) -> str:
    """Return what is wrong with one value of a record; empty: nothing."""
    if name in ("device", "kind", "unit"):
        return "" if isinstance(value, str) else f"'{name}' must be text"
    if name in ("made", "expires"):
        return "" if _is_time(value) else f"'{name}' must be a time with its zone, as '2026-01-31T12:00:00+00:00'"
    if name == "twin":
        return "" if isinstance(value, bool) else "'twin' must be true or false"
    if name == "values":
        right = isinstance(value, dict) and all(_is_number(number) for number in value.values())
        return "" if right else "'values' must be an object of finite numbers"
    if name == "mount":
        right = isinstance(value, list) and len(value) in (0, 7) and all(_is_number(number) for number in value)
        return _wrong_mount(value) if right else "'mount' must be a position and a quaternion, 7 numbers"
    if name == "samples":
        right = isinstance(value, int) and _is_number(value) and value >= 0
        return "" if right else "'samples' must be a whole number, at least 0"
    return "" if _is_number(value) and value >= 0 else f"'{name}' must be a finite number, at least 0"


def _wrong_mount(value: Sequence[float]) -> str:
    """Return what is wrong with a mount of seven numbers, or of none: it must be one that a scene can have."""
    if not value:
        return ""
    try:
        check_range(specs(Mount)["pos"], "position", tuple(value[:3]))
        poses.normalized(value[3:])
    except ValueError as error:
        return f"'mount': {error}"
    return ""


def _is_number(value: Any) -> bool:
    """Tell whether a value is a finite number; JSON has integers that no float can hold."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _is_time(value: Any) -> bool:
    try:
        return datetime.datetime.fromisoformat(value).tzinfo is not None
    except (TypeError, ValueError):
        return False


def write_records(path: Path, records: Sequence[CalibrationRecord]) -> None:
    """Write the records, in place of earlier ones or not at all; a link goes on pointing to the file that it points to.

    Raises
    ------
    ItouchError
        If the file cannot be written.
    """
    text = json.dumps({"format": FORMAT, "records": [asdict(record) for record in records]}, indent=1, allow_nan=False)
    try:
        write_whole(str(path), f"{text}\n".encode())
    except OSError as error:
        raise ItouchError(f"calibration file '{path}' cannot be written: {error.strerror or error}") from error


def check_place(path: Path) -> None:
    """Check, before anything is measured, that a file of records can be written.

    Raises
    ------
    ItouchError
        If its folder, or the disk, takes no new file.
    """
    folder = os.path.dirname(os.path.realpath(path))
    if not os.path.isdir(folder):  # it is made when the records are written
        return
    try:
        with tempfile.TemporaryFile(dir=folder) as stream:
            stream.write(bytes(_ROOM))
    except OSError as error:
        raise ItouchError(f"calibration file '{path}' cannot be written: {error.strerror or error}") from error


def store(path: Path, record: CalibrationRecord) -> None:
    """Store a record in a file, replacing the one of the same kind for the same device or twin."""
    key = (record.device, record.kind, record.twin)
    others = [r for r in read_records(path) if (r.device, r.kind, r.twin) != key]
    write_records(path, [*others, record])


def offered(element: Any, catalog: Catalog) -> dict[str, Fit | None]:
    """Return the calibrations of a device by kind; None for those of its mount."""
    cls = catalog.device(element.plugin)
    roles = {channel.role for channel in (*cls.reads, *cls.commands)} if cls is not None else set()
    own: dict[str, Fit | None] = {fit.kind: fit for fit in cls.calibrations} if cls is not None else {}
    if Role.TRACKED_POSE in roles:
        own["mount-fit"] = None
    if {Role.SURFACE_POSE, Role.CONTACT_FORCE} <= roles:
        own["touch-off"] = None
    return own


def calibrated(scene: Scene, *, stale: bool = False, catalog: Catalog | None = None) -> Scene:
    """Return the scene with the records of its devices put in.

    Parameters
    ----------
    scene
        As it was loaded.
    stale
        Whether records that have expired, or no longer fit, are passed over, as when they are about to be renewed.
    catalog
        The plugins, which say what kinds of calibration a device has; None: kinds are not checked.

    Raises
    ------
    SceneError
        If one has expired, no longer fits its device, or names a device or a kind that does not exist.
    """
    problems: list[Problem] = [] if stale else list(_strangers(scene, catalog))
    devices = []
    for device in scene.devices:
        path, changed = stored_in(scene, device), device
        for record in read_records(path) if scene.source else ():
            if record.device != device.name or record.twin != bool(device.twin):
                continue
            if ("device", device.name) in scene.uncertain.unsound:  # what the record is put into is not what was meant
                continue
            try:
                changed = _with(changed, record)
            except (ValueError, AttributeError, TypeError) as error:
                problems.append(_misfit(scene, device, record, path, error))
        devices.append(_placed(scene, device, changed))
    if problems and not stale:
        raise SceneError(problems)
    same = all(one is other for one, other in zip(devices, scene.devices, strict=True))
    found = scene if same else replace(scene, devices=tuple(devices))
    lost = tuple(_lost_links(scene))
    return _with_notes(replace(found, notes=(*found.notes, *lost)) if lost else found)


def _lost_links(scene: Scene) -> Iterator[str]:
    """Yield a sentence for each file of records behind a link that leads nowhere: its disk may not be mounted."""
    if not scene.source:
        return
    for path in dict.fromkeys(stored_in(scene, device) for device in scene.devices):
        if os.path.exists(path):
            continue
        for part in (path, *path.parents):
            if os.path.islink(part) and not os.path.exists(part):
                yield (
                    f"no calibration records are used from '{path}': '{part}' is a link to '{os.readlink(part)}', "
                    "which is not there; mount its disk, or calibrate to make the file"
                )
                break


def _with_notes(scene: Scene) -> Scene:
    """Return the scene with a note of the records that hold for its own devices and not for those of its rig."""
    swapped = scene.swapped
    if swapped is None or not swapped.rig or home_of(scene) == file_of(scene.source):
        return scene
    try:
        theirs = {(one.device, one.kind, one.twin) for one in read_records(home_of(scene))}
        own = read_records(file_of(scene.source))
    except ItouchError:  # a file of records that are not used: what is wrong with it is said where they are
        return scene
    kinds = {device.name: device.twin for device in scene.devices}
    lost = [one for one in own if kinds.get(one.device) == one.twin and (one.device, one.kind, one.twin) not in theirs]
    words = ", ".join(f"{one.kind} of '{one.device}'" for one in lost)
    told = (
        f"not used with this rig: {words} in {file_of(scene.source).name}, which {'is' if len(lost) == 1 else 'are'} "
        f"of the scene's own devices; itouch-py calibrate {scene.source} --rig {swapped.rig} keeps records of the rig's"
    )
    return replace(scene, swapped=replace(swapped, notes=(told,))) if lost else scene


def _strangers(scene: Scene, catalog: Catalog | None) -> Iterator[Problem]:
    """Yield a problem for each record that would be put into nothing, because a name in it is misspelt."""
    if not scene.source:
        return
    known = {device.name: device for device in scene.devices}
    paths = dict.fromkeys([home_of(scene), *(stored_in(scene, device) for device in scene.devices)])
    for path in paths:
        for record in read_records(path):
            if record.device in known:
                device = known[record.device]
                kinds = offered(device, catalog) if catalog is not None else {}
                if catalog is not None and catalog.device(device.plugin) is not None and record.kind not in kinds:
                    sentence = f"device '{device.name}' has no calibration '{record.kind}' ({path.name})"
                    advice = did_you_mean(record.kind, kinds, "it has") or "remove the record"
                    yield Problem("calibration-stale", sentence, scene.places.of(device), advice)
            elif not scene.uncertain.whole or _doubted(record.device, scene):
                continue  # it may be there once the scene is right
            elif path == home_of(scene) or meant(record.device, known):
                sentence = (
                    f"calibration '{record.kind}' is of a device '{record.device}', which the scene does not have"
                )
                advice = did_you_mean(record.device, known, "its devices are") or "the scene has no devices"
                advice += " If not, remove the record" if advice.endswith("?") else "; or remove the record"
                yield Problem("calibration-stale", sentence, Place(str(path), 1, 1), advice)


def _doubted(name: str, scene: Scene) -> bool:
    """Tell whether a device that is not in a scene may be one with a problem, as its name."""
    return not {("device", name), ("device", ""), ("", name)}.isdisjoint(scene.uncertain.unsound)


def _with(device: Any, record: CalibrationRecord) -> Any:
    if record.stale(now()):
        raise ValueError(f"it expired on {record.expires[:10]}")
    if record.early(now()):
        raise ValueError(f"it is dated {record.made[:10]}, in the future: a clock is or was wrong")
    if record.mount:
        error = _mount_error(device.mount, record.mount)
        mount = replace(device.mount, pos=record.mount[:3], quat=record.mount[3:], rpy=None, mount_error=error)
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


def _mount_error(mount: Any, found: Sequence[float]) -> Any:
    """Return how far a mount that was found is from the true one [m], which stays where it was.

    A twin without such an error is where its mount says.

    Raises
    ------
    ValueError
        If it is farther than a scene can say.
    """
    if not any(mount.mount_error):
        return mount.mount_error
    error = tuple(now - written + e for now, written, e in zip(found, mount.pos, mount.mount_error, strict=False))
    farthest = max(abs(part) for part in error)
    if farthest > FARTHEST:
        raise ValueError(
            f"its mount is {farthest * 1e3:.3g} mm from where the twin truly is (<mount mount-error>): at most "
            f"{FARTHEST * 1e3:g} mm"
        )
    return error


def _set(params: Any, names: list[str], value: float) -> Any:
    """Return parameters with one value changed, in a nested element if the name has several parts.

    Raises
    ------
    ValueError
        If there is no such parameter, or it is no single number, or cannot have this value.
    """
    name, *inside = names
    if not is_dataclass(params) or isinstance(params, type) or name not in {each.name for each in fields(params)}:
        raise ValueError(f"the device has no parameter '{name}'")
    inner = getattr(params, name)
    if not inside and not _is_single(specs(type(params)).get(name), inner):
        raise ValueError(f"its parameter '{name}' is not a single number")
    changed = replace(params, **{name: _set(inner, inside, value) if inside else value})
    validate(changed)
    return changed


def _is_single(spec: Spec | None, value: Any) -> bool:
    """Tell whether a parameter with this grammar, or without one, and with this value, is a single number."""
    if spec is not None:
        return spec.kind in ("quantity", "integer") and spec.size == 1
    return _is_number(value)


def _misfit(scene: Scene, device: Any, record: CalibrationRecord, path: Path, error: Exception) -> Problem:
    sentence = f"calibration '{record.kind}' of device '{device.name}' cannot be used: {error}"
    rig = " --rig RIG" if scene.swapped is not None and scene.swapped.rig else ""
    words = f"itouch-py calibrate SCENE{rig} --device {device.name} --extend"
    advice = f"calibrate again, or confirm that it still holds: {words}"
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
