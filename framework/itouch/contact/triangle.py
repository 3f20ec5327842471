"""Nearest point of one triangle, and the tests that decide whether it counts."""

from itouch.contact.bvh import Ints32
from itouch.contact.kernel_decorators import inner
from itouch.contact.vectors import Floats, Vector, along, cross, dot, norm, sub


@inner
def corner(vertices: Floats, v: int) -> Vector:
    """Return one vertex.

    ``vertices`` (v, 3) [m].
    """
    return (vertices[v, 0], vertices[v, 1], vertices[v, 2])


@inner
def nearest_on_triangle(p: Vector, a: Vector, b: Vector, c: Vector) -> Vector:
    """Nearest point of the triangle a b c (Ericson, Real-Time Collision Detection, 2005, 5.1.5)."""
    ab, ac, ap = sub(b, a), sub(c, a), sub(p, a)
    d1, d2 = dot(ab, ap), dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return a
    bp = sub(p, b)
    d3, d4 = dot(ab, bp), dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return b
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return along(a, d1 / (d1 - d3), ab)
    cp = sub(p, c)
    d5, d6 = dot(ab, cp), dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return c
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return along(a, d2 / (d2 - d6), ac)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        return along(b, (d4 - d3) / ((d4 - d3) + (d5 - d6)), sub(c, b))
    scale = 1.0 / (va + vb + vc)
    return along(along(a, vb * scale, ab), vc * scale, ac)


@inner
def nearest_of(vertices: Floats, triangles: Ints32, t: int, p: Vector) -> Vector:
    """Nearest point of triangle ``t`` of a mesh.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH); ``p`` [m], mesh's frame.
    """
    return nearest_on_triangle(
        p,
        corner(vertices, triangles[t, 0]),
        corner(vertices, triangles[t, 1]),
        corner(vertices, triangles[t, 2]),
    )


@inner
def plane_distance2(vertices: Floats, triangles: Ints32, t: int, p: Vector) -> float:
    """Squared distance from the triangle's plane: a lower bound at a quarter of the cost; 0 for one without area.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH); ``p`` [m], what is returned [m2].
    """
    a = corner(vertices, triangles[t, 0])
    n = cross(sub(corner(vertices, triangles[t, 1]), a), sub(corner(vertices, triangles[t, 2]), a))
    size, away = dot(n, n), dot(n, sub(p, a))
    return float(away * away / size) if size > 0.0 else 0.0


@inner
def face_normal(vertices: Floats, triangles: Ints32, t: int) -> Vector:
    """Return the unit normal of the front, as given by the winding; zero for a triangle without area.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH).
    """
    a = corner(vertices, triangles[t, 0])
    n = cross(sub(corner(vertices, triangles[t, 1]), a), sub(corner(vertices, triangles[t, 2]), a))
    size = norm(n)
    if size == 0.0:
        return (0.0, 0.0, 0.0)
    return (n[0] / size, n[1] / size, n[2] / size)


@inner
def height(vertices: Floats, triangles: Ints32, t: int, p: Vector) -> float:
    """Signed distance of ``p`` from the triangle's plane, positive in front.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH); ``p`` and the distance [m].
    """
    return float(dot(face_normal(vertices, triangles, t), sub(p, corner(vertices, triangles[t, 0]))))


@inner
def beneath(vertices: Floats, triangles: Ints32, t: int, q: Vector) -> bool:
    """Whether ``q`` is straight behind a triangle: behind its plane, with its foot on the plane inside the triangle.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH); ``q`` [m], mesh's frame.
    """
    a, b, c = (corner(vertices, triangles[t, 0]), corner(vertices, triangles[t, 1]), corner(vertices, triangles[t, 2]))
    n = cross(sub(b, a), sub(c, a))
    if dot(n, sub(q, a)) >= 0.0:
        return False
    if dot(cross(sub(b, a), sub(q, a)), n) < 0.0 or dot(cross(sub(c, b), sub(q, b)), n) < 0.0:
        return False
    return bool(dot(cross(sub(a, c), sub(q, c)), n) >= 0.0)


@inner
def pierced(vertices: Floats, triangles: Ints32, t: int, p: Vector, q: Vector) -> bool:
    """Whether the straight way from ``p``, in front of a triangle, to ``q`` leads through the triangle to its back.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH); ``p`` and ``q`` [m], mesh's frame.
    """
    a, b, c = (corner(vertices, triangles[t, 0]), corner(vertices, triangles[t, 1]), corner(vertices, triangles[t, 2]))
    n = cross(sub(b, a), sub(c, a))
    above, below = dot(n, sub(p, a)), dot(n, sub(q, a))
    if above < 0.0 or below >= 0.0:
        return False
    x = along(p, above / (above - below), sub(q, p))
    if dot(cross(sub(b, a), sub(x, a)), n) < 0.0 or dot(cross(sub(c, b), sub(x, b)), n) < 0.0:
        return False
    return bool(dot(cross(sub(a, c), sub(x, c)), n) >= 0.0)
