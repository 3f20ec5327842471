"""The grey values of a PNG file (ISO/IEC 15948), for height maps: grey, colour or palette, 1 to 16 bits a sample."""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_DEPTHS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def grey_of_png(data: bytes, most: int) -> NDArray[np.float64]:
    """Return the values 0 (black) to 1 (white) of a PNG, (rows, columns).

    Raises
    ------
    ValueError
        If it is no PNG, damaged, interlaced, or has more than ``most`` samples.
    """
    if not data.startswith(_SIGNATURE):
        raise ValueError("it is not a PNG image")
    parts = _chunks(data)
    head = parts.get(b"IHDR", b"")
    if len(head) != 13:
        raise ValueError("it has no image header")
    columns, rows, depth, colour, packing, filtering, interlaced = struct.unpack(">IIBBBBB", head)
    if colour not in _CHANNELS or depth not in _DEPTHS[colour] or packing or filtering:
        raise ValueError(f"its colour type {colour} with {depth} bits is not one of PNG")
    if interlaced:
        raise ValueError("it is interlaced; save it without interlacing")
    if rows < 1 or columns < 1 or rows * columns > most:
        raise ValueError(f"it has {columns} x {rows} samples; it must have 1 to {most}")
    width = (columns * _CHANNELS[colour] * depth + 7) // 8
    lines = _unfiltered(
        _inflated(parts.get(b"IDAT", b""), rows * (width + 1)), rows, width, max(1, _CHANNELS[colour] * depth // 8)
    )
    values = _unpacked(lines, columns * _CHANNELS[colour], depth).reshape(rows, columns, -1)
    if colour == 3:
        palette = np.frombuffer(parts.get(b"PLTE", b""), np.uint8)
        index = values[:, :, 0].astype(np.intp)
        if len(palette) % 3 or index.max() >= len(palette) // 3:
            raise ValueError("its palette is damaged")
        return np.asarray(palette.reshape(-1, 3)[index] @ _LUMINANCE / 255.0)
    scaled = values / float(2**depth - 1)
    return np.asarray(scaled[:, :, :3] @ _LUMINANCE if colour in (2, 6) else scaled[:, :, 0])


def _chunks(data: bytes) -> dict[bytes, bytes]:
    parts: dict[bytes, list[bytes]] = {}
    place = len(_SIGNATURE)
    while place + 12 <= len(data):
        length, kind = struct.unpack(">I4s", data[place : place + 8])
        body = data[place + 8 : place + 8 + length]
        if len(body) != length or place + 12 + length > len(data):
            raise ValueError("it ends in the middle of a part")
        (check,) = struct.unpack(">I", data[place + 8 + length : place + 12 + length])
        if zlib.crc32(kind + body) != check:
            raise ValueError(f"its part {kind.decode('latin-1')!r} is damaged")
        parts.setdefault(kind, []).append(body)
        place += 12 + length
        if kind == b"IEND":
            break
    return {kind: b"".join(bodies) for kind, bodies in parts.items()}


def _inflated(data: bytes, size: int) -> bytes:
    """Unpack exactly ``size`` bytes; a file cannot make us unpack more."""
    inflater = zlib.decompressobj()
    try:
        unpacked = inflater.decompress(data, size)
    except zlib.error as error:
        raise ValueError(f"its samples are damaged ({error})") from None
    if len(unpacked) != size or inflater.unconsumed_tail:
        raise ValueError("it has too few samples" if len(unpacked) != size else "it has too many samples")
    return unpacked


def _unfiltered(data: bytes, rows: int, width: int, step: int) -> NDArray[np.uint8]:
    """Undo the filters of the lines (section 9 of the standard)."""
    raw = np.frombuffer(data, np.uint8).reshape(rows, width + 1)
    out = np.zeros((rows + 1, width + step), np.uint8)
    for r in range(rows):
        kind, line, above = int(raw[r, 0]), raw[r, 1:], out[r]
        here = out[r + 1]
        if kind == 0:
            here[step:] = line
        elif kind == 2:
            here[step:] = line + above[step:]
        elif kind in (1, 3, 4):
            _sequential(kind, line, above, here, step)
        else:
            raise ValueError(f"line {r} has the unknown filter {kind}")
    return out[1:, step:]


def _sequential(
    kind: int, line: NDArray[np.uint8], above: NDArray[np.uint8], here: NDArray[np.uint8], step: int
) -> None:
    """Undo the filters that use the sample to the left."""
    source, up, done = line.tolist(), above.tolist(), here.tolist()
    for i, value in enumerate(source):
        left, over, corner = done[i], up[i + step], up[i]
        if kind == 1:
            guess = left
        elif kind == 3:
            guess = (left + over) // 2
        else:
            estimate = left + over - corner
            near = (abs(estimate - left), abs(estimate - over), abs(estimate - corner))
            guess = left if near[0] <= near[1] and near[0] <= near[2] else (over if near[1] <= near[2] else corner)
        done[i + step] = (value + guess) & 255
    here[:] = done


def _unpacked(lines: NDArray[np.uint8], count: int, depth: int) -> NDArray[np.float64]:
    if depth == 16:
        return np.asarray(lines.reshape(len(lines), -1, 2).astype(np.float64) @ np.array([256.0, 1.0]))
    if depth == 8:
        return lines.astype(np.float64)
    bits = np.unpackbits(lines, axis=1).reshape(len(lines), -1, depth)
    return np.asarray(bits @ (2.0 ** np.arange(depth - 1, -1, -1)))[:, :count]
