"""Objects that move by a script or with a device: their poses and twists at a tick."""

import math

import numpy as np

from itouch.blocks import Block
from itouch.contact.kernel_decorators import entry, inner
from itouch.contact.vectors import Floats, Vector, add, along, cross, dot, norm

# --- one piece of a script: start, duration [s]; first position, displacement [m]; first orientation, rotation vector
_piece = Block()
PIECE_START, PIECE_TIME, PIECE_SMOOTH = _piece.parts(1, 1, 1)
PIECE_FROM, PIECE_WAY, PIECE_QUATERNION, PIECE_TURN = _piece.parts(3, 3, 4, 3)
PIECE_WIDTH = _piece.width
# --- one scripted object: its index, its first piece and the one after its last, its duration [s], whether it repeats
_script = Block()
SCRIPT_OBJECT, SCRIPT_FIRST, SCRIPT_END, SCRIPT_TIME, SCRIPT_REPEAT = _script.parts(1, 1, 1, 1, 1)
SCRIPT_WIDTH = _script.width

Quaternion = tuple[float, float, float, float]


@inner
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the product a b of two quaternions: the rotation by ``b``, followed by ``a``."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@inner
def rotation_by(turn: Vector) -> Quaternion:
    """Quaternion of a rotation vector [rad]."""
    angle = norm(turn)
    if angle < 1e-12:
        return (1.0, 0.5 * turn[0], 0.5 * turn[1], 0.5 * turn[2])
    scale = math.sin(0.5 * angle) / angle
    return (math.cos(0.5 * angle), scale * turn[0], scale * turn[1], scale * turn[2])


@inner
def _put_pose(poses: Floats, obj: int, place: Vector, q: Quaternion) -> None:
    size = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for c in range(3):
        poses[obj, c] = place[c]
    for c in range(4):
        poses[obj, 3 + c] = q[c] / size


@inner
def _piece_at(pieces: Floats, first: int, end: int, time: float) -> int:
    """Return the last piece that has begun at a time."""
    low, high = first, end - 1
    while low < high:
        middle = (low + high + 1) // 2
        if pieces[middle, PIECE_START] <= time:
            low = middle
        else:
            high = middle - 1
    return low


@entry
def move_scripted(scripts: Floats, pieces: Floats, time: float, poses: Floats, twists: Floats) -> None:
    """Write poses and twists of all scripted objects at a time on their scripts [s].

    Each piece is a straight line and a rotation about a fixed axis, with minimum jerk (Flash and Hogan 1985) or at
    constant speed; the twist is the exact derivative.

    ``scripts`` (scripted, SCRIPT_WIDTH), ``pieces`` (all, PIECE_WIDTH); ``poses`` (objects, 7) [m; quaternion],
    ``twists`` (objects, 6) [m/s, rad/s].
    """
    for s in range(scripts.shape[0]):
        obj, span = int(scripts[s, SCRIPT_OBJECT]), scripts[s, SCRIPT_TIME]
        now = time
        if scripts[s, SCRIPT_REPEAT] > 0.0:
            now = time - span * math.floor(time / span)
        k = _piece_at(pieces, int(scripts[s, SCRIPT_FIRST]), int(scripts[s, SCRIPT_END]), now)
        duration = pieces[k, PIECE_TIME]
        x = (now - pieces[k, PIECE_START]) / duration
        share, rate = min(max(x, 0.0), 1.0), 0.0
        if 0.0 <= x < 1.0 or scripts[s, SCRIPT_REPEAT] > 0.0:  # rounding may put ``now`` beside the period, not at rest
            rate = 1.0 / duration
        if pieces[k, PIECE_SMOOTH] > 0.0:
            rate *= 30.0 * share * share * (1.0 - share) * (1.0 - share)
            share = share * share * share * (10.0 + share * (6.0 * share - 15.0))
        turn = (share * pieces[k, PIECE_TURN], share * pieces[k, PIECE_TURN + 1], share * pieces[k, PIECE_TURN + 2])
        c = PIECE_QUATERNION
        q = product(rotation_by(turn), (pieces[k, c], pieces[k, c + 1], pieces[k, c + 2], pieces[k, c + 3]))
        f, w = PIECE_FROM, PIECE_WAY
        place = (
            pieces[k, f] + share * pieces[k, w],
            pieces[k, f + 1] + share * pieces[k, w + 1],
            pieces[k, f + 2] + share * pieces[k, w + 2],
        )
        _put_pose(poses, obj, place, q)
        for c in range(3):
            twists[obj, c] = rate * pieces[k, PIECE_WAY + c]
            twists[obj, 3 + c] = rate * pieces[k, PIECE_TURN + c]


@inner
def _rotated(q: Quaternion, v: Vector) -> Vector:
    axis = (q[1], q[2], q[3])
    scale = 2.0 / (q[0] * q[0] + dot(axis, axis))
    once = cross(axis, v)
    return add(along(v, scale * q[0], once), along((0.0, 0.0, 0.0), scale, cross(axis, once)))


@entry
def carry(
    obj: int, frame: Floats, reading: Floats, offset: Floats, period: float, smooth: float, first: bool,
    poses: Floats, twists: Floats,
) -> None:  # fmt: skip
    """Write pose and twist of an object that a device carries.

    Parameters
    ----------
    obj
        Its index.
    frame, reading, offset
        Poses (7,) [m; quaternion]: of the device in the world, of what it carries in the device, of the object in what
        is carried. A reading that is not finite, or still all zero, leaves the object where it is.
    period, smooth
        Length of a tick [s]; share of the new velocity in the filtered one.
    first
        Whether there is no earlier pose to take a velocity from.
    poses, twists
        (objects, 7) and (objects, 6); the object's row is written.
    """
    length = 0.0
    for c in range(7):
        if not np.isfinite(reading[c]):
            return
        if c >= 3:
            length += reading[c] * reading[c]
    if length < 0.25:  # nothing has been read yet
        return
    world = (frame[3], frame[4], frame[5], frame[6])
    device = product(world, (reading[3], reading[4], reading[5], reading[6]))
    place = add((frame[0], frame[1], frame[2]), _rotated(world, (reading[0], reading[1], reading[2])))
    place = add(place, _rotated(device, (offset[0], offset[1], offset[2])))
    q = product(device, (offset[3], offset[4], offset[5], offset[6]))
    old = (poses[obj, 3], -poses[obj, 4], -poses[obj, 5], -poses[obj, 6])
    d = product(q, old)
    size = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + d[3] * d[3])
    sign = 1.0 if d[0] >= 0.0 else -1.0
    sine = math.sqrt(d[1] * d[1] + d[2] * d[2] + d[3] * d[3]) / size
    scale = sign * 2.0 / size if sine < 1e-9 else sign * 2.0 * math.asin(min(sine, 1.0)) / (sine * size)
    for c in range(3):
        if first:
            twists[obj, c] = twists[obj, 3 + c] = 0.0
            continue
        twists[obj, c] += smooth * ((place[c] - poses[obj, c]) / period - twists[obj, c])
        twists[obj, 3 + c] += smooth * (scale * d[1 + c] / period - twists[obj, 3 + c])
    _put_pose(poses, obj, place, q)
