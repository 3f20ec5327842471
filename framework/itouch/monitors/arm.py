"""An arm that pushes a finger: its force and torque (K1, K3) and the speed of the finger (K2)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import default_limits as default
from itouch.monitors.trips import Trip
from itouch.plugin import Field, Moment, Monitor, Record, Role, Rule, Watched

if TYPE_CHECKING:
    from itouch.monitors import arm_kernels

#: Relative tolerance for rounding in a force or torque that was limited.
_ROUNDING = 1e-9


class Arm(Monitor):
    """Watches what an arm was sent, and how fast the finger on it moves."""

    name = "arm"
    needs_finger_position: ClassVar[bool] = True
    trips: ClassVar[Mapping[int, str]] = {
        int(trip): trip.label for trip in (Trip.SPEED, Trip.FINGER_FORCE, Trip.FINGER_TORQUE)
    }

    def __init__(self, device: Watched) -> None:
        super().__init__(device)
        self._wrench = next(iter(device.commands_with(Role.FORCE_ON_OPERATOR)))
        self._force = device.limits.get("force") or 0.0
        self._torque: float | None = device.limits.get("torque")
        self._all = device.limits.get("finger_force") or default.FORCE
        self._all_by = device.source("finger_force")
        self._turning = device.limits.get("finger_torque") or default.TORQUE

    @classmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        """Every device that exerts a force on the operator."""
        return (cls(device),) if device.commands_with(Role.FORCE_ON_OPERATOR) else ()

    @property
    def watches(self) -> tuple[str, ...]:
        """The forces that it limits."""
        return tuple(channel.name for channel in self.device.commands_with(Role.FORCE_ON_OPERATOR))

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (Field("figure", unit="mixed", doc="the figure of the last trip"),)

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Return the share of the force that the finger's speed allows: all of it up to 0.8 m/s, none at 1.2 m/s."""
        from itouch.monitors.arm_kernels import check  # here, so that the compiler is loaded only if a device runs

        return check(self.pushing, self.sent_of(sent), float(moment.speed), state["figure"].reshape(1))

    @cached_property
    def pushing(self) -> arm_kernels.Pushing:
        """Its limits for compiled code."""
        from itouch.monitors.arm_kernels import Pushing

        slow, fast = default.ARM_SPEED, default.ARM_SPEED_TRIP
        torque = math.inf if self._torque is None else self._torque * (1.0 + _ROUNDING)
        trips = int(Trip.FINGER_FORCE), int(Trip.FINGER_TORQUE), int(Trip.SPEED)
        return Pushing(self._force * (1.0 + _ROUNDING), torque, slow, fast, *trips)

    def sent_of(self, sent: Record) -> NDArray[np.float64]:
        """Return the view of the wrench that was sent [N, N m]."""
        return sent[self._wrench.name]

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Return how fast the finger moved, or how much force or torque was sent."""
        figure = state["figure"].item()
        if code == Trip.FINGER_TORQUE:
            return f"was sent {figure:.3f} N m"
        return f"was sent {figure:.1f} N" if code == Trip.FINGER_FORCE else f"moves at {figure:.2f} m/s"

    def rule(self, code: int, reading: Record) -> str:
        """Return the rule that a trip belongs to."""
        return "K2" if code == Trip.SPEED else "K1"

    @property
    def _strongest(self) -> str:
        """The hardware's greatest torque about an axis, in words; empty: it states none."""
        high = self._wrench.high[3:]
        return f"{max(high):g} N m" if high and math.isfinite(max(high)) else ""

    def rules(self) -> tuple[Rule, ...]:
        """Return K1 to K3."""
        most = f"{self._wrench.magnitude:g} N" if self._wrench.magnitude else ""
        by, torque = self.device.source, self._torque
        turned = () if torque is None else (
            Rule("K1", "torque on the finger", f"{torque:g} N m", "", self._strongest, by("torque")),
            Rule("K1", "torque of all that turns one finger", f"{self._turning:g} N m", "", "", by("finger_torque")),
            Rule("K3", "increase of torque", f"{default.FORCE_SLEW * default.FINGER_LEVER:g} N m/s"),
        )  # fmt: skip
        return (
            Rule("K1", "force on the finger", f"{self._force:g} N", "", most, by("force")),
            Rule("K1", "force of all that pushes on one finger", f"{self._all:g} N", "", "", self._all_by),
            *turned[:2],
            Rule("K2", "speed of the finger", f"forces fade above {default.ARM_SPEED:g} m/s",
                 f"{default.ARM_SPEED_TRIP:g} m/s"),
            Rule("K3", "increase of force", f"{default.FORCE_SLEW:g} N/s"),
            *turned[2:],
        )  # fmt: skip
