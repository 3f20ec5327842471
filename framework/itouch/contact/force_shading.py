"""Force shading: the force of a faceted mesh is turned to the direction given by its vertex normals.

The proxy stays where the facets hold it; only the direction of the force is blended over a facet, as Phong's shading
blends that of light (Morgenbesser and Srinivasan, "Force shading for haptic shape perception", 1996). A curved surface
made of flat facets then feels smooth. Like every force shading, it is not the gradient of an energy: on a coarse mesh a
closed path may give back a little energy, in proportion to the angle by which the force is turned.
"""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.bvh import Ints32
from itouch.contact.halfspaces import normal_of
from itouch.contact.kernel_decorators import inner
from itouch.contact.object_poses import rotate, to_local
from itouch.contact.scratch import Mesh
from itouch.contact.triangle import corner, nearest_of
from itouch.contact.vectors import Floats, Vector, add, along, cross, dot, norm, sub

NORMAL = 3  # first of the three columns of vertex normals, in a table of vertices that has them
_COSINE = 0.7071  # a vertex normal farther than 45 degrees from the force's own direction is a crease: no shading


def vertex_normals(vertices: Floats, triangles: Ints32) -> Floats:
    """Return the unit normals of vertices: means of their faces' normals, weighted by angle (Thuermer, Wuethrich 1998).

    Parameters
    ----------
    vertices
        (v, 3) [m]; vertices at the same place count as one.
    triangles
        (n, 3 or more), the first three columns are indices.

    Returns
    -------
    ndarray
        (v, 3); zero for a vertex whose faces' normals cancel out.
    """
    _, one = np.unique(vertices[:, :3], axis=0, return_inverse=True)
    points, one = vertices[:, :3][triangles[:, :3]], one.reshape(-1)[triangles[:, :3]]
    face = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    face /= np.maximum(np.linalg.norm(face, axis=1), 1e-300)[:, None]
    sums = np.zeros((int(one.max()) + 1, 3))
    for c in range(3):
        a, b = (points[:, (c + i) % 3] - points[:, c] for i in (1, 2))
        angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ni,ni->n", a, b))
        for x in range(3):
            sums[:, x] += np.bincount(one[:, c], angle * face[:, x], len(sums))
    sums /= np.maximum(np.linalg.norm(sums, axis=1), 1e-300)[:, None]
    normals = np.zeros((vertices.shape[0], 3))
    normals[triangles[:, :3].ravel()] = sums[one.ravel()]
    return normals


@inner
def _blended(vertices: Floats, triangles: Ints32, t: int, q: Vector) -> Vector:
    """Vertex normals of one triangle, blended at its point nearest to ``q``."""
    foot = nearest_of(vertices, triangles, t, q)
    a, b, c = (corner(vertices, triangles[t, 0]), corner(vertices, triangles[t, 1]), corner(vertices, triangles[t, 2]))
    n = cross(sub(b, a), sub(c, a))
    area = dot(n, n)
    if area == 0.0:
        return (0.0, 0.0, 0.0)
    u = dot(cross(sub(c, b), sub(foot, b)), n) / area
    v = dot(cross(sub(a, c), sub(foot, c)), n) / area
    total = (0.0, 0.0, 0.0)
    for i in range(3):
        share = u if i == 0 else (v if i == 1 else 1.0 - u - v)
        k = triangles[t, i]
        total = along(total, share, (vertices[k, NORMAL], vertices[k, NORMAL + 1], vertices[k, NORMAL + 2]))
    return total


@inner
def shaded(site: Floats, mesh: Mesh, count: int, p: Vector, direction: Vector) -> Vector:
    """Direction of the normal force: the blended normals of the planes that bear load, weighted by it.

    ``site`` (rows, SITE_WIDTH), of which the first ``count`` rows are planes; ``p`` [m], world frame.
    """
    total, turned = (0.0, 0.0, 0.0), False
    for k in range(count):
        load = site[k, at.PLANE_LOAD]
        if load <= 0.0:
            continue
        frame, own = int(site[k, at.PLANE_FRAME]), normal_of(site, k)
        if site[frame, at.FRAME_SHADING] > 0.0:
            n = rotate(
                site, frame, _blended(mesh[0], mesh[1], int(site[k, at.PLANE_FEATURE]), to_local(site, frame, p))
            )
            along_own, size = dot(n, own), norm(n)
            if abs(along_own) > _COSINE * size and size > 0.0:
                own = along((0.0, 0.0, 0.0), (1.0 if along_own > 0.0 else -1.0) / size, n)
                turned = True
        total = along(total, load, own)
    size = norm(total)
    if not turned or size == 0.0:
        return direction
    return along((0.0, 0.0, 0.0), 1.0 / size, total)


@inner
def turned(v: Vector, a: Vector, b: Vector) -> Vector:
    """Turn a vector by the least rotation that takes the unit vector ``a`` to ``b``; they are not opposed."""
    axis = cross(a, b)
    once = cross(axis, v)
    return add(along(v, 1.0 / (1.0 + dot(a, b)), cross(axis, once)), once)
