"""The interface of the table's three servos, and the choice of their driver (moteus, ODrive, TMCL) for a scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from itouch.plugin import Trace
from itouch_xyz_table.odrive import Odrives
from itouch_xyz_table.servos import Goal, Servos, ServoState
from itouch_xyz_table.tmcl import Steppers


class Drives(Protocol):
    """Three servos on an open bus; each call is one exchange.  All raise `ServoError`, which names the axis."""

    def query(self) -> tuple[ServoState, ...]:
        """Read the state of all servos."""

    def command(self, goals: Sequence[Goal | None]) -> tuple[ServoState, ...]:
        """Command the servos that have a goal, and read the state of all."""

    def stop(self, *, latched: bool = False) -> tuple[ServoState, ...]:
        """Stop all servos without force and clear latched faults; ``latched``: return the states after that."""

    def set_position(self, axis: int, position: float) -> None:
        """Tell a servo that it is at ``position`` [rev]."""

    def ready(self) -> None:
        """Prepare the servos to follow their first command at once."""

    def close(self) -> None:
        """Release the bus."""


def opened(params: Any, watchdog: float, patience: float, trace: Trace | None) -> Drives:
    """Open the bus that the table's parameters name.

    Raises
    ------
    DeviceError
        If it is missing or cannot be opened.
    """
    if params.tmcl:
        leads = [lead * sign for lead, sign in zip(params.lead, params.direction, strict=True)]
        return Steppers(
            params.tmcl, baud=params.baud, address=params.address, motors=[int(number) for number in params.motors],
            microsteps=params.microsteps, leads=leads, speed=params.speed, acceleration=params.acceleration,
            watchdog=watchdog if params.heartbeat else None, patience=patience, trace=trace,
        )  # fmt: skip
    ids = [int(number) for number in params.ids]
    if params.bus:
        constants = params.torque_constant
        return Odrives(params.bus, ids, torque_constants=constants, patience=patience, trace=trace)
    return Servos(params.port, ids, watchdog=watchdog, patience=patience, trace=trace)
