"""Settings of an OpenGL context, and PNG files: what windows and off-screen pictures share."""

from __future__ import annotations

import io
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.schema import ItouchError
from itouch.schema.durable import replacing


def config() -> Any:
    """Return the settings of a context: OpenGL 3.3 core, eight bits a colour (EGL would choose fewer if not told)."""
    from pyglet import gl

    return gl.Config(
        red_size=8, green_size=8, blue_size=8, alpha_size=8, depth_size=24, double_buffer=True,
        major_version=3, minor_version=3, forward_compatible=True,
    )  # fmt: skip


def png_of(pixels: NDArray[np.uint8]) -> bytes:
    """Return a picture of shape (height, width, 3) as PNG: red, green and blue of the pixels, 0 to 255."""
    from pyglet.image import ImageData
    from pyglet.image.codecs.png import PNGImageEncoder

    height, width, _ = pixels.shape
    stream = io.BytesIO()
    image = ImageData(width, height, "RGB", pixels.tobytes(), pitch=-3 * width)
    image.save("scene.png", file=stream, encoder=PNGImageEncoder())
    return stream.getvalue()


def write_png(path: str | os.PathLike[str], pixels: NDArray[np.uint8]) -> None:
    """Write a picture of shape (height, width, 3): red, green and blue of the pixels, 0 to 255.

    Raises
    ------
    ItouchError
        If the file can't be written; an earlier one stays as it was.
    """
    picture = png_of(pixels)
    try:
        with replacing(os.fspath(path)) as new, open(new, "wb") as stream:
            stream.write(picture)
    except OSError as error:
        raise ItouchError(f"cannot write '{os.fspath(path)}': {error.strerror or error}") from error
