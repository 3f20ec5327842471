"""Height maps of textures: read from PNG, PGM or .npy, and smoothed so that they can be rendered stably."""

import io
import re

import numpy as np
from numpy.typing import NDArray

from itouch.contact.png import grey_of_png

Heights = NDArray[np.float64]

#: Largest file of a height map [bytes], and its greatest number of samples.
MAX_BYTES = 32 * 2**20
MAX_SAMPLES = 2048 * 2048
STEEPEST = 1.0  # greatest slope of a texture that is not smoothed: 45 degrees
_PGM = re.compile(rb"P([25])(?:\s+|#[^\n]*\n)+(\d{1,6})(?:\s+|#[^\n]*\n)+(\d{1,6})(?:\s+|#[^\n]*\n)+(\d{1,6})\s")


def height_map(data: bytes) -> Heights:
    """Return the values of a height map, 0 (deep) to 1 (at the surface), (rows, columns).

    PNG and PGM images give their grey values; a ``.npy`` array of floats its values, which must lie in 0 to 1; an array
    of integers its values divided by the greatest of its type.

    Raises
    ------
    ValueError
        If it is too large, of another format, damaged, or holds values outside 0 to 1.
    """
    if data.startswith(b"\x89PNG"):
        values = grey_of_png(data, MAX_SAMPLES)
    elif data[:2] in (b"P2", b"P5"):
        values = _pgm(data)
    elif data.startswith(b"\x93NUMPY"):
        values = _npy(data)
    else:
        raise ValueError("it is neither PNG, PGM nor .npy")
    return np.ascontiguousarray(values)


def _pgm(data: bytes) -> Heights:
    head = _PGM.match(data)
    if head is None:
        raise ValueError("its PGM header is damaged")
    columns, rows, most = (int(head[i]) for i in (2, 3, 4))
    if not (1 <= columns * rows <= MAX_SAMPLES and 1 <= most <= 65535):
        raise ValueError(
            f"it has {columns} x {rows} samples up to {most}; at most {MAX_SAMPLES} up to 65535 are allowed"
        )
    if head[1] == b"5":
        kind = np.dtype(">u2" if most > 255 else "u1")
        body = data[head.end() : head.end() + rows * columns * kind.itemsize]
        values = np.frombuffer(body[: len(body) // kind.itemsize * kind.itemsize], kind).astype(np.float64)
    else:
        words = data[head.end() :].split()
        if not all(word.isdigit() for word in words):
            raise ValueError("its samples are not whole numbers")
        values = np.array([int(word) for word in words[: rows * columns]], np.float64)
    if len(values) != rows * columns:
        raise ValueError(f"it has {len(values)} samples in place of {rows * columns}")
    return _in_range(values.reshape(rows, columns) / most)


def _npy(data: bytes) -> Heights:
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise ValueError(f"its array cannot be read ({error})") from None
    if array.ndim != 2 or not 1 <= array.size <= MAX_SAMPLES:
        raise ValueError(f"its array has the shape {array.shape}; it must be (rows, columns) with 1 to {MAX_SAMPLES}")
    if np.issubdtype(array.dtype, np.integer):
        return _in_range(array / float(np.iinfo(array.dtype).max))
    if not np.issubdtype(array.dtype, np.floating):
        raise ValueError(f"its array holds {array.dtype}; it must hold numbers")
    return _in_range(array.astype(np.float64))


def _in_range(values: Heights) -> Heights:
    if not (np.isfinite(values).all() and values.min() >= 0.0 and values.max() <= 1.0):
        raise ValueError("its values must lie in 0 to 1")
    return np.asarray(values, np.float64)


def gentle(values: Heights, depth: float, pitch: float) -> tuple[Heights, int]:
    """Smooth a map until its surface is nowhere steeper than STEEPEST, with a window of [1 2 1] / 4 in both directions.

    The map repeats, so opposite edges are treated as neighbours.  A loop at 1 kHz cannot render steeper flanks.

    Parameters
    ----------
    values
        Heights as parts of the depth, 0 to 1, shape (rows, columns).
    depth, pitch
        The depth that a height of 1 stands for [m], and the distance between neighbouring samples [m].

    Returns
    -------
    tuple
        The map, and how many passes it took.
    """
    for passes in range(4096):
        steepest = max(float(np.abs(np.diff(values, axis=a, append=np.take(values, [0], a))).max()) for a in (0, 1))
        if steepest * depth <= STEEPEST * pitch:
            return values, passes
        for axis in (0, 1):
            values = (np.roll(values, 1, axis) + 2.0 * values + np.roll(values, -1, axis)) / 4.0
    return np.full_like(values, values.mean()), passes
