"""Height and slope of a height map laid over an object (triplanar): what a texture carves out of its surface.

The map lies in the object's frame with its middle at the origin and repeats in both directions.  It is projected along
one axis, or along all three with weights by the surface's direction (triplanar): along z the map's columns run along x
and its rows, from the last to the first, along y; along y they are x and z, along x they are y and z.
"""

import math

from itouch.contact.compiling import inner
from itouch.contact.vectors import Floats, Vector

Height = tuple[float, float, float]


@inner
def _sample(samples: Floats, first: int, rows: int, columns: int, u: float, v: float) -> Height:
    """Value of a map at (u, v) [samples], linear between samples, and its derivatives with respect to u and v."""
    x, y = u + 0.5 * columns - 0.5, v + 0.5 * rows - 0.5
    i, j = int(math.floor(x)), int(math.floor(y))
    s, t = x - i, y - j
    i0, j0 = i % columns, rows - 1 - j % rows
    i1, j1 = (i + 1) % columns, rows - 1 - (j + 1) % rows
    a, b = samples[first + j0 * columns + i0], samples[first + j0 * columns + i1]
    c, d = samples[first + j1 * columns + i0], samples[first + j1 * columns + i1]
    # Differences of samples are as precise as these, which are single: in compiled code `float` changes nothing, and in
    # Python it must come after the subtraction, for then both round alike.
    below, above, twist = float(b - a), float(d - c), float((d - c) - (b - a))
    low, high = float(a) + s * below, float(c) + s * above
    return low + t * (high - low), below + t * twist, high - low


@inner
def carved(table: Floats, obj: int, samples: Floats, q: Vector, n: Vector) -> tuple[float, Vector]:
    """Depth that the map carves out of the surface at ``q`` [m], and its gradient, both in the object's frame.

    ``n`` is the surface's unit normal there.  See ``itouch.contact.effects`` for the table.

    ``table`` (objects, EFFECTS_WIDTH); ``samples`` (n,), the values of all maps, 0 to 1, row by row.
    """
    first, rows, columns = int(table[obj, 0]), int(table[obj, 1]), int(table[obj, 2])
    pitch, depth, axis = table[obj, 3], table[obj, 4], int(table[obj, 5])
    value, gx, gy, gz, total = 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(3):
        weight = 1.0 if axis == c else 0.0
        if axis < 0:
            weight = n[c] * n[c]
            weight *= weight
        if weight < 1e-6:
            continue
        u, v = (q[1] if c == 0 else q[0]) / pitch, (q[1] if c == 2 else q[2]) / pitch
        h, hu, hv = _sample(samples, first, rows, columns, u, v)
        value, total = value + weight * h, total + weight
        hu, hv = weight * hu / pitch, weight * hv / pitch
        if c == 0:
            gy, gz = gy + hu, gz + hv
        elif c == 1:
            gx, gz = gx + hu, gz + hv
        else:
            gx, gy = gx + hu, gy + hv
    if total == 0.0:
        return 0.0, (0.0, 0.0, 0.0)
    cut = depth * (1.0 - value / total)
    scale = -depth / total
    return cut, (scale * gx, scale * gy, scale * gz)
