"""The interface of the table's three servos, and which make of them (moteus, ODrive, TMCL) a scene names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from itouch.plugin import Trace
from itouch_xyz_table.odrive import Odrives
from itouch_xyz_table.servos import Goal, Servos, ServoState
from itouch_xyz_table.tmcl import Steppers


class Drives(Protocol):
    """Three servos on an open bus; one call, one exchange.  Each raises `ServoError`, which names the axis."""

    def query(self) -> tuple[ServoState, ...]:
        """Ask all how they are."""

    def command(self, goals: Sequence[Goal | None]) -> tuple[ServoState, ...]:
        """Command servos and ask all; None: only ask that one."""

    def stop(self, *, latched: bool = False) -> tuple[ServoState, ...]:
        """Stop all without force; that also ends what is latched."""

    def set_position(self, axis: int, position: float) -> None:
        """Say that a servo is at this place [rev]."""

    def ready(self) -> None:
        """Make them obey their first command at once."""

    def close(self) -> None:
        """Let go of the bus."""


def opened(params: Any, watchdog: float, patience: float, trace: Trace | None) -> Drives:
    """Open the bus that the parameters of the table name.

    Raises
    ------
    DeviceError
        If it is not there.
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
