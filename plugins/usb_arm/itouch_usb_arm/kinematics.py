"""Kinematics of the Novint Falcon's delta mechanism: pure functions in metres, radians, newtons and newton metres.

Frame: x and y in the fixed plate, z from the plate to the operator; `LEGS` are the legs' angles about z.
Geometry after L.-W. Stamper, *A three degree of freedom
parallel manipulator with only translational degrees of freedom*, University of Maryland 1997; sizes of the Falcon as
published by libnifalcon.  The Jacobian is derived analytically and agrees with the derivative of the closed form.

For each leg, turned by ``phi``: ``u = cos(phi) x + sin(phi) y - R``, ``v = -sin(phi) x + cos(phi) y - S``, ``w = z``
and ``U = u + C``.  The lower link of length ``B`` leans sideways by ``theta3``; in the plane of the leg, the upper
link ``A`` is at ``theta1`` and the lower one, of apparent length ``D + E + B sin(theta3)``, at ``theta2``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

#: Sizes [m]: upper link, lower link, and the offsets of the joints.
A, B, C, D, E, F, R, S = 0.060, 0.1025, 0.01443, 0.01125, 0.01125, -0.025, 0.040, -0.02309
#: Angles of the legs about z [rad].
LEGS = tuple(math.radians(degrees + 15.0) for degrees in (90.0, -30.0, -150.0))
_TURNS = tuple((math.cos(phi), math.sin(phi)) for phi in LEGS)
#: Encoder counts per radian of a leg: 320 slots of four edges each, capstan 110 mm on 14.25 mm.
COUNTS_PER_RADIAN = 320 * 4 * (0.110 / 0.01425) / math.tau
#: Angle of a leg at count zero [rad].
ZERO_ANGLE = math.radians(35.0)
#: A point well inside the workspace [m], where the forward kinematics may start.
CENTRE: Vector = (0.0, 0.0, 0.125)

#: Newton's method: most steps, error at which it stops and error that is accepted [rad], and number of parts of a walk.
_STEPS, _TOLERANCE, _ACCEPTED, _PARTS = 40, 1e-13, 1e-11, 16


class UnreachableError(ValueError):
    """A position or a set of angles that the mechanism cannot take."""


class Leg(NamedTuple):
    """The angles of one leg [rad]: motor, lower link in the leg's plane, lower link's lean."""

    theta1: float
    theta2: float
    theta3: float


def legs(position: Sequence[float]) -> tuple[Leg, Leg, Leg]:
    """Return all angles of the three legs at a position [m] of the grip.

    Raises
    ------
    UnreachableError
        If some leg cannot reach the position.
    """
    x, y, z = position
    one, two, three = (_leg(x, y, z, cosine, sine) for cosine, sine in _TURNS)
    return one, two, three


def _leg(x: float, y: float, z: float, cosine: float, sine: float) -> Leg:
    across = (-sine * x + cosine * y - S + F) / B
    out = cosine * x + sine * y - R + C
    if not -1.0 < across < 1.0:
        raise UnreachableError(f"({x:.4f}, {y:.4f}, {z:.4f}) m is out of the arm's reach: a lower link is too short")
    theta3 = math.acos(across)
    length = D + E + B * math.sin(theta3)
    distance = math.hypot(out, z)
    if distance == 0.0:
        raise UnreachableError(f"({x:.4f}, {y:.4f}, {z:.4f}) m is on a motor's axis")
    bend = (distance * distance + A * A - length * length) / (2.0 * A * distance)
    if not -1.0 < bend < 1.0:
        raise UnreachableError(f"({x:.4f}, {y:.4f}, {z:.4f}) m is out of the arm's reach")
    theta1 = math.atan2(z, out) - math.acos(bend)
    theta2 = math.atan2(z - A * math.sin(theta1), out - A * math.cos(theta1))
    return Leg(theta1, theta2, theta3)


def inverse(position: Sequence[float]) -> Vector:
    """Return the motor angles [rad] of the three legs at a position [m], closed form.

    Raises
    ------
    UnreachableError
        If some leg cannot reach the position.
    """
    one, two, three = legs(position)
    return one.theta1, two.theta1, three.theta1


def jacobian(position: Sequence[float]) -> Matrix:
    """Return d(motor angles)/d(position) [rad/m], shape (3, 3), one row a leg.

    Raises
    ------
    UnreachableError
        If some leg cannot reach the position or is stretched out.
    """
    return _rows(legs(position))


def _rows(at: tuple[Leg, Leg, Leg]) -> Matrix:
    one, two, three = (_row(leg, cosine, sine) for leg, (cosine, sine) in zip(at, _TURNS, strict=True))
    return one, two, three


def _row(leg: Leg, cosine: float, sine: float) -> Vector:
    lean, leant = math.sin(leg.theta3), math.cos(leg.theta3)
    scale = A * lean * math.sin(leg.theta2 - leg.theta1)
    if abs(scale) < 1e-9:
        raise UnreachableError("a leg is stretched out: no velocity of its motor moves the grip")
    plane = math.cos(leg.theta2) * lean
    return (
        (cosine * plane - sine * leant) / scale,
        (sine * plane + cosine * leant) / scale,
        math.sin(leg.theta2) * lean / scale,
    )


def forward(angles: Sequence[float], *, start: Sequence[float] = CENTRE) -> Vector:
    """Return the position [m] of the grip at these motor angles [rad], by Newton's method from ``start``.

    Steps that leave the workspace are halved.  From the last position of a moving arm two or three steps suffice; if
    it fails from there and from the workspace's centre, it walks from the centre's angles to these in small parts.

    Raises
    ------
    UnreachableError
        If no position has these angles.
    """
    a, b, c = angles
    goal = (a, b, c)
    if not all(math.isfinite(angle) for angle in goal):
        raise UnreachableError(f"no position has the motor angles {goal!r}")
    x, y, z = start
    found = _newton(goal, (x, y, z)) or _newton(goal, CENTRE) or _walk(goal)
    if found is None:
        degrees = ", ".join(f"{math.degrees(angle):.2f}" for angle in goal)
        raise UnreachableError(f"no position has the motor angles {degrees} degrees")
    return found


def _walk(goal: Vector) -> Vector | None:
    """Solve from the centre to the angles in small parts, each from the solution before; None if a part fails."""
    begin, place = inverse(CENTRE), CENTRE
    for part in range(1, _PARTS + 1):
        there = tuple(a + (b - a) * part / _PARTS for a, b in zip(begin, goal, strict=True))
        found = _newton((there[0], there[1], there[2]), place)
        if found is None:
            return None
        place = found
    return place


def _newton(angles: Vector, start: Vector) -> Vector | None:
    """Return the position [m] that Newton's method finds from a start, or None."""
    x, y, z = start
    try:
        at = legs(start)
        error = _difference(at, angles)
        size = _size(error)
        for _ in range(_STEPS):
            if size < _TOLERANCE:
                break
            found = _shorter(x, y, z, solve(_rows(at), error), angles, size)
            if found is None:
                break
            (x, y, z), at, error, size = found
    except UnreachableError:
        return None
    return (x, y, z) if size < _ACCEPTED else None


def _shorter(
    x: float, y: float, z: float, step: Vector, angles: Vector, before: float
) -> tuple[Vector, tuple[Leg, Leg, Leg], Vector, float] | None:
    """Take the longest of step, step/2, step/4... that reduces the error; None if none does."""
    part = 1.0
    while part > 1e-6:
        place = (x - part * step[0], y - part * step[1], z - part * step[2])
        try:
            at = legs(place)
        except UnreachableError:
            part *= 0.5
            continue
        error = _difference(at, angles)
        size = _size(error)
        if size < before:
            return place, at, error, size
        part *= 0.5
    return None


def _difference(at: tuple[Leg, Leg, Leg], angles: Vector) -> Vector:
    a, b, c = angles
    return at[0].theta1 - a, at[1].theta1 - b, at[2].theta1 - c


def _size(error: Vector) -> float:
    return max(abs(error[0]), abs(error[1]), abs(error[2]))


def torques(position: Sequence[float], force: Sequence[float]) -> Vector:
    """Return the motor torques [N m] that exert ``force`` [N] on the operator: J^-T F, so that power is conserved.

    Raises
    ------
    UnreachableError
        If the position is out of the workspace.
    """
    (a, b, c), (d, e, f), (g, h, i) = jacobian(position)
    fx, fy, fz = force
    return solve(((a, d, g), (b, e, h), (c, f, i)), (fx, fy, fz))


def push(position: Sequence[float], torque: Sequence[float]) -> Vector:
    """Return the force on the operator [N] of these motor torques [N m]: J^T tau.

    Raises
    ------
    UnreachableError
        If the position is out of the workspace.
    """
    one, two, three = jacobian(position)
    p, q, r = torque
    x, y, z = (p * one[axis] + q * two[axis] + r * three[axis] for axis in range(3))
    return x, y, z


def solve(matrix: Matrix, right: Vector) -> Vector:
    """Solve a 3 by 3 system by Cramer's rule.

    Raises
    ------
    UnreachableError
        If the matrix is singular: the mechanism stands in a singular position.
    """
    (a, b, c), (d, e, f), (g, h, i) = matrix
    p, q, r = right
    ei, di, dh = e * i - f * h, d * i - f * g, d * h - e * g
    determinant = a * ei - b * di + c * dh
    if not abs(determinant) > 1e-30:
        raise UnreachableError("the mechanism stands in a singular position")
    return (
        (p * ei - b * (q * i - f * r) + c * (q * h - e * r)) / determinant,
        (a * (q * i - f * r) - p * di + c * (d * r - q * g)) / determinant,
        (a * (e * r - q * h) - b * (d * r - q * g) + p * dh) / determinant,
    )


def angles_of(counts: Sequence[int | float]) -> Vector:
    """Return the motor angles [rad] of encoder counts."""
    a, b, c = (ZERO_ANGLE + count / COUNTS_PER_RADIAN for count in counts)
    return a, b, c


def counts_of(angles: Sequence[float]) -> Vector:
    """Return the encoder counts of motor angles [rad], not rounded."""
    a, b, c = ((angle - ZERO_ANGLE) * COUNTS_PER_RADIAN for angle in angles)
    return a, b, c
