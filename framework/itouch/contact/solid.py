"""Whether a mesh encloses a volume: it is closed, wound consistently, and has its front outside."""

import numpy as np

from itouch.contact.bvh import Ints32
from itouch.contact.compiling import entry, inner
from itouch.contact.triangle import corner
from itouch.contact.vectors import Floats, cross, dot, sub

_PRIME = np.uint64(0x9E3779B97F4A7C15)
_SHIFT = np.uint64(29)


@inner
def _mix(a: np.uint64, b: np.uint64) -> np.uint64:
    """Scramble two words into one; the order matters."""
    x = (a ^ (b + _PRIME + (a << np.uint64(6)) + (a >> np.uint64(2)))) * _PRIME
    x ^= x >> _SHIFT
    x *= np.uint64(0xBF58476D1CE4E5B9)
    return x ^ (x >> np.uint64(32))


@entry
def encloses(vertices: Floats, triangles: Ints32) -> bool:
    """Whether every directed edge has its opposite and the signed volume is positive.

    Edges are compared by a 64-bit sum of hashes of their ends' coordinates, so that duplicate vertices count as one;
    the chance of a wrong answer is about 1e-19.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH).
    """
    words = np.empty(vertices.shape[0], np.uint64)
    bits = vertices.view(np.uint64)
    for v in range(vertices.shape[0]):
        word = _PRIME
        for c in range(3):
            word = _mix(word, bits[v, c] if vertices[v, c] != 0.0 else np.uint64(0))
        words[v] = word
    balance = np.uint64(0)
    volume = 0.0
    middle = corner(vertices, 0)
    for t in range(triangles.shape[0]):
        for c in range(3):
            a, b = words[triangles[t, c]], words[triangles[t, (c + 1) % 3]]
            balance += _mix(a, b) - _mix(b, a)
        p = sub(corner(vertices, triangles[t, 0]), middle)
        q, r = sub(corner(vertices, triangles[t, 1]), middle), sub(corner(vertices, triangles[t, 2]), middle)
        volume += dot(p, cross(q, r))
    return bool(balance == np.uint64(0) and volume > 0.0)
