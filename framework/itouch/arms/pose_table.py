"""Poses over time, along which a recorded arm moves: from a recording, a text table, or a built-in example."""

from __future__ import annotations

import csv
import io
import re

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import ParameterError, Role
from itouch.recording.reader import parse, unread
from itouch.recording.recording_error import RecordingError
from itouch.recording.tracks import Track
from itouch.schema.diagnostics import did_you_mean

Motion = tuple[list[float], NDArray[np.float64]]
#: Longest table [rows].
MOST_ROWS = 4_000_000
_PLACE, _TURN = ("x", "y", "z"), ("qw", "qx", "qy", "qz")
_SCALES = {"": 1.0, "m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "s": 1.0, "ms": 1e-3}
_LENGTHS = ("m", "mm", "cm", "um")
#: Parts of State names that mark commands and a twin's true values.
_TOLD = {"command", "sent", "out", "twin"}
#: The framework's name for the position of a recorded probe.
_HIP = "hip"
_LABEL = re.compile(r"^(?P<name>[^\[]*?)\s*(?:\[(?P<unit>[^\]]*)\])?$")


def example() -> Motion:
    """Return four seconds of a finger that moves down by 30 mm, strokes sideways by 20 mm, and moves up again."""
    times = np.arange(401, dtype=np.float64) * 0.01
    down, along, up = (_blend(times, begin) for begin in (0.4, 1.6, 2.8))
    poses = np.zeros((len(times), 7))
    poses[:, 0], poses[:, 2], poses[:, 3] = 0.02 * along, 0.05 - 0.03 * down + 0.03 * up, 1.0
    return times.tolist(), poses


def _blend(times: NDArray[np.float64], begin: float) -> NDArray[np.float64]:
    """Minimum jerk from 0 to 1 within 0.8 s after ``begin`` (Flash and Hogan 1985)."""
    s: NDArray[np.float64] = np.clip((times - begin) / 0.8, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 + s * (6.0 * s - 15.0)), np.float64)


def from_recording(name: str, data: bytes, track: str) -> Motion:
    """Return the poses of a recorded device, or the positions of a recorded probe.

    Raises
    ------
    ParameterError
        If the recording cannot be read or has no such track; names the tracks that it has.
    """
    try:
        content = parse(name, data, len(data))
    except RecordingError as error:
        raise ParameterError("file", str(error)) from error
    poses = {key: _named_by(content.tracks[key], Role.TRACKED_POSE) for key, rows in content.rows.items() if len(rows)}
    columns = {
        key: pose or (_HIP if _HIP in (content.rows[key].dtype.names or ()) else "") for key, pose in poses.items()
    }
    known = sorted(key for key, column in columns.items() if column)
    damage = unread(content, f"no pose of '{track}'" if track else "no pose")
    if damage and (not known or (track and track not in known)):
        raise ParameterError("file", f"{damage[0]}; {damage[1]}")
    if not known:
        raise ParameterError("file", f"'{name}' has recorded no pose of a device or place of a probe")
    if track and track not in known:
        advice = did_you_mean(track, known, "it has")
        raise ParameterError("track", f"'{name}' has recorded no pose of '{track}'; {advice}")
    if not track:
        posed = [key for key in known if poses[key]] or known
        if len(posed) > 1:
            raise ParameterError(
                "track", f"'{name}' has several poses ({', '.join(posed)}): write track=\"{posed[0]}\""
            )
        track = posed[0]
    rows = content.rows[track]
    values = np.asarray(rows[columns[track]], np.float64).reshape(len(rows), -1)
    return checked(np.asarray(rows["time"], np.float64), values)


def _named_by(track: Track, role: Role) -> str:
    return next((column.name for column in track.columns if column.role is role), "")


def from_csv(data: bytes) -> Motion:
    """Return the poses of a text table; see ``read_columns``. Raises ValueError if it is none."""
    table = read_columns(data)
    return checked(table[:, 0], table[:, 1:])


def read_columns(data: bytes) -> NDArray[np.float64]:
    """Return a text table as (rows, 4) or (rows, 8): t [s], x y z [m], and the quaternion w x y z as it stands there.

    Columns are named as ``itouch-py export`` writes them: ``time [s]``, and the only quantity with the parts
    ``.x [m]``, ``.y [m]``, ``.z [m]`` and perhaps ``.qw`` ... ``.qz`` (commands and the like are ignored); or
    ``t, x, y, z`` and perhaps ``qw, qx, qy, qz``; columns without names are in this order.

    Raises
    ------
    ValueError
        If the table is not of this form; says what is missing.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("it is not text") from None
    try:
        rows = [
            row for row in csv.reader(io.StringIO(text, newline=None)) if row and not row[0].lstrip().startswith("#")
        ]
    except csv.Error as error:
        raise ValueError(f"it is not a table ({error})") from None
    if not rows:
        raise ValueError("it has no rows")
    if len(rows) > MOST_ROWS:
        raise ValueError(f"it has more than {MOST_ROWS} rows")
    if _is_number(rows[0][0]):
        columns = [(index, 1.0) for index in range(len(rows[0]))]
        if len(columns) not in (4, 8):
            raise ValueError(
                f"without names it must have 4 columns (t x y z) or 8 (with qw qx qy qz), not {len(columns)}"
            )
    else:
        columns, rows = _named(rows[0]), rows[1:]
    table = np.array([_numbers(row, columns, index) for index, row in enumerate(rows, 1)], np.float64)
    return table.reshape(len(rows), len(columns))


def _named(header: list[str]) -> list[tuple[int, float]]:
    """Return index and scale to SI of the columns of time, position and, if there is one, quaternion."""
    found: dict[str, tuple[int, float]] = {}
    labels = [_LABEL.match(label.strip()) for label in header]
    placed = _placed([(match["name"], match["unit"] or "") for match in labels if match is not None])
    for index, (label, match) in enumerate(zip(header, labels, strict=True)):
        if match is None:
            continue
        name, unit = match["name"], match["unit"] or ""
        owner, _, part = name.rpartition(".")
        short = {"time": "t"}.get(name, part if owner in placed else name)
        if short in ("t", *_PLACE, *_TURN):
            if unit not in _SCALES:
                raise ValueError(f"the unit of column '{label}' is not known: write m, mm, s or ms")
            if short in found and short != "t":
                raise ValueError(
                    f"it has several columns of {short} ({header[found[short][0]]}, {label}): keep those of one"
                )
            found.setdefault(short, (index, _SCALES[unit]))
    missing = [name for name in ("t", *_PLACE) if name not in found]
    if missing:
        raise ValueError(f"it has no column named {', '.join(missing)}; it has {', '.join(header)[:120]}")
    turns = [name for name in _TURN if name in found]
    if turns and len(turns) < 4:
        raise ValueError(f"of the quaternion it has only {', '.join(turns)}")
    return [found[name] for name in ("t", *_PLACE, *turns)]


def _placed(columns: list[tuple[str, str]]) -> set[str]:
    """Return the quantities that are positions in a unit of length (else without a unit), of readings and probes."""
    parts: dict[str, dict[str, str]] = {}
    for name, unit in columns:
        owner, _, part = name.rpartition(".")
        if owner and not _TOLD & set(owner.split(".")):
            parts.setdefault(owner, {})[part] = unit
    whole = {owner: units for owner, units in parts.items() if set(_PLACE) <= units.keys()}
    lengths = {owner for owner, units in whole.items() if all(units[one] in _LENGTHS for one in _PLACE)}
    return lengths or {owner for owner, units in whole.items() if not any(units[one] for one in _PLACE)}


def _numbers(row: list[str], columns: list[tuple[int, float]], index: int) -> list[float]:
    try:
        return [_number(row[column]) * scale for column, scale in columns]
    except (ValueError, IndexError):
        raise ValueError(f"row {index} is not {len(columns)} numbers: {','.join(row)[:60]}") from None


def _number(word: str) -> float:
    """Return a word as a number; raises ValueError if it is none, ``1_0`` too, which Python takes for ten."""
    if "_" in word:
        raise ValueError(word)
    return float(word)


def _is_number(word: str) -> bool:
    try:
        _number(word)
    except ValueError:
        return False
    return True


def checked(times: NDArray[np.float64], values: NDArray[np.float64]) -> Motion:
    """Return a motion from times [s] and positions (n, 3) or poses (n, 7) [m; quaternion]; its times begin at 0.

    Raises
    ------
    ValueError
        If there are fewer than two rows, times do not increase, a number is not finite, or a quaternion is zero.
    """
    if len(times) < 2:
        raise ValueError(f"it has {len(times)} rows; a motion has two at least")
    with np.errstate(over="ignore", invalid="ignore"):
        good = np.isfinite(values).all(axis=1) & np.isfinite(times - times[0])
    if not good.all():
        raise ValueError(f"row {int(np.argmin(good)) + 1} holds a value that is not a finite number")
    late = np.diff(times) <= 0.0
    if late.any():
        raise ValueError(f"the time does not rise after row {int(np.argmax(late)) + 1}")
    poses = np.zeros((len(times), 7))
    poses[:, :3], poses[:, 3] = values[:, :3], 1.0
    if values.shape[1] >= 7:
        size = np.linalg.norm(values[:, 3:7], axis=1)
        if (size < 1e-6).any():
            raise ValueError(f"the quaternion of row {int(np.argmax(size < 1e-6)) + 1} is zero")
        poses[:, 3:] = values[:, 3:7] / size[:, None]
    poses.setflags(write=False)
    return (times - times[0]).tolist(), poses
