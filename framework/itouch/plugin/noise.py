"""Random numbers from a generator that is one word of State, so that a restored twin draws the same noise."""

from __future__ import annotations

import math

from itouch.plugin.record import Record

_MASK = (1 << 64) - 1
_TWO_PI = 2.0 * math.pi


def random_word(state: Record, name: str) -> int:
    """Draw 64 bits, advancing the word ``state[name]`` (dtype u8): SplitMix64 (Steele, Lea and Flood 2014)."""
    word = (int(state[name].item()) + 0x9E3779B97F4A7C15) & _MASK
    state[name][...] = word
    word = ((word ^ (word >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    word = ((word ^ (word >> 27)) * 0x94D049BB133111EB) & _MASK
    return word ^ (word >> 31)


def uniform(state: Record, name: str) -> float:
    """Draw a number from 0 to 1, 1 excluded, advancing the word ``state[name]`` (dtype u8)."""
    return (random_word(state, name) >> 11) * 2.0**-53


def gaussian(state: Record, name: str) -> float:
    """Draw from the standard normal distribution, advancing the word ``state[name]`` (dtype u8)."""
    radius = math.sqrt(-2.0 * math.log(uniform(state, name) + 2.0**-54))
    return radius * math.cos(_TWO_PI * uniform(state, name))
