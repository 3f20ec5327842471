"""Polygons of mesh files, cut into fans of triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]


def fans(sizes: Ints, corners: Ints) -> Ints:
    """Cut polygons into triangles that share the first corner; polygons with fewer than three corners are left out.

    Parameters
    ----------
    sizes
        (n,) number of corners of each polygon.
    corners
        (sum of sizes,) indices of the corners, one polygon after the other.

    Returns
    -------
    ndarray
        (m, 3), in the order of the polygons.
    """
    triangles = np.maximum(sizes - 2, 0)
    begin = np.repeat(np.cumsum(sizes) - sizes, triangles)
    step = np.arange(len(begin)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([corners[begin], corners[begin + step + 1], corners[begin + step + 2]], axis=1)
