"""Plays a session's sound through the machine's card; silent, and without a word, where there is none.

Latency: a State is heard in the next frame of the window (at most 17 ms at 60 Hz) and then waits in the driver's
buffer, whose length the driver chooses (OpenAL and PulseAudio: some 50 ms).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyglet
from pyglet.media import Player, Source
from pyglet.media.codecs.base import AudioData, AudioFormat

from itouch.plugin import Record
from itouch.sound.modal import RATE
from itouch.sound.synth import Synth
from itouch.world import Model


class _Stream(Source):
    """An endless source: the driver asks for the next bytes when it needs them."""

    def __init__(self, synth: Synth) -> None:
        self._synth, self._time = synth, 0.0
        self.audio_format = AudioFormat(channels=1, sample_size=16, sample_rate=RATE)
        self.is_precise = True

    def get_audio_data(self, num_bytes: int, compensation_time: float = 0.0) -> Any:
        """Return at most 20 ms of sound, so that what happens now is heard soon."""
        count = max(1, min(int(num_bytes) // 2, RATE // 50))
        samples = np.round(self._synth.render(count) * 32767).astype("<i2").tobytes()
        begin, self._time = self._time, self._time + count / RATE
        return AudioData(samples, len(samples), begin, count / RATE, [])

    def seek(self, timestamp: float) -> None:
        """Go on: there is nothing to go back to."""


class Speaker:
    """Hears States and plays them."""

    def __init__(self, model: Model, *, mute: bool = False) -> None:
        self._synth = Synth(model)
        self._player: Any = None
        self.muted = mute
        if not mute:
            self._open()

    def _open(self) -> None:
        try:
            player = Player()
            player.queue(_Stream(self._synth))
            player.play()
        except Exception:  # each driver has errors of its own; a session without sound is still a session
            self.muted = True
            return
        self._player = player
        self.muted = type(pyglet.media.get_audio_driver()).__name__.startswith("Silent")

    def hear(self, state: Record) -> None:
        """Take note of a State."""
        self._synth.hear(state)

    def close(self) -> None:
        """Be silent."""
        if self._player is not None:
            self._player.pause()
            self._player.delete()
            self._player = None
