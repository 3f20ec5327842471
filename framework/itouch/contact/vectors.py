"""Three-vectors and rigid motions as tuples of floats: they stay in registers inside compiled code."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Vector = tuple[float, float, float]
Floats = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def vector(array: Floats, at: int) -> Vector:
    """Three numbers of a flat array as a vector."""
    return (array[at], array[at + 1], array[at + 2])


@njit(cache=True, error_model="numpy")
def put(array: Floats, at: int, v: Vector) -> None:
    """Write a vector into a flat array."""
    array[at] = v[0]
    array[at + 1] = v[1]
    array[at + 2] = v[2]


@njit(cache=True, error_model="numpy")
def place_of(poses: Floats, obj: int) -> Vector:
    """Position of one pose."""
    return (poses[obj, 0], poses[obj, 1], poses[obj, 2])


@njit(cache=True, error_model="numpy")
def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@njit(cache=True, error_model="numpy")
def sub(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@njit(cache=True, error_model="numpy")
def along(a: Vector, s: float, b: Vector) -> Vector:
    """Return a + s b."""
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@njit(cache=True, error_model="numpy")
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, error_model="numpy")
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(cache=True, error_model="numpy")
def norm(a: Vector) -> float:
    """Length."""
    return float(np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]))


