"""The noise of sliding: a surface's grains, read off at the speed of the finger."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from itouch_tools.sound.modal import RATE
from itouch_tools.sound.texture_profile import TextureReader, Way

#: Number of points of the rough profile, which then repeats, and how many of them make a grain.
_PLACES, _PER_GRAIN = 1 << 15, 8.0
#: Speed [m/s] and force [N] at which the noise has its full loudness.
FULL_SPEED, FULL_FORCE = 0.4, 2.0
#: Exponent with which loudness grows with speed: about 3/4 was measured on dry rough surfaces.
FASTER = 0.75
#: Share of the full speed below which loudness grows in proportion to speed.
SLOW = 0.1
#: Speed [m/s] up to which a finger counts as resting: nobody holds quite still.
REST_SPEED = 1e-3
#: Time constant [s] with which speed and loudness follow their targets: no step is heard, whatever the block size.
FOLLOW = 0.004
#: How much of a texture's relief is heard.
RELIEF = 0.7
#: Pitch [Hz] above which the noise fades, so that nothing aliases.
_FADE = 9000.0
#: Loudness below which a fading noise has ended.
_INAUDIBLE = 1e-5


def surface(seed: int = 1) -> NDArray[np.float64]:
    """Return one period of a rough profile, shape (places,), of unit rms, in which grains of one size prevail."""
    rng = np.random.default_rng(seed)
    wave = np.fft.rfftfreq(_PLACES) * _PER_GRAIN  # in periods a grain
    shape = wave / (0.15 + wave**3)
    spectrum = shape * np.exp(2j * np.pi * rng.random(len(wave)))
    profile = np.fft.irfft(spectrum, _PLACES)
    unit: NDArray[np.float64] = profile / profile.std()
    return unit


class Sliding:
    """Reads the surface under a finger; speed and loudness change without steps."""

    def __init__(self) -> None:
        self._profile = np.append(surface(), 0.0)
        self._profile[-1] = self._profile[0]
        self._place, self._step, self._level = 0.0, 0.0, 0.0
        self._reader = TextureReader(FOLLOW)

    @property
    def silent(self) -> bool:
        """Whether no sliding is heard any more."""
        return self._level == 0.0

    def render(
        self, count: int, speed: float, force: float, *, grain: float, level: float, way: Way | None = None
    ) -> NDArray[np.float64]:
        """Return the next samples, shape (count,), for a finger that slides at a speed [m/s] under a force [N].

        ``grain`` [m] is the size of the grains, ``level`` the rms at full speed and force, ``way`` the relief of the
        texture that goes by: it is heard itself, and the grains are louder on its hills than in its valleys.
        """
        speed = speed if 0.0 < speed < 100.0 else 0.0
        force = min(force, FULL_FORCE) if force > 0.0 else 0.0
        pitch = speed / grain
        share = min(1.0, max(0.0, speed - REST_SPEED) / FULL_SPEED)
        loud = (
            level
            * share
            * ((share + SLOW) / (1.0 + SLOW)) ** (FASTER - 1.0)  # but a finger that all but rests is silent
            * (force / FULL_FORCE) ** 0.5
            / (1.0 + (pitch / _FADE) ** 4)
        )
        loud = loud if loud > 1e-6 else 0.0
        if count == 0 or (loud == 0.0 and self._level == 0.0):
            return np.zeros(count)
        left = np.exp(-np.arange(1, count + 1) / (FOLLOW * RATE))
        step = min(pitch * _PER_GRAIN / RATE, 0.5 * _PER_GRAIN)
        if self._level == 0.0:
            self._step = step  # nothing is heard yet whose pitch could glide
        steps = step + left * (self._step - step)
        levels = loud + left * (self._level - loud)
        places = (self._place + np.cumsum(steps)) % _PLACES
        self._place, self._step = float(places[-1]), float(steps[-1])
        index = places.astype(int)
        rest = places - index
        heard = self._profile[index] * (1.0 - rest) + self._profile[index + 1] * rest
        relief = self._reader.read(way, count)
        if relief is not None:
            heard = heard * np.maximum(0.0, 1.0 + RELIEF * relief) + RELIEF * relief
        made: NDArray[np.float64] = heard * levels
        self._level = float(levels[-1]) if loud > 0.0 or levels[-1] > _INAUDIBLE else 0.0
        return made
