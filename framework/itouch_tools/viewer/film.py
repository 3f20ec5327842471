"""Pictures of a run on the virtual clock: one at a chosen time, or a film of all of it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.schema import ItouchError
from itouch.schema.durable import replacing
from itouch.world import Model
from itouch_tools.viewer import colours
from itouch_tools.viewer.context import write_png
from itouch_tools.viewer.offscreen import Offscreen
from itouch_tools.viewer.overlay import SessionStatus

#: Frames per second of simulated time.
MP4_RATE, GIF_RATE = 25.0, 10.0
#: Colours that may first appear after a film's first picture: of curves, marks and temperatures, lit and in shade.
_FIXED = tuple(
    tuple(round(255 * min(1.0, share * part)) for part in colour)
    for colour in (
        *colours.CURVES,
        colours.FORCE,
        colours.HIP,
        *(colours.of_temperature(k) for k in range(288, 314, 3)),
    )
    for share in (1.0, 0.75, 0.5)
)
_ADVICE = "films need two more packages: pip install 'itouch-py[film]'"

Pixels = NDArray[np.uint8]


class Sink(Protocol):
    """Takes the frames of a film, one after the other."""

    rate: float

    def add(self, pixels: Pixels) -> None:
        """Take the next frame, shape (height, width, 3): red, green and blue of the pixels, 0 to 255."""

    def close(self) -> None:
        """Finish the file."""


class Mp4:
    """A film in H.264, through PyAV."""

    rate = MP4_RATE

    def __init__(self, path: str) -> None:
        try:
            import av
        except ImportError:
            raise ItouchError(_ADVICE) from None
        self._av = av
        self._stream: Any = None
        self._failed: OSError | None = None
        with contextlib.ExitStack() as whole:
            part = whole.enter_context(replacing(path))
            self._file = av.open(part, "w", format="mp4", options={"movflags": "+faststart"})
            self._whole = whole.pop_all()  # an earlier film stays until this one is complete

    def add(self, pixels: Pixels) -> None:
        """Take the next frame, shape (height, width, 3): red, green and blue of the pixels, 0 to 255."""
        if self._stream is None:
            self._stream = self._file.add_stream("libx264", rate=round(self.rate), options={"crf": "21"})
            self._stream.height, self._stream.width = pixels.shape[:2]
            self._stream.pix_fmt = "yuv420p"
        frame = self._av.VideoFrame.from_ndarray(pixels, format="rgb24")
        try:
            self._file.mux(self._stream.encode(frame))
        except OSError as error:  # a film with a gap must not take the place of an earlier one
            self._failed = self._failed or error
            raise

    def close(self) -> None:
        """Finish the file."""
        with self._whole:
            try:
                try:
                    if self._stream is not None:
                        self._file.mux(self._stream.encode(None))
                finally:
                    self._file.close()
            except OSError as error:
                self._failed = self._failed or error
            if self._failed is not None:  # PyAV's own error can be given no name of a file
                raise OSError(self._failed.errno, self._failed.strerror) from self._failed


class Gif:
    """An animated picture with one palette of 128 colours, through Pillow; only what changes is stored."""

    rate = GIF_RATE

    def __init__(self, path: str) -> None:
        try:
            from PIL import Image
        except ImportError:
            raise ItouchError(_ADVICE) from None
        self._image, self._path = Image, path
        self._frames: list[Any] = []
        self._palette: Any = None

    def add(self, pixels: Pixels) -> None:
        """Take the next frame, shape (height, width, 3): red, green and blue of the pixels, 0 to 255."""
        picture = self._image.fromarray(pixels)
        if not self._frames:
            self._palette = self._image.new("P", (1, 1))
            seen = picture.quantize(256 - len(_FIXED), dither=self._image.Dither.NONE).getpalette() or []
            self._palette.putpalette(seen[: 3 * (256 - len(_FIXED))] + [part for colour in _FIXED for part in colour])
        self._frames.append(picture.quantize(palette=self._palette, dither=self._image.Dither.NONE))

    def close(self) -> None:
        """Finish the file."""
        if self._frames:
            first, *rest = self._frames
            with replacing(self._path) as new:
                first.save(new, format="gif", save_all=True, append_images=rest, duration=round(1000 / self.rate),
                           loop=0, optimize=True)  # fmt: skip


def sink(path: str) -> Sink:
    """Return the sink that writes a film to a file, in the format that the name's ending says.

    Raises
    ------
    ItouchError
        If the ending is not .mp4 or .gif, the file can't be written, or a package is missing.
    """
    ending = Path(path).suffix.lower()
    if ending not in (".mp4", ".gif"):
        raise ItouchError(f"--film {path}: a film's name ends in .mp4 or .gif")
    try:
        return Mp4(path) if ending == ".mp4" else Gif(path)
    except OSError as error:
        raise ItouchError(f"cannot write '{path}': {error.strerror or error}") from error


class Filming:
    """Takes pictures while a session runs; append ``tap`` to its ``taps``, and ``close`` after the run.

    ``faults``: those of the session, as they stand in its report, which the pictures show.
    """

    def __init__(
        self, model: Model, state: Record, faults: Sequence[dict[str, Any]] = (), *, screenshot: str = "",
        at: float | None = None, film: str = "", size: tuple[int, int] = (1280, 720),
    ) -> None:  # fmt: skip
        self._state, self._faults, self._path, self._at = state, faults, screenshot, at
        self._sink = sink(film) if film else None
        self._film = film
        self._offscreen = Offscreen(model, width=size[0], height=size[1])
        period = self._period = model.period
        self._shot_tick = None if at is None else round(at / period)
        self._every = round(1.0 / (self._sink.rate * period)) if self._sink else 0
        self.taken = False

    def tap(self, tick: int) -> None:
        """Take the pictures that are due after this tick."""
        self._offscreen.picture.ring.add(self._state)
        if self._path and self._shot_tick is not None and tick + 1 >= self._shot_tick and not self.taken:
            self._shoot()
        if self._sink is not None and tick % self._every == 0:
            self._sink.add(self._offscreen.shoot(self._state, self._status()))

    def _status(self) -> SessionStatus:
        return SessionStatus(faults=list(self._faults))

    def _shoot(self) -> None:
        write_png(self._path, self._offscreen.shoot(self._state, self._status()))
        self.taken = True

    def close(self) -> None:
        """Take the picture at the end of the run, if that is asked for, and finish the film.

        Raises
        ------
        ItouchError
            If the run was over before the time of the picture, or a file can't be written.
        """
        try:
            if self._path and self._at is None:
                self._shoot()
            if self._sink is not None:
                self._sink.close()
        except OSError as error:
            raise ItouchError(f"cannot write '{self._film}': {error.strerror or os.strerror(5)}") from error
        finally:
            self._offscreen.close()
        if self._path and not self.taken:
            end = int(self._state["tick"]) * self._period
            raise ItouchError(f"--at {self._at:g} s: the run ended at {end:g} s, before the picture")
