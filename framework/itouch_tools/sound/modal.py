"""Modal synthesis of a tap on a body: damped modes, and how many high tones a tap excites.

Modal synthesis after van den Doel and Pai (1998): a tap adds to the amplitude of every mode, which then rings by
itself.  A mode begins as a sine, from zero, so that a tap never makes the sound jump.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

#: Sampling rate [Hz].
RATE = 48_000
#: Speed [m/s] at which a tap has half of the greatest loudness.
HALF_SPEED = 0.15
#: How long [s] a tap at 1 m/s lasts: it excites little above the inverse of that (Hertz: duration ~ speed ** -0.2).
STROKE = 6e-5
#: Shortest decay [s]: what dies away within a few samples is no tone, and a decay of zero would divide by zero.
SHORTEST = 5e-4
#: Modes whose amplitude is below this are silent.
_SILENCE = 1e-7


def loudness(speed: float) -> float:
    """Return how loud a tap of this speed [m/s] is, 0 to 1; a NaN or negative speed is silent."""
    return speed / (speed + HALF_SPEED) if math.isfinite(speed) and speed > 0.0 else 1.0 if speed == math.inf else 0.0


class ModeBank:
    """A bank of damped modes, and how each is ringing now.

    Parameters
    ----------
    frequencies, decays, gains
        Of each mode: frequency [Hz], time [s] in which it dies away by 60 dB, and its share of the tap, 0 to 1.
    level
        The greatest amplitude that a single tap reaches.
    """

    def __init__(
        self, frequencies: Sequence[float], decays: Sequence[float], gains: Sequence[float], *, level: float = 0.5
    ) -> None:
        f, decay = np.asarray(frequencies, float), np.maximum(np.asarray(decays, float), SHORTEST)
        share = np.asarray(gains, float)
        self._share = level * share / max(float(share.sum()), 1e-9)
        self._frequencies = f
        #: Logarithm of the factor by which a mode's phasor is multiplied from one sample to the next.
        self._turn = (2j * math.pi * f - math.log(1000.0) / decay) / RATE
        self._ringing = np.zeros(len(f), complex)
        self._ladders: dict[int, NDArray[np.complex128]] = {}

    @property
    def silent(self) -> bool:
        """Whether nothing rings any more."""
        return not self._ringing.any()

    def strike(self, speed: float) -> None:
        """Strike at a speed [m/s]; what rings already goes on."""
        strength = loudness(speed)
        if strength > 0.0:
            length = STROKE * max(strength * HALF_SPEED / max(1.0 - strength, 1e-6), 1e-3) ** -0.2
            self._ringing += strength * self._share / (1.0 + (self._frequencies * length) ** 2)

    def render(self, count: int) -> NDArray[np.float64]:
        """Return the next samples, shape (count,)."""
        if self.silent or count == 0:
            return np.zeros(count)
        ladder = self._ladders.get(count)
        if ladder is None:
            ladder = np.exp(np.outer(np.arange(count), self._turn))
            if len(self._ladders) > 8:
                self._ladders.clear()
            self._ladders[count] = ladder
        made: NDArray[np.float64] = (ladder @ self._ringing).imag
        self._ringing *= np.exp(count * self._turn)
        self._ringing[np.abs(self._ringing) < _SILENCE] = 0.0
        return made
