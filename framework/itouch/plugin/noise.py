"""Random numbers whose generator is one word of State: a restored twin draws the same noise."""

from __future__ import annotations

import math

from itouch.plugin.record import Record

_MASK = (1 << 64) - 1
_TWO_PI = 2.0 * math.pi


def _mix(word: int) -> int:
    """Scramble a counter (SplitMix64, Steele, Lea and Flood 2014)."""
    word = ((word ^ (word >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    word = ((word ^ (word >> 27)) * 0x94D049BB133111EB) & _MASK
    return word ^ (word >> 31)


def gaussian(state: Record, name: str) -> float:
    """Draw from the standard normal distribution, advancing the word ``state[name]`` (dtype u8)."""
    word = int(state[name])
    first, second = (word + 0x9E3779B97F4A7C15) & _MASK, (word + 0x3C6EF372FE94F82A) & _MASK
    state[name][...] = second
    radius = math.sqrt(-2.0 * math.log((_mix(first) >> 11) * 2.0**-53 + 2.0**-54))
    return radius * math.cos(_TWO_PI * ((_mix(second) >> 11) * 2.0**-53))
