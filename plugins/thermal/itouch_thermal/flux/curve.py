"""Recorded flux curves: CSV files with a time and a flux in each row, as a flux sensor under a finger gives them.

The first row names the columns, ``t`` and ``j`` among them, each with a unit in brackets if it is not in SI::

    t [ms],j [kW/m^2]
    0,2.1
    1,4.0

Times count from the start of the touch and ascend; fluxes are positive out of the finger.
"""

from __future__ import annotations

import csv
import io
import math
import os
import re
import stat
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import QuantityError, parse_quantity
from itouch.plugin.kernels import linked

#: Limits of a file: its size [bytes], the greatest flux [W/m2] and the latest time [s].
LARGEST_FILE, LARGEST_FLUX, LONGEST = 32 << 20, 1e6, 86400.0

Array = NDArray[np.float64]

_COLUMN = re.compile(r"\s*([A-Za-z_][A-Za-z_0-9]*)\s*(?:[\[(]\s*(.*?)\s*[\])])?\s*")
_UNITS = {"t": "s", "j": "W/m^2"}


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A flux over time: times [s], ascending, and fluxes [W/m2] out of the finger, each of shape (rows,)."""

    times: Array
    fluxes: Array

    @classmethod
    def of(cls, times: Sequence[float], fluxes: Sequence[float]) -> Curve:
        """Return a curve of at least two rows.

        Raises
        ------
        ValueError
            If there are fewer rows, the times do not ascend, or a value is not finite.
        """
        found = cls(np.array(times, np.float64), np.array(fluxes, np.float64))
        if found.times.shape != found.fluxes.shape or found.times.ndim != 1 or len(found.times) < 2:
            raise ValueError("a flux curve needs at least two times and as many fluxes")
        if not (np.isfinite(found.times).all() and np.isfinite(found.fluxes).all()):
            raise ValueError("the times and fluxes of a curve must be finite")
        if not np.all(np.diff(found.times) > 0.0):
            raise ValueError("the times of a flux curve must ascend")
        found.times.setflags(write=False)
        found.fluxes.setflags(write=False)
        return found

    def at(self, times: float | Array) -> Array:
        """Return the flux [W/m2] at times [s], same shape: linear between the rows, constant outside."""
        return np.asarray(np.interp(times, self.times, self.fluxes))


@linked
def flux_at(times: Array, fluxes: Array, first: int, end: int, time: float) -> float:
    """Return what `Curve.at` does, to the bit, of the curve in some rows of a table.

    ``times`` [s] and ``fluxes`` [W/m2], shape (rows,); the curve is in those from ``first`` up to ``end``.
    """
    if not time > times[first]:
        return float(fluxes[first])
    low, high = first, end
    while high - low > 1:  # times[low] <= time < times[high]
        middle = (low + high) // 2
        if times[middle] <= time:
            low = middle
        else:
            high = middle
    if low == end - 1 or times[low] == time:
        return float(fluxes[low])
    slope = (fluxes[low + 1] - fluxes[low]) / (times[low + 1] - times[low])
    return float(slope * (time - times[low]) + fluxes[low])


def read_curve(folder: str, name: str) -> Curve:
    """Read a curve from a folder.

    Parameters
    ----------
    folder
        The folder, inside which the file must be.
    name
        Path of the file, relative to the folder.

    Raises
    ------
    ValueError
        Naming the file, what is wrong, and the line in which it is.
    """
    path = _inside(folder, name)
    try:
        with open(path, "rb") as stream:
            mode = os.fstat(stream.fileno()).st_mode
            data = stream.read(LARGEST_FILE + 1) if stat.S_ISREG(mode) else None
    except (OSError, ValueError) as error:
        raise ValueError(f"'{name}': {getattr(error, 'strerror', None) or error}") from error
    if data is None:
        raise ValueError(f"'{name}' is not a file")
    if len(data) > LARGEST_FILE:
        raise ValueError(f"'{name}' is larger than {LARGEST_FILE >> 20} MiB")
    return decode_curve(data, name)


def decode_curve(data: bytes, name: str) -> Curve:
    """Return the curve that the content of a file holds; ``name`` is that of the file, for messages.

    Raises
    ------
    ValueError
        Naming the file, what is wrong, and the line in which it is.
    """
    try:
        return parse_curve(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise ValueError(f"'{name}' is not text: byte {error.start} is not UTF-8") from error
    except ValueError as error:
        raise ValueError(f"'{name}', {error}") from error


def _inside(folder: str, name: str) -> str:
    """Return the real path of a file in a folder."""
    if not name or "\0" in name:
        raise ValueError(f"{name!r} is not a file name")
    home = os.path.realpath(folder)
    path = os.path.realpath(os.path.join(home, name))
    if os.path.isabs(name) or os.path.commonpath([home, path]) != home:
        raise ValueError(f"'{name}' is outside the scene's folder")
    if not os.path.exists(path):
        raise ValueError(f"there is no file '{name}' in the scene's folder")
    if not os.path.isfile(path):
        raise ValueError(f"'{name}' is not a file")
    return path


def parse_curve(text: str) -> Curve:
    """Return the curve that a text holds.

    Raises
    ------
    ValueError
        Naming the line and what is wrong there.
    """
    rows = _rows(text)
    line, heading = next(rows, (1, []))
    columns = _columns(line, heading)
    times: list[float] = []
    fluxes: list[float] = []
    for line, row in rows:
        time, flux = (_cell(line, row, column, name, factor) for name, column, factor in columns)
        if not 0.0 <= time <= LONGEST:
            raise ValueError(f"line {line}: t = {time:g} s is out of range: 0 to {LONGEST:g} s")
        if abs(flux) > LARGEST_FLUX:
            raise ValueError(f"line {line}: j = {flux:g} W/m^2 is out of range: up to {LARGEST_FLUX:g} W/m^2")
        if times and time <= times[-1]:
            raise ValueError(f"line {line}: t = {time:g} s does not come after {times[-1]:g} s: times must ascend")
        times.append(time)
        fluxes.append(flux)
    if len(times) < 2:
        raise ValueError(f"line {line}: a flux curve needs at least two rows of numbers, this has {len(times)}")
    return Curve.of(times, fluxes)


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of each row that is neither empty nor a comment."""
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        for row in reader:
            if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#"):
                yield reader.line_num, row
    except csv.Error as error:
        raise ValueError(f"line {reader.line_num}: {error}") from error


def _columns(line: int, heading: Sequence[str]) -> list[tuple[str, int, float]]:
    """Return name, index and factor to SI of the columns t and j."""
    found: dict[str, tuple[int, float]] = {}
    for index, title in enumerate(heading):
        match = _COLUMN.fullmatch(title[:200])
        if match is None or match.group(1) not in _UNITS:
            continue
        name, unit = match.group(1), match.group(2)
        if name in found:
            raise ValueError(f"line {line}: there are two columns {name}")
        try:
            found[name] = (index, parse_quantity(f"1 {unit}", _UNITS[name])[0] if unit else 1.0)
        except QuantityError as error:
            raise ValueError(f"line {line}: column {name}: {error}") from error
    if set(found) != set(_UNITS):
        raise ValueError(f"line {line}: the first row must name the columns t and j, such as: t [s],j [W/m^2]")
    return [(name, *found[name]) for name in _UNITS]


def _cell(line: int, row: Sequence[str], column: int, name: str, factor: float) -> float:
    if column >= len(row) or not row[column].strip():
        raise ValueError(f"line {line}: {name} is missing")
    text = row[column].strip()
    try:
        value = math.nan if "_" in text else float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"line {line}: {name} = '{text[:40]}' is not a finite number")
    return value * factor


def format_curve(times: Iterable[float], fluxes: Iterable[float]) -> str:
    """Return a curve as the text of a CSV file, in SI with all digits."""
    rows = (f"{time:.9g},{flux!r}" for time, flux in zip(times, fluxes, strict=True))
    return "\n".join(["t,j", *rows, ""])
