"""Numerical inversion of Laplace transforms on a modified Talbot contour.

The contour and its constants are those of Dingfelder and Weideman (2015), "Modified Talbot contours for the
numerical inversion of Laplace transforms with singularities on the negative real axis"; the midpoint rule on it
converges as 3.89**-N.  With 24 nodes the factor exp(Re z) stays below 61, so that double precision suffices.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]

_SIGMA, _MU, _NU, _ALPHA = 0.6122, 0.5017, 0.2645, 0.6407


def talbot(nodes: int) -> tuple[Complex, Complex]:
    """Return z and weights, each of shape (nodes // 2,): ``f(t) = Re sum(weights * F(z / t)) / t``.

    F must be the transform of a real function, with all singularities on the real axis, left of a few 1/t.
    """
    angle = (2 * np.arange(nodes // 2) + 1) * np.pi / nodes
    turn = _ALPHA * angle
    z = nodes * (-_SIGMA + _MU * angle / np.tan(turn) + 1j * _NU * angle)
    slope = nodes * (_MU / np.tan(turn) - _MU * turn / np.sin(turn) ** 2 + 1j * _NU)
    return z, -2j * np.exp(z) * slope / nodes


Z, WEIGHTS = talbot(24)
