"""The compiled link between the contact engine's objects and MuJoCo's bodies: forces in, poses and twists out."""

from typing import Any

from itouch.contact import layout as at
from itouch.contact.kernel_decorators import entry, inner
from itouch.contact.rotations import to_space
from itouch.contact.vectors import Floats, Vector, along, cross, dot, place_of, sub, vector

ORIGIN = (0.0, 0.0, 0.0)


@inner
def _apply(forces: Floats, poses: Floats, obj: int, point: Vector, force: Vector) -> None:
    torque = cross(sub(point, place_of(poses, obj)), force)
    for c in range(3):
        forces[obj, c] += force[c]
        forces[obj, 3 + c] += torque[c]


@entry
def push_bodies(force_at: Floats, result: Floats, poses: Floats, forces: Floats) -> None:
    """Add the reaction of one probe on the objects: the opposite of its force, at its contacts, by their shares.

    Without a contact the force is an attraction by the nearest object, which then gets the reaction.

    ``force_at`` (3,) [N], ``result`` (RESULT_SIZE,) of the contact, ``poses`` (objects, 7) [m; quaternion],
    ``forces`` (objects, 6) [N, N m].
    """
    force = vector(force_at, 0)
    count = int(result[at.RESULT_COUNT])
    for c in range(count):
        row = at.RESULT_CONTACTS + c * at.CONTACT_WIDTH
        share = along(ORIGIN, -result[row + at.CONTACT_SHARE], force)
        _apply(forces, poses, int(result[row + at.CONTACT_OBJECT]), vector(result, row + at.CONTACT_POINT), share)
    if count == 0 and result[at.RESULT_NEAREST] >= 0.0 and dot(force, force) > 0.0:
        point = vector(result, at.RESULT_NEAREST_POINT)
        _apply(forces, poses, int(result[at.RESULT_NEAREST]), point, along(ORIGIN, -1.0, force))


@inner
def _spin(poses: Floats, obj: int, rates: Floats, i: int) -> Vector:
    """Angular velocity in the world frame; MuJoCo has it in the body's."""
    return to_space(poses, obj, (rates[i, 3], rates[i, 4], rates[i, 5]))


@inner
def _times(matrices: Any, i: int, v: Vector) -> Vector:
    """Return the product of the matrix ``i`` of (k, 3, 3) and a vector."""
    return (
        matrices[i, 0, 0] * v[0] + matrices[i, 0, 1] * v[1] + matrices[i, 0, 2] * v[2],
        matrices[i, 1, 0] * v[0] + matrices[i, 1, 1] * v[1] + matrices[i, 1, 2] * v[2],
        matrices[i, 2, 0] * v[0] + matrices[i, 2, 1] * v[1] + matrices[i, 2, 2] * v[2],
    )


@entry
def apply_forces(
    free: Any, ids: Any, centres: Floats, masses: Floats, inertias: Floats, damping: Floats, poses: Floats,
    rates: Floats, forces: Floats, push: Floats,
) -> None:  # fmt: skip
    """Write the forces at the bodies' centres of mass, with a drag in proportion to momentum.

    Parameters
    ----------
    free, ids
        (k,) indices of the free objects, and their rows in ``push``.
    centres, masses, inertias, damping
        (k, 3) centres of mass in the object's frame [m], (k,) [kg], (k, 3, 3) about the centres of mass, along the
        frame's axes [kg m2], and (k,) [1/s].
    poses, rates
        (n, 7) of all objects; (k, 6) of the free ones: velocity of the centre of mass in the world's frame, angular
        velocity in the body's frame.
    forces, push
        (n, 6) force and torque about the frames' origins; written: those about the centres of mass [N, N m].
    """
    for i in range(free.shape[0]):
        obj, row = int(free[i]), int(ids[i])
        arm = to_space(poses, obj, (centres[i, 0], centres[i, 1], centres[i, 2]))
        speed = (rates[i, 0], rates[i, 1], rates[i, 2])
        force = (forces[obj, 0], forces[obj, 1], forces[obj, 2])
        torque = sub((forces[obj, 3], forces[obj, 4], forces[obj, 5]), cross(arm, force))
        local = _times(inertias, i, (rates[i, 3], rates[i, 4], rates[i, 5]))
        force = along(force, -damping[i] * masses[i], speed)
        torque = along(torque, -damping[i], to_space(poses, obj, local))
        for c in range(3):
            push[row, c], push[row, 3 + c] = force[c], torque[c]


@entry
def read_back(free: Any, centres: Floats, places: Floats, rates: Floats, poses: Floats, twists: Floats) -> None:
    """Write poses and twists of the free objects from MuJoCo's coordinates (k, 7) and rates (k, 6).

    MuJoCo's are those of the centres of mass, ``centres`` (k, 3) in the objects' frames [m].  ``free`` (k,) indices of
    the objects; positions [m], velocities [m/s, rad/s]; ``poses`` (n, 7) and ``twists`` (n, 6) of all objects.
    """
    for i in range(free.shape[0]):
        obj = int(free[i])
        for c in range(7):
            poses[obj, c] = places[i, c]
        spin = _spin(poses, obj, rates, i)
        arm = to_space(poses, obj, (centres[i, 0], centres[i, 1], centres[i, 2]))
        around = cross(spin, arm)
        for c in range(3):
            poses[obj, c] -= arm[c]
            twists[obj, c] = rates[i, c] - around[c]
            twists[obj, 3 + c] = spin[c]
