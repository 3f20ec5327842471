"""Height maps: the three file formats, what is refused, and how steep ones are smoothed."""

import io
import struct
import zlib

import numpy as np
import pytest

from itouch.contact.heightmap import STEEPEST, gentle, height_map
from itouch.contact.png import grey_of_png


def png(
    lines: bytes, columns: int, rows: int, depth: int, colour: int, palette: bytes = b"", interlaced: int = 0
) -> bytes:
    def part(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", columns, rows, depth, colour, 0, 0, interlaced)
    return (
        b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head) + (part(b"PLTE", palette) if palette else b"")
        + part(b"IDAT", zlib.compress(lines)) + part(b"IEND", b"")
    )  # fmt: skip


def test_png_of_every_kind_as_another_program_reads_it(rng: np.random.Generator) -> None:
    from PIL import Image  # comes with matplotlib

    grey = rng.integers(0, 256, (13, 17), dtype=np.uint8)
    smooth = np.add.outer(np.arange(40), np.arange(30)).astype(np.uint8) * 3
    for array, mode in ((grey, "L"), (smooth, "L"), (np.stack([grey, grey // 2, 255 - grey], 2), "RGB")):
        buffer = io.BytesIO()
        Image.fromarray(array, mode).save(buffer, "PNG")
        wanted = array / 255.0 if array.ndim == 2 else array @ [0.2126, 0.7152, 0.0722] / 255.0
        np.testing.assert_allclose(height_map(buffer.getvalue()), wanted, atol=1e-12)


@pytest.mark.parametrize("kind", range(5))
def test_each_filter_of_png(kind: int, rng: np.random.Generator) -> None:
    values = rng.integers(0, 256, (6, 9)).astype(int)
    above = np.vstack([np.zeros((1, 9), int), values[:-1]])
    left = np.hstack([np.zeros((6, 1), int), values[:, :-1]])
    corner = np.hstack([np.zeros((6, 1), int), above[:, :-1]])
    estimate = left + above - corner
    near = np.stack([abs(estimate - left), abs(estimate - above), abs(estimate - corner)])
    paeth = np.choose(np.argmin(near, axis=0), [left, above, corner])
    guess = [0 * values, left, above, (left + above) // 2, paeth][kind]
    lines = np.hstack([np.full((6, 1), kind), (values - guess) % 256]).astype(np.uint8).tobytes()
    np.testing.assert_allclose(grey_of_png(png(lines, 9, 6, 8, 0), 100), values / 255)


def test_png_with_few_or_many_bits_and_with_a_palette() -> None:
    np.testing.assert_array_equal(grey_of_png(png(b"\0\xa0\0\x40", 3, 2, 1, 0), 9), [[1, 0, 1], [0, 1, 0]])
    np.testing.assert_allclose(grey_of_png(png(b"\0\x80\x00\xff\xff", 2, 1, 16, 0), 9), [[32768 / 65535, 1]])
    coloured = png(b"\0\x01\x00", 2, 1, 8, 3, b"\0\0\0\xff\xff\xff")
    np.testing.assert_allclose(grey_of_png(coloured, 9), [[1, 0]], atol=1e-12)


def test_pgm_and_npy() -> None:
    np.testing.assert_allclose(height_map(b"P2\n# a comment\n2 2\n4\n0 1\n2 4\n"), [[0, 0.25], [0.5, 1]])
    np.testing.assert_allclose(height_map(b"P5 3 1 255\n\x00\x33\xff"), [[0, 0.2, 1]])
    buffer = io.BytesIO()
    np.save(buffer, np.array([[0.0, 0.5], [1.0, 0.25]], np.float32))
    np.testing.assert_array_equal(height_map(buffer.getvalue()), [[0, 0.5], [1, 0.25]])


def npy(array: object) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    return buffer.getvalue()


BAD = {
    "text": (b"not an image", "neither PNG"),
    "empty": (b"", "neither PNG"),
    "cut png": (png(b"\0\0\0", 2, 1, 8, 0)[:-20], "middle|few"),
    "broken png": (png(b"\0\0\0", 2, 1, 8, 0).replace(b"IDAT", b"IDAX"), "damaged"),
    "huge png": (png(b"\0", 60000, 60000, 8, 0), "samples"),
    "bomb": (png(b"\0" * 10**6, 4, 4, 8, 0), "too many"),
    "interlaced": (png(b"\0\0\0", 2, 1, 8, 0, interlaced=1), "interlaced"),
    "strange filter": (png(b"\x09\0\0", 2, 1, 8, 0), "filter"),
    "palette": (png(b"\0\x05\0", 2, 1, 8, 3, b"\0\0\0"), "palette"),
    "pgm header": (b"P5 x 3 255\n", "header"),
    "pgm short": (b"P5 3 3 255\n\x00", "in place of"),
    "pgm huge": (b"P5 99999 99999 255\n\x00", "samples"),
    "pgm words": (b"P2 2 1 255\n1 x", "whole numbers"),
    "npy of objects": (npy(np.array([[{}]], dtype=object)), "cannot be read"),
    "npy of nan": (npy(np.array([[np.nan, 0.0]])), "0 to 1"),
    "npy beyond": (npy(np.array([[1.5, 0.0]])), "0 to 1"),
    "npy row": (npy(np.zeros(3)), "shape"),
    "npy text": (npy(np.array([["a"]])), "numbers"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_with_a_reason(name: str) -> None:
    data, reason = BAD[name]
    with pytest.raises(ValueError, match=reason):
        height_map(data)


def test_steep_maps_are_smoothed_until_they_can_be_rendered(rng: np.random.Generator) -> None:
    values = rng.random((32, 32))
    smooth, passes = gentle(values, 1e-3, 2e-4)
    assert passes > 0
    assert smooth.mean() == pytest.approx(values.mean())
    steepest = max(np.abs(smooth - np.roll(smooth, 1, axis)).max() for axis in (0, 1))
    assert steepest * 1e-3 <= 2e-4 * (1 + 1e-12)
    assert gentle(values, 1e-5, 2e-4) == (pytest.approx(values), 0) or gentle(values, 1e-5, 2e-4)[1] == 0


@pytest.mark.parametrize("axis", [0, 1])
def test_a_flank_in_either_direction_is_smoothed(axis: int) -> None:
    values = np.zeros((8, 8))
    values[(slice(0, 4), slice(None)) if axis == 0 else (slice(None), slice(0, 4))] = 1.0
    smooth, passes = gentle(values, 1e-3, 2e-4)
    assert passes > 0
    assert np.abs(np.diff(smooth, axis=axis)).max() * 1e-3 <= STEEPEST * 2e-4 * (1.0 + 1e-9)


def test_a_map_that_is_turned_is_smoothed_as_much(rng: np.random.Generator) -> None:
    values = np.zeros((12, 8))
    values[3:7] = 1.0  # steep along one axis only
    values += 1e-3 * rng.random((12, 8))
    smooth, passes = gentle(values, 1e-3, 2e-4)
    turned, as_many = gentle(values.T, 1e-3, 2e-4)
    assert passes == as_many > 0 and turned == pytest.approx(smooth.T, abs=1e-12)
