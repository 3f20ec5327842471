"""Reads the touches written by ``measure touch --raw``."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from itouch_thermal.display.column import Array
from itouch_thermal.film.film_params import FilmParams
from itouch_thermal.identify.fit import Problem, edges_for
from itouch_thermal.identify.forward import Known

#: Depth of a known sample [m]; least number of samples of a touch, and greatest file size [bytes].
DEPTH, FEWEST, LARGEST = 0.02, 50, 32 << 20
#: After this many time constants of the skin's flattening, a touch looks like one that began later.
_SETTLED = 16.0
#: Steps between two readings that are a hole: longer than both this many usual ones and this part of the time.
_HOLE = (10.0, 0.05)
#: Entries that a header must have, and that it may have, with their plausible ranges.
_HEAD = {
    "skin [degC]": (0.0, 50.0), "room [degC]": (-20.0, 60.0), "force [N]": (0.01, 1000.0),
    "capacity [J/m2K]": (0.0, 1e4),
}  # fmt: skip
_LAG, _RESISTANCE = "lag [s]", "film resistance [m2K/W]"
_MAY = {_LAG: (0.0, 2.0), _RESISTANCE: (1e-7, 1e-2)}


@dataclass(frozen=True, slots=True, eq=False)
class Loaded:
    """Touches at common times [s], shape (n,), with readings [W/m2], shape (touches, n)."""

    known: Known
    times: Array
    readings: Array
    who: str
    what: str
    lag: float | None = None
    #: Name of the file that ends first.
    shortest: str = ""


def load(paths: list[Path]) -> Loaded:
    """Read files, and all files of folders.

    Raises
    ------
    ValueError
        If a file is wrong, or holds the touch of another one; the message names it and what is wrong.
    """
    files = [file for path in paths for file in (sorted(path.glob("*.csv")) if path.is_dir() else [path])]
    if not files:
        raise ValueError(
            f"no touches in {', '.join(map(str, paths))}: `itouch-py measure touch --raw FOLDER` writes them"
        )
    found = [_one(file) for file in files]
    period = min(float(np.median(np.diff(times))) for _, times, _ in found)
    last, shortest = min((float(times[-1]), str(file)) for file, (_, times, _) in zip(files, found, strict=True))
    times: Array = np.arange(1, int(last / period) + 1, dtype=np.float64) * period
    readings = np.stack([np.interp(times, own, rows) for _, own, rows in found])
    heads = [head for head, _, _ in found]
    whats = {str(head["what"]) for head in heads}
    if len(whats) > 1:
        raise ValueError(f"these touches are of several samples ({', '.join(sorted(whats))}): give those of one")
    people = sorted({head.get("who", "") for head in heads} - {""})
    if len(people) > 1:
        raise ValueError(f"these touches are of several people ({', '.join(people)}): give those of one")
    _check_each_once(files, [rows for _, _, rows in found])
    middle = {key: float(np.mean([float(head[key]) for head in heads])) for key in _HEAD}
    film = None
    if middle["capacity [J/m2K]"] > 0.0:
        resistance = _mean_of(heads, _RESISTANCE) or FilmParams().film_resistance
        film = FilmParams(film_capacity=middle["capacity [J/m2K]"], film_resistance=resistance).film
    known = Known(
        middle["skin [degC]"] + 273.15, middle["room [degC]"] + 273.15, film,
        tuple(float(head["force [N]"]) for head in heads), DEPTH,
    )  # fmt: skip
    return Loaded(known, times, readings, str(heads[0].get("who", "")), whats.pop(), _mean_of(heads, _LAG), shortest)


def _check_each_once(files: list[Path], readings: list[Array]) -> None:
    """Check that no touch is given twice: its noise would count as if it were independent of itself."""
    before: dict[bytes, Path] = {}
    for file, rows in zip(files, readings, strict=True):
        other = before.setdefault(rows.tobytes(), file)
        if other is not file:
            raise ValueError(f"'{other}' and '{file}' have the same readings: give each touch once, as the intervals "
                             f"would be too narrow")  # fmt: skip


def _mean_of(heads: list[dict[str, str]], key: str) -> float | None:
    """Return the mean of a number in the headers; None if one lacks it, or has 0, which means unknown."""
    found = [float(head.get(key, "0")) for head in heads]
    return float(np.mean(found)) if min(found) > 0.0 else None


def _one(file: Path) -> tuple[dict[str, str], Array, Array]:
    if not file.is_file() and file.exists():
        raise ValueError(f"'{file}' is a pipe, a device or a socket, not a file")
    if file.stat().st_size > LARGEST:
        raise ValueError(f"'{file}' is larger than {LARGEST >> 20} MiB")
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"'{file}' is not a raw touch: it is not UTF-8 text") from error
    pairs = (line[2:].partition(": ") for line in lines if line.startswith("# "))
    head = {key: value for key, _, value in pairs}
    head.setdefault("what", "")
    for key, (low, high) in (_HEAD | {key: of for key, of in _MAY.items() if key in head}).items():
        try:
            value = float(head[key])
        except (KeyError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            raise ValueError(f"'{file}' is not a raw touch: its header has no number '{key}'")
        if not low <= value <= high:
            raise ValueError(f"'{file}': {key} is {value:g}, out of range: {low:g} to {high:g}")
    return head, *_rows(file, lines)


def _rows(file: Path, lines: list[str]) -> tuple[Array, Array]:
    """Return the times [s] and readings [W/m2] in a file."""
    try:
        rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    except csv.Error as error:
        raise ValueError(f"'{file}' is not a raw touch: {error}") from error
    if not rows or rows[0][:2] != ["t [s]", "j [W/m^2]"] or len(rows) <= FEWEST:
        raise ValueError(f"'{file}' is not a raw touch: it needs columns t [s],j [W/m^2] and more than {FEWEST} rows")
    for number, row in enumerate(rows[1:], 1):
        if len(row) < 2:
            raise ValueError(f"'{file}': row {number} has {len(row)} cells; a time and a flux are needed")
        if len(row) != len(rows[0]):
            raise ValueError(
                f"'{file}': row {number} has {len(row)} cells, and the heading {len(rows[0])}: the file was cut off or "
                f"damaged; copy it again, or remove the row"
            )
    try:
        values = np.array([[float(cell) for cell in row[:2]] for row in rows[1:]])
    except ValueError as error:
        raise ValueError(f"'{file}': {error}") from error
    if not np.isfinite(values).all() or not np.all(np.diff(values[:, 0]) > 0.0):
        raise ValueError(f"'{file}': times must ascend, and all numbers be finite")
    _check_holes(file, values[:, 0])
    return values[:, 0].copy(), values[:, 1].copy()


def _check_holes(file: Path, times: Array) -> None:
    """Check that readings at times [s] are so dense that a line between two of them is the flux."""
    steps = np.diff(times)
    hole = steps > np.maximum(_HOLE[0] * np.median(steps), _HOLE[1] * times[1:])
    if hole.any():
        first = int(np.argmax(hole))
        raise ValueError(
            f"'{file}': there is no reading from {times[first]:g} to {times[first + 1]:g} s: leave this touch out, or "
            f"measure it again"
        )


def problem_of(loaded: Loaded, sample: str, *, press: float, noise: float) -> Problem:
    """Return the fit's problem for touches.

    Raises
    ------
    ValueError
        If the material is unknown, a number is out of range, or the touches are too short.
    """
    from itouch_thermal.rendering.materials import material

    if not (0.0 <= press <= 1.0 and 0.0 < noise < 1e4):
        raise ValueError(f"--press {press:g} must be 0 to 1 s, and --noise {noise:g} more than 0 W/m2")
    layer = material(sample)[1].layer(loaded.known.depth) if sample else None
    first = max(0.05, _SETTLED * press)
    if loaded.times[-1] < 2.0 * first:
        raise ValueError(
            f"the touches last {loaded.times[-1]:.2f} s, as '{loaded.shortest}' does; {2.0 * first:.2f} s are needed, "
            f"or a smaller --press"
        )
    known = replace(loaded.known, sample=layer, delay=press)
    return Problem(known, loaded.times, loaded.readings, noise, edges_for(loaded.times, first=first), loaded.lag)
