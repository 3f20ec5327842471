"""Masking noise for a study: the same from the first trial to the last, whatever is touched.

It never stops, starts or changes between trials, and is therefore equal in all conditions.  Its power falls by 3 dB an
octave (pink noise), as that of most machines does: it covers low hums without hissing.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from itouch_tools.sound.modal import RATE
from itouch_tools.sound.output import Output, Silence, open_output

#: Samples in a block, time constant [s] of the fade-in, and rms of the noise as a share of full scale (-18 dB).
BLOCK, FADE, LOUDNESS = RATE // 50, 0.5, 0.125
#: How far ahead of real time [s] an output may be fed, and how long [s] to wait for the thread to open and to end.
_AHEAD, _PATIENCE = 0.25, 1.0
#: Poles and gains of Kellet's pink filter: within 0.1 dB of 3 dB an octave from 10 Hz to 20 kHz at 48 kHz.
_POLES = np.array([0.99886, 0.99332, 0.96900, 0.86650, 0.55000, -0.7616])
_GAINS = np.array([0.0555179, 0.0750759, 0.1538520, 0.3104856, 0.5329522, -0.0168980])
_DIRECT, _LATE = 0.5362, 0.115926

Floats = NDArray[np.float64]


def _rms() -> float:
    """Return the rms of the filter's output for white noise of rms 1: the 2-norm of its impulse response."""
    lows = (np.outer(_GAINS, _GAINS) / (1.0 - np.outer(_POLES, _POLES))).sum()
    mixed = 2.0 * (_DIRECT * _GAINS.sum() + _LATE * (_GAINS * _POLES).sum())
    return float(np.sqrt(lows + mixed + _DIRECT**2 + _LATE**2))


_RMS = _rms()


class Noise:
    """Makes pink noise, block after block without a seam; the same samples for the same seed."""

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng([seed, 0x6E6F])
        self._poles, self._before, self._count = np.zeros(len(_POLES)), 0.0, 0

    def render(self, count: int) -> Floats:
        """Return the next samples, between -1 and 1, shape (count,)."""
        white = self._rng.standard_normal(count)
        made = _DIRECT * white + _LATE * np.concatenate(([self._before], white[:-1]))
        for index, (pole, gain) in enumerate(zip(_POLES, _GAINS, strict=True)):
            low = _smoothed(gain * white, float(pole), float(self._poles[index]))
            self._poles[index] = low[-1] if count else self._poles[index]
            made += low
        self._before = float(white[-1]) if count else self._before
        times = (self._count + np.arange(1, count + 1)) / RATE
        self._count += count
        fade = -np.expm1(-times / FADE)
        return np.asarray(np.clip(LOUDNESS / _RMS * fade * made, -1.0, 1.0))


def _smoothed(values: Floats, pole: float, before: float) -> Floats:
    """Return y[n] = pole y[n-1] + x[n], where ``before`` is the y before the first."""
    from scipy.signal import lfilter

    made, _ = lfilter([1.0], [1.0, -pole], values, zi=[pole * before])
    return np.asarray(made, float)


class Masker:
    """Plays masking noise in a thread of its own until it is closed; also a context manager.

    Attributes
    ----------
    driver
        Name of the output that plays: ``silent`` where there is no card, empty until an output is open.
    """

    def __init__(self, seed: int = 0, *, output: Callable[[], Output] = open_output) -> None:
        self._noise, self._open, self._closing = Noise(seed), output, threading.Event()
        self.driver, self.blocks = "", 0
        self._opened = threading.Event()
        self._thread = threading.Thread(target=self._play, name="masking", daemon=True)

    def __enter__(self) -> Masker:
        self._thread.start()
        self._opened.wait(_PATIENCE)
        return self

    def __exit__(self, *exception: object) -> None:
        self._closing.set()
        self._thread.join(_PATIENCE)

    @property
    def heard(self) -> bool:
        """Whether an output is open that can be heard."""
        return bool(self.driver) and self.driver != Silence.name

    def _play(self) -> None:
        output = self._open()
        self.driver = output.name
        self._opened.set()
        begin = time.monotonic()
        while not self._closing.is_set():
            output = self._put(output, self._noise.render(BLOCK))
            early = self.blocks * BLOCK / RATE - (time.monotonic() - begin) - _AHEAD
            if early > 0.0:  # an output that never makes its caller wait, as a null device may do
                self._closing.wait(early)
        self._put(output, self._noise.render(BLOCK) * np.linspace(1.0, 0.0, BLOCK)).close()

    def _put(self, output: Output, samples: Floats) -> Output:
        """Play a block; where the output fails, go on in silence, as ``driver`` then says."""
        self.blocks += 1
        try:
            output.write(np.round(samples * 32767).astype("<i2").tobytes())
        except OSError:
            output = Silence()
            self.driver = output.name
        return output
