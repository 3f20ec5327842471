"""Linear algebra of tall matrices in blocks of rows.

The matrices here are small, but not so small that a threaded BLAS would leave them to one core; on a busy machine its
threads then wait for one another a hundred times longer than the work takes.  Blocks stay below its thresholds.
"""

from __future__ import annotations

import numpy as np

from itouch_thermal.solver.stack import Array

#: Entries of a block of a factorisation, and products of a block of a multiplication.
_ENTRIES, _PRODUCTS = 8000, 200_000


def triangle(matrix: Array) -> Array:
    """Return the triangular factor of a tall matrix, shape (columns, columns), by QR of blocks."""
    rows, columns = matrix.shape
    height = max(_ENTRIES // columns, columns + 8)
    if rows <= height:
        return np.asarray(np.linalg.qr(matrix, mode="r"))
    factor = np.linalg.qr(matrix[:height], mode="r")
    step = max(height - columns, 8)
    for first in range(height, rows, step):
        factor = np.linalg.qr(np.concatenate((factor, matrix[first : first + step])), mode="r")
    return np.asarray(factor)


def right_vectors(matrix: Array) -> tuple[Array, Array]:
    """Return singular values, descending, and right singular vectors as rows of a tall matrix."""
    _, sizes, rows = np.linalg.svd(triangle(matrix), full_matrices=False)
    return sizes, rows


def product(tall: Array, matrix: Array) -> Array:
    """Return ``tall @ matrix``; a single row may be given for tall."""
    if tall.ndim == 1:
        return np.asarray(np.einsum("i,ij->j", tall, matrix))
    step = max(_PRODUCTS // matrix.size, 1)
    return np.concatenate([tall[first : first + step] @ matrix for first in range(0, len(tall), step)])
