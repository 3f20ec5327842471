"""Other libraries' searches for the point of a mesh that is nearest to a probe, with one call per query.

A library that is not installed is left out, and the output names it.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from itouch.contact.vectors import Floats
from itouch_evidence.contact.contact_workload import Faces

Query = Callable[[Floats], object]
Peer = Callable[[Floats, Faces, float], Query]
FEW = 40  # number of queries for slow libraries


def _open3d(vertices: Floats, faces: Faces, radius: float) -> Query:
    o3d: Any = importlib.import_module("open3d")
    core = o3d.core
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(core.Tensor(vertices.astype(np.float32)), core.Tensor(faces.astype(np.uint32)))
    first = core.Tensor(vertices[:1].astype(np.float32))
    scene.compute_closest_points(first)  # the hierarchy is built by the first query

    def query(hip: Floats) -> object:
        return scene.compute_closest_points(core.Tensor(hip[None].astype(np.float32)))["points"].numpy()

    return query


def _fcl(vertices: Floats, faces: Faces, radius: float) -> Query:
    fcl: Any = importlib.import_module("fcl")
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    mesh, probe = fcl.CollisionObject(model), fcl.CollisionObject(fcl.Sphere(radius))
    request = fcl.DistanceRequest(True)

    def query(hip: Floats) -> object:
        probe.setTranslation(hip)
        return fcl.distance(mesh, probe, request, fcl.DistanceResult())

    return query


def _coal(vertices: Floats, faces: Faces, radius: float) -> Query:
    coal: Any = importlib.import_module("coal")
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(faces), len(vertices))
    model.addVertices(vertices)
    model.addTriangles(faces.astype(np.int64))
    model.endModel()
    probe, still, moved = coal.Sphere(radius), coal.Transform3s(), coal.Transform3s()
    request = coal.DistanceRequest()

    def query(hip: Floats) -> object:
        moved.setTranslation(hip)
        return coal.distance(model, still, probe, moved, request, coal.DistanceResult())

    return query


def _igl(vertices: Floats, faces: Faces, radius: float) -> Query:
    igl: Any = importlib.import_module("igl")
    corners = np.ascontiguousarray(faces, dtype=np.int64)
    tree = igl.AABB()
    tree.init(vertices, corners)

    def query(hip: Floats) -> object:
        return tree.squared_distance(vertices, corners, hip[None])

    return query


def _trimesh(vertices: Floats, faces: Faces, radius: float) -> Query:
    trimesh: Any = importlib.import_module("trimesh")
    importlib.import_module("rtree")
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.nearest.on_surface(vertices[:1])

    def query(hip: Floats) -> object:
        return mesh.nearest.on_surface(hip[None])

    return query


def _mujoco(vertices: Floats, faces: Faces, radius: float) -> Query:
    mujoco: Any = importlib.import_module("mujoco")
    spec = mujoco.MjSpec()
    spec.add_mesh(name="m", uservert=vertices.ravel().tolist(), userface=faces.ravel().tolist())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="m")
    body = spec.worldbody.add_body()
    for axis in np.eye(3):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0])
    model = spec.compile()
    data = mujoco.MjData(model)

    def query(hip: Floats) -> object:
        data.qpos[:3] = hip
        mujoco.mj_kinematics(model, data)
        return mujoco.mj_collision(model, data)

    return query


PEERS: dict[str, tuple[Peer, int, int]] = {  # by what the query does: peer, most queries, most triangles
    "open3d compute_closest_points": (_open3d, 10**9, 10**9),
    "libigl AABB.squared_distance": (_igl, 10**9, 10**9),
    "python-fcl distance, sphere": (_fcl, 200, 10**9),
    "coal distance, sphere": (_coal, 200, 10**9),
    "trimesh nearest.on_surface": (_trimesh, FEW, 10**9),
    "mujoco collision with the convex hull": (_mujoco, 10**9, 200_000),
}

#: The packages to install for each peer.
PACKAGES = dict(zip(PEERS, ("open3d", "libigl", "python-fcl", "coal", "trimesh rtree", "mujoco"), strict=True))
