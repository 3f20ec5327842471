"""Masking noise, judged as samples: even, pink, without seams, and the same whatever is touched."""

from __future__ import annotations

import time

import numpy as np
import pytest

from itouch_tools.sound.masking import BLOCK, LOUDNESS, Masker, Noise
from itouch_tools.sound.modal import RATE

SECONDS = 12


@pytest.fixture(scope="module")
def samples() -> np.ndarray:
    """Some seconds after it has faded in."""
    noise = Noise(7)
    noise.render(5 * RATE)
    return noise.render(SECONDS * RATE)


def test_the_noise_is_as_loud_at_any_time(samples: np.ndarray) -> None:
    assert samples.std() == pytest.approx(LOUDNESS, rel=0.05)
    assert np.abs(samples).max() < 1.0  # nothing is clipped
    tenths = samples.reshape(-1, RATE // 2)
    loud = 20.0 * np.log10(np.sqrt((tenths**2).mean(axis=1)))
    assert np.ptp(loud) < 2.5


def test_the_noise_is_pink(samples: np.ndarray) -> None:
    power = np.abs(np.fft.rfft(samples)) ** 2
    frequency = np.fft.rfftfreq(len(samples), 1.0 / RATE)
    octaves = [60.0 * 2.0**n for n in range(8)]
    found = [10.0 * np.log10(power[(frequency >= f) & (frequency < 2.0 * f)].sum()) for f in octaves]
    assert np.ptp(found) < 1.5  # each octave has the same power


def test_blocks_of_any_length_are_one_stream() -> None:
    whole = Noise(3).render(10_000)
    pieces, parts = Noise(3), []
    for count in (1, 7, 480, 512, 9000):
        parts.append(pieces.render(count))
    assert np.concatenate(parts) == pytest.approx(whole, abs=1e-12)
    assert Noise(4).render(100) != pytest.approx(Noise(3).render(100))
    assert np.abs(whole[:48]).max() < 0.01  # it fades in


class Kept:
    """Takes what is played."""

    name = "kept"

    def __init__(self, broken: int = 10**9) -> None:
        self.played, self.closed, self._broken = bytearray(), False, broken

    def write(self, samples: bytes) -> None:
        if len(self.played) >= self._broken:
            raise OSError(5, "it has gone")
        self.played += samples

    def latency(self) -> float:
        return 0.0

    def close(self) -> None:
        self.closed = True


def test_what_is_played_is_what_is_rendered() -> None:
    kept = Kept()
    with Masker(5, output=lambda: kept) as masker:
        assert masker.heard
        while masker.blocks < 4:
            time.sleep(0.005)
    assert kept.closed
    count = 4 * BLOCK
    expected = np.round(Noise(5).render(count) * 32767).astype("<i2")
    assert np.frombuffer(bytes(kept.played), "<i2")[:count].tolist() == expected.tolist()


def test_a_card_that_goes_away_is_told() -> None:
    with Masker(output=lambda: Kept(broken=BLOCK)) as masker:
        while masker.blocks < 3:
            time.sleep(0.005)
        assert not masker.heard
