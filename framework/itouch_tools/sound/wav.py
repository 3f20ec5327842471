"""The sound of a run on the virtual clock as a WAV file, 48 kHz, 16 bit, mono."""

from __future__ import annotations

import os
import wave

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.schema import ItouchError
from itouch.schema.durable import replacing
from itouch.world import Model
from itouch_tools.sound.modal import RATE
from itouch_tools.sound.synth import Synth

#: Most samples that are rendered at once.
_BLOCK = 4800


def write_wav(path: str | os.PathLike[str], samples: NDArray[np.float64]) -> None:
    """Write samples between -1 and 1 (full scale, without a unit), shape (n,).

    Raises
    ------
    ItouchError
        If the file can't be written; an earlier one stays as it was.
    """
    try:
        with replacing(os.fspath(path)) as new, open(new, "wb") as stream, wave.open(stream, "wb") as sound:
            sound.setnchannels(1)
            sound.setsampwidth(2)
            sound.setframerate(RATE)
            sound.writeframes(_whole(samples).tobytes())
    except OSError as error:
        raise ItouchError(f"cannot write '{os.fspath(path)}': {error.strerror or error}") from error


class SoundTrack:
    """Renders the sound of a session while it runs, from its present tick on; append ``tap`` to its ``taps``.

    Samples are kept as 16 bit numbers, 0.35 GB an hour.
    """

    def __init__(self, model: Model, state: Record) -> None:
        self._state, self._period, self._synth = state, model.period, Synth(model)
        self._first = int(state["tick"])
        self._made: list[NDArray[np.int16]] = []
        self._count = 0

    def tap(self, tick: int) -> None:
        """Render up to the end of this tick."""
        self._synth.hear(self._state)
        due = round((tick + 1 - self._first) * self._period * RATE)
        while (count := min(due - self._count, _BLOCK)) > 0:
            self._made.append(_whole(self._synth.render(count)))
            self._count += count

    @property
    def has_sounds(self) -> bool:
        """Whether any object of the scene can be heard."""
        return self._synth.has_sounds

    @property
    def samples(self) -> NDArray[np.float64]:
        """The samples rendered so far, shape (n,), between -1 and 1."""
        return np.concatenate(self._made) / 32767.0 if self._made else np.zeros(0)


def _whole(samples: NDArray[np.float64]) -> NDArray[np.int16]:
    return np.round(np.clip(samples, -1.0, 1.0) * 32767).astype("<i2")
