"""Three-vectors and rigid motions as tuples of floats, which stay in registers inside compiled contact code."""

import numpy as np
from numpy.typing import NDArray

from itouch.contact.kernel_decorators import inner

Vector = tuple[float, float, float]
Floats = NDArray[np.float64]


@inner
def vector(array: Floats, at: int) -> Vector:
    """Three numbers of a flat array (n,), in any unit, as a vector."""
    return (array[at], array[at + 1], array[at + 2])


@inner
def put(array: Floats, at: int, v: Vector) -> None:
    """Write a vector, in any unit, into a flat array (n,)."""
    array[at] = v[0]
    array[at + 1] = v[1]
    array[at + 2] = v[2]


@inner
def place_of(poses: Floats, obj: int) -> Vector:
    """Position [m] of one of the poses (objects, 7)."""
    return (poses[obj, 0], poses[obj, 1], poses[obj, 2])


@inner
def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@inner
def sub(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inner
def along(a: Vector, s: float, b: Vector) -> Vector:
    """Return a + s b."""
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@inner
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inner
def norm(a: Vector) -> float:
    """Length."""
    return float(np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]))
