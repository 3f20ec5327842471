"""The world as MuJoCo sees it: free bodies, bodies that are moved, and bodies that stand still.

The model does not change while it runs: everything that does is in one flat array, MuJoCo's integration state (time,
positions, velocities, warm start, applied forces, moved poses), which is restored before each step. Two steps from
equal states and forces are equal to the last bit. The finger's force acts on a body through the virtual coupling of the
contact engine alone: the finger is not a body here. Meshes collide with other objects as their convex hulls.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.contact.shapes import Box, Capsule, Cylinder, Mesh, Plane, Shape, Sphere
from itouch.dynamics.mujoco_link import apply_forces, read_back

Floats = NDArray[np.float64]

STILL, MOVED, FREE = 0, 1, 2


class BodyError(ValueError):
    """An object cannot be a rigid body; ``index`` is its index."""

    def __init__(self, index: int, sentence: str) -> None:
        super().__init__(sentence)
        self.index = index


@dataclass(frozen=True, slots=True)
class Body:
    """One object: its shape and initial pose, whether it is STILL, MOVED or FREE, and, if it is free, its physics.

    ``mass`` [kg], its centre where that of the shape is at uniform density; ``inertia`` about this centre, along the
    axes of the object's frame [kg m2], None: that of the shape at uniform density; ``friction`` is the coefficient
    against others, ``damping`` the rate at which its motion decays [1/s].
    """

    shape: Shape
    pose: tuple[float, ...]
    kind: int = STILL
    mass: float = 0.0
    inertia: tuple[float, ...] | None = None
    friction: float = 0.5
    damping: float = 0.0


def available() -> bool:
    """Tell whether MuJoCo is installed."""
    return importlib.util.find_spec("mujoco") is not None


def build_bodies(bodies: Sequence[Body], gravity: tuple[float, float, float], period: float) -> Bodies:
    """Compile the bodies of a world; ``gravity`` in m/s2, ``period`` of a step in s.

    Raises
    ------
    BodyError
        If a body cannot be made.
    """
    import mujoco

    mujoco.set_mju_user_warning(_ignore)  # otherwise MuJoCo writes a file to the working folder
    # MuJoCo knows the middle of a mesh when it has made its hull. A step keeps the momentum only of a body whose frame
    # is at its centre of mass, so that then a second model is made with the frames there.
    even = [replace(body, mass=1.0, inertia=None) if body.inertia is not None else body for body in bodies]
    centres = np.zeros((len(bodies), 3))
    model = _compiled(mujoco, even, centres, gravity, period)
    free = [i for i, body in enumerate(bodies) if body.kind == FREE]
    ids = np.array([model.body(f"o{i}").id for i in free], np.intp)
    ease = np.ones(len(bodies))
    for i, body, shape in zip(free, ids, _inertias(mujoco, model, ids), strict=True):
        if isinstance(bodies[i].shape, Mesh):
            centres[i] = model.body_ipos[body]
        given = bodies[i].inertia
        if given is not None:
            half = np.linalg.inv(np.linalg.cholesky(shape * bodies[i].mass))
            ease[i] = np.linalg.eigvalsh(half @ np.diag(given) @ half.T)[0]
    if centres.any() or any(body.inertia is not None for body in bodies):
        model = _compiled(mujoco, bodies, centres, gravity, period)
    return Bodies(model, tuple(bodies), centres, tuple(ease.tolist()))


def _compiled(
    mujoco: Any, bodies: Sequence[Body], centres: Floats, gravity: tuple[float, float, float], period: float
) -> Any:
    """Return MuJoCo's model of bodies with these centres of mass in their frames (n, 3) [m]."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = period, gravity
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0  # resting bodies do not creep
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    meshes: dict[int, str] = {}
    for index, body in enumerate(bodies):
        _add(mujoco, spec, index, body, centres[index], meshes)
    try:
        return spec.compile()
    except ValueError as error:
        raise BodyError(_which(str(error), bodies), _reason(str(error))) from None


def _ignore(message: str) -> None:
    """Ignore a warning: MuJoCo resets a body that diverges to its initial pose, where it can be seen."""


def _which(message: str, bodies: Sequence[Body]) -> int:
    """Return the index of the object that a message of the compiler names, or of the first free one."""
    named = [i for i in range(len(bodies)) if f"'o{i}'" in message or f"'m{i}'" in message]
    free = [i for i, body in enumerate(bodies) if body.kind == FREE]
    return (named or free or [0])[0]


#: What MuJoCo's compiler complains of, and what that means here.
_REASONS = {
    "coplanar": "its mesh is flat, and MuJoCo makes no convex hull of it; use a thin box instead",
    "volume": "its mesh encloses too little for MuJoCo; a box or another primitive can be one",
    "mjMINVAL": "it is so small or light that MuJoCo takes its inertia for zero; state its inertia, or make it larger",
    "A + B >= C": "none of its three moments of inertia can exceed the sum of the other two",
}


def _reason(message: str) -> str:
    """Return in our own words what MuJoCo's compiler says, or its message where we have none."""
    known = (sentence for word, sentence in _REASONS.items() if word in message)
    return next(known, " ".join(message.split()))


def _add(mujoco: Any, spec: Any, index: int, body: Body, centre: Floats, meshes: dict[int, str]) -> None:
    if body.kind == FREE and isinstance(body.shape, Plane):
        raise BodyError(index, "a plane has no end and cannot be a free body")
    parent = spec.worldbody
    place: dict[str, Any] = {"pos": body.pose[:3], "quat": body.pose[3:]}
    if body.kind != STILL:
        if centre.any():
            arm = np.empty(3)
            mujoco.mju_rotVecQuat(arm, centre, np.array(body.pose[3:]))
            place["pos"] = place["pos"] + arm
        parent = spec.worldbody.add_body(name=f"o{index}", mocap=body.kind == MOVED, **place)
        place = {"pos": -centre} if centre.any() else {}
    form = _form(mujoco, spec, index, body, meshes)
    geom = parent.add_geom(name=f"{'s' if body.kind == STILL else 'o'}{index}", **form, **place)
    geom.friction = (body.friction, 0.005, 0.0001)
    geom.solref = (max(0.004, 4.0 * spec.option.timestep), 1.0)  # as stiff as the step allows
    if body.kind != FREE:
        return
    parent.add_freejoint(name=f"o{index}")
    if body.inertia is None:
        geom.mass = body.mass
        return
    geom.mass = 0.0
    parent.explicitinertial = True
    parent.mass, parent.inertia, parent.ipos = body.mass, body.inertia, (0.0, 0.0, 0.0)


def _form(mujoco: Any, spec: Any, index: int, body: Body, meshes: dict[int, str]) -> dict[str, Any]:
    kinds, shape = mujoco.mjtGeom, body.shape
    if isinstance(shape, Box):
        return {"type": kinds.mjGEOM_BOX, "size": shape.half_extents}
    if isinstance(shape, Sphere):
        return {"type": kinds.mjGEOM_SPHERE, "size": (shape.radius, 0.0, 0.0)}
    if isinstance(shape, Capsule):
        return {"type": kinds.mjGEOM_CAPSULE, "size": (shape.radius, shape.half_length, 0.0)}
    if isinstance(shape, Cylinder):
        return {"type": kinds.mjGEOM_CYLINDER, "size": (shape.radius, shape.half_length, 0.0)}
    if isinstance(shape, Mesh):
        surface = shape.surface
        if id(surface) not in meshes:
            meshes[id(surface)] = f"m{index}"
            vertices, triangles, _ = surface.tables
            spec.add_mesh(
                name=f"m{index}", uservert=vertices[:, :3].ravel().tolist(), userface=triangles[:, :3].ravel().tolist(),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
            )  # fmt: skip
        return {"type": kinds.mjGEOM_MESH, "meshname": meshes[id(surface)]}
    return {"type": kinds.mjGEOM_PLANE, "size": (0.0, 0.0, 1.0)}


class Bodies:
    """The compiled bodies; ``make`` returns a `Physics` to step them.

    ``centres`` (n, 3) are their centres of mass in the objects' frames [m]; ``ease`` says of each what share of its
    shape's inertia at uniform density its own is, at least, about any axis (1 where none is given).
    """

    __slots__ = ("_model", "bodies", "centres", "ease", "free", "moved", "state_size")

    def __init__(self, model: Any, bodies: tuple[Body, ...], centres: Floats, ease: tuple[float, ...]) -> None:
        import mujoco

        self._model, self.bodies, self.centres, self.ease = model, bodies, centres, ease
        self.free = tuple(i for i, body in enumerate(bodies) if body.kind == FREE)
        self.moved = tuple(i for i, body in enumerate(bodies) if body.kind == MOVED)
        self.state_size = int(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))

    def make(self) -> Physics:
        """Return a `Physics` with scratch memory of its own."""
        return Physics(self._model, self)


def _inertias(mujoco: Any, model: Any, ids: NDArray[np.intp]) -> Floats:
    """Return the inertia of bodies about their centres of mass, along their own axes (k, 3, 3) [kg m2].

    MuJoCo keeps three moments about the principal axes, which are those of the frame only where the shape has them so:
    for a mesh they lie as the mass does, the greatest moment first.
    """
    rows = np.empty((len(ids), 9))
    for row, body in zip(rows, ids, strict=True):
        mujoco.mju_quat2Mat(row, model.body_iquat[body])
    turns = rows.reshape(-1, 3, 3)
    return np.ascontiguousarray(np.einsum("kij,kj,klj->kil", turns, model.body_inertia[ids], turns))


class Physics:
    """Steps the bodies; it keeps nothing from one call to the next."""

    def __init__(self, model: Any, bodies: Bodies) -> None:
        import mujoco

        self._mujoco, self._model, self._data = mujoco, model, mujoco.MjData(model)
        self._kind = int(mujoco.mjtState.mjSTATE_INTEGRATION)
        self._free, self._moved = np.array(bodies.free, np.intp), np.array(bodies.moved, np.intp)
        names = [model.body(f"o{i}").id for i in bodies.free]
        self._ids = np.array(names, np.intp)
        self._slots = np.array([model.body_mocapid[model.body(f"o{i}").id] for i in bodies.moved], np.intp)
        self._centres = np.ascontiguousarray(bodies.centres[self._free])
        self._physics = (
            self._free, self._ids, self._centres, model.body_mass[self._ids],
            _inertias(mujoco, model, self._ids), np.array([bodies.bodies[i].damping for i in bodies.free]),
        )  # fmt: skip
        self._places = self._data.qpos.reshape(-1, 7)
        self._rates = self._data.qvel.reshape(-1, 6)
        self._push = self._data.xfrc_applied

    def start(self, state: Floats) -> None:
        """Write the initial state: MuJoCo's integration state (state_size,) [SI], in the layout of ``mj_getState``."""
        self._mujoco.mj_resetData(self._model, self._data)
        self._mujoco.mj_getState(self._model, self._data, state, self._kind)

    def take_over(self, state: Floats, poses: Floats) -> None:
        """Put centres of mass to where they are in a State that an earlier program has stored.

        That had the origins of the objects' frames in their place.  ``state`` (state_size,), rewritten if it is such a
        one; ``poses`` (n, 7) of all objects [m; quaternion].
        """
        mujoco, data, arm, spin = self._mujoco, self._data, np.empty(3), np.empty(3)
        mujoco.mj_setState(self._model, data, state, self._kind)
        for index, centre, place, rates in zip(self._free, self._centres, self._places, self._rates, strict=True):
            if not centre.any() or (place[:3] != poses[index, :3]).any():  # `read_back` makes them differ by the arm
                continue
            mujoco.mju_rotVecQuat(arm, centre, place[3:])
            mujoco.mju_rotVecQuat(spin, rates[3:], place[3:])
            place[:3] += arm
            rates[:3] += np.cross(spin, arm)
            mujoco.mj_getState(self._model, data, state, self._kind)

    def step(self, state: Floats, forces: Floats, poses: Floats, twists: Floats) -> None:
        """Advance by one period.

        Parameters
        ----------
        state
            Bodies.state_size numbers, rewritten.
        forces
            (n, 6): force and torque about the origin of each object's frame, in the world frame [N, N m].
        poses, twists
            (n, 7) and (n, 6) of all objects: read for those that are moved, written for those that are free.
        """
        mujoco, data = self._mujoco, self._data
        mujoco.mj_setState(self._model, data, state, self._kind)
        if len(self._moved):
            data.mocap_pos[self._slots] = poses[self._moved, :3]
            data.mocap_quat[self._slots] = poses[self._moved, 3:]
        apply_forces(*self._physics, poses, self._rates, forces, self._push)
        mujoco.mj_step(self._model, data)
        mujoco.mj_getState(self._model, data, state, self._kind)
        read_back(self._free, self._centres, self._places, self._rates, poses, twists)
