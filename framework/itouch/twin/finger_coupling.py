"""Couples the finger's twin to the other twins: the arm that pushes it, the plate below it, the force between them.

The finger's twin is purely mechanical.  The arm's wrench and the plate's force act on it, never the virtual force.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Bound, Record, Role, TwinInputs
from itouch.twin import mechanics as at
from itouch.twin.hand import Hand

Vector = tuple[float, float, float]
Floats = NDArray[np.float64]


class Body(Protocol):
    """A frame: origin and rotation matrix, row by row."""

    @property
    def origin(self) -> Vector:
        """Position of the origin [m]."""

    @property
    def r(self) -> tuple[float, ...]:
        """Rotation matrix."""


class CoupledDevice(Protocol):
    """A device's runner, as the coupling sees it."""

    touch: TwinInputs

    def sent_as(self, role: Role) -> Floats:
        """Return the view of the first command with a role, as the supervisor sends it; zeros if there is none."""

    def true_frame(self) -> Body:
        """Return the device's true frame in its carrier."""

    def true_position(self) -> Floats | None:
        """Return the view of State with the true position [m] of what the twin carries, or None."""


class Coupling:
    """Steps the finger, and writes what touches them to the inputs of the twins of arm, table and plate."""

    def __init__(
        self,
        hand: Hand | None,
        radius: float,
        arm: CoupledDevice | None,
        table: CoupledDevice | None,
        face: CoupledDevice | None,
        offset: Vector,
        extent: tuple[float, float, float, float] | None,
        state: Record,
        name: str,
        period: float,
    ) -> None:
        self.hand, self._arm, self._table, self._face = hand, arm, table, face
        self._constants = _constants(hand, radius, arm, table, offset, extent, period)
        self._hip: Floats = state[f"{name}.hip"]
        self._tick, self.touched = state["tick"], state[f"{name}.plate_touched"]
        self.figures: Floats = state.flat(f"{name}.plate_force", f"{name}.total_force")
        self.true_top, self.total = state[f"{name}.plate_true_top"], state[f"{name}.total_force"]
        self._push: Floats = arm.sent_as(Role.FORCE_ON_OPERATOR)[:3] if arm is not None else np.zeros(3)
        self._load: Floats = table.touch.wrench[:3] if table is not None else np.zeros(3)
        self._pieces: Floats = hand.path.pieces if hand is not None else np.ones((1, 8))
        self._end, self._pace = np.zeros(7), np.zeros(6)
        pushed = f"{name}.pushed"  # in State, as it acts in the next tick
        self._pushed: Floats = state[pushed] if pushed in state else np.zeros((0, 3))
        carried = table.true_position() if table is not None else None
        self._carrier: Floats = np.array([0.0, 0.0, -1e3]) if carried is None else carried
        if arm is not None and hand is not None:
            self._end, self._pace = arm.touch.finger_pose, arm.touch.finger_twist
            arm.touch.finger_attached = True
        #: The force of its arm and its plate on the finger, world frame, shape (3,) [N].
        self.given: Floats = np.zeros(3)
        #: The step of the finger as one compiled call; the hand's ``advance`` comes before it.
        self.bound = self._bind(np.zeros((0, 3)))

    def _bind(self, others: Floats) -> Bound:
        hand, face = self.hand, self._face
        hand_time, hand_offset, motion = (
            (hand.time, hand.offset, hand.motion) if hand is not None else (np.zeros(1), np.zeros(3), np.zeros(9))
        )
        bound = Bound(
            at.couple_finger, self._constants, at.Led(self._pieces, hand_offset, motion),
            at.Pushes(self._push, others, self.given),
            at.Touched(self._carrier, self.figures, self._end, self._pace, self._load), hand_time, self._hip,
            self._tick, self.touched, face.touch.force_and_gap if face is not None else np.zeros(2),
        )  # fmt: skip
        bound.warm_up()
        return bound

    def join(self, others: Sequence[tuple[Coupling, CoupledDevice | None]]) -> None:
        """Let other probes that are on the same finger touch and push this probe's finger, each with its own arm."""
        if self.hand is None or not others:
            return
        pushes = self._pushed
        self.bound = self._bind(pushes)
        for (other, arm), push in zip(others, pushes, strict=True):
            other.follow(self.hand, arm, push)

    def follow(self, leader: Hand, arm: CoupledDevice | None, push: Floats) -> None:
        """Touch the finger that another hand moves; write the force of arm and plate on it to ``push`` (3,) [N]."""
        person = leader.operator
        self._constants[at.PAD_STIFFNESS], self._constants[at.PAD_DAMPING] = person.pad_stiffness, person.pad_damping
        self._hip, self.given, self._push = leader.motion[:3], push, np.zeros(3)
        if arm is not None:
            self._constants[at.ARM : at.ARM + 3] = arm.true_frame().origin
            self._constants[at.ARM + 3 : at.ARM + 12] = arm.true_frame().r
            self._push = arm.sent_as(Role.FORCE_ON_OPERATOR)[:3]
        self.bound = self._bind(np.zeros((0, 3)))

    def reset(self) -> None:
        """Start without a touch."""
        self.figures[at.DISTANCE] = 1.0
        self.touched[...] = -1

    def place(self) -> None:
        """Write the finger's position and velocity to the arm's inputs, before anything has moved."""
        if self.hand is not None:
            at.tell_arm(self._constants, self.hand.motion, self._end, self._pace)


def _constants(
    hand: Hand | None,
    radius: float,
    arm: CoupledDevice | None,
    table: CoupledDevice | None,
    offset: Vector,
    extent: tuple[float, float, float, float] | None,
    period: float,
) -> Floats:
    """Return the constants of the mechanics; without a table the plate is far below everything.

    ``extent``: half extents [m] of the plate along its own axes, and the direction of its x axis in its carrier's frame
    (cosine and sine of its heading); None: it has no edge.
    """
    constants = np.zeros(at.CONSTANTS)
    for start, stand in ((at.ARM, arm), (at.TABLE, table)):
        upright = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
        origin, rotation = (stand.true_frame().origin, stand.true_frame().r) if stand is not None else upright
        constants[start : start + 3], constants[start + 3 : start + 12] = origin, rotation
    constants[at.OFFSET : at.OFFSET + 3] = offset
    constants[at.EXTENT : at.EXTENT + 2], constants[at.HEADING : at.HEADING + 2] = (np.inf, np.inf), (1.0, 0.0)
    if extent is not None:
        constants[at.EXTENT : at.EXTENT + 2], constants[at.HEADING : at.HEADING + 2] = extent[:2], extent[2:]
    constants[at.RADIUS], constants[at.PERIOD] = radius, period
    if hand is not None:
        person = hand.operator
        constants[at.PAD_STIFFNESS], constants[at.PAD_DAMPING] = person.pad_stiffness, person.pad_damping
        constants[at.MASS], constants[at.STIFFNESS], constants[at.DAMPING] = (
            person.mass, person.stiffness, person.damping,
        )  # fmt: skip
    return constants
