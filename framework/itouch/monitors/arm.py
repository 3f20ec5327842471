"""An arm that pushes a finger: force (K1, K3) and speed of the finger (K2)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import limits as default
from itouch.monitors.trips import Trip
from itouch.plugin import Field, Moment, Monitor, Record, Role, Rule, Watched

if TYPE_CHECKING:
    from itouch.monitors import arm_kernels

#: Room for rounding in a force that was limited.
_ROUNDING = 1e-9


class Arm(Monitor):
    """Watches what an arm was sent, and how fast the finger on it goes."""

    name = "arm"
    placed: ClassVar[bool] = True
    trips: ClassVar[Mapping[int, str]] = {int(Trip.SPEED): Trip.SPEED.label, int(Trip.FINGER_FORCE): "finger-force"}

    def __init__(self, device: Watched) -> None:
        super().__init__(device)
        self._wrench = next(iter(device.obeys(Role.FORCE_ON_OPERATOR)))
        self._force = device.limits.get("force") or 0.0
        self._all = device.limits.get("finger_force") or default.FORCE
        self._all_by = device.source("finger_force")

    @classmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        """Every device that exerts a force on the operator."""
        return (cls(device),) if device.obeys(Role.FORCE_ON_OPERATOR) else ()

    @property
    def watches(self) -> tuple[str, ...]:
        """The forces that it limits."""
        return tuple(channel.name for channel in self.device.obeys(Role.FORCE_ON_OPERATOR))

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (Field("figure", unit="mixed", doc="the figure of the last trip"),)

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Return the part of the force that the finger's speed leaves: all of it up to 0.8 m/s, none at 1.2 m/s."""
        from itouch.monitors.arm_kernels import check  # the compiler is loaded when a device runs

        return check(self.pushing, self.sent_of(sent), float(moment.speed), state["figure"].reshape(1))

    @cached_property
    def pushing(self) -> arm_kernels.Pushing:
        """Its limits as compiled code takes them."""
        from itouch.monitors.arm_kernels import Pushing

        slow, fast = default.ARM_SPEED, default.ARM_SPEED_TRIP
        return Pushing(self._force * (1.0 + _ROUNDING), slow, fast, int(Trip.FINGER_FORCE), int(Trip.SPEED))

    def sent_of(self, sent: Record) -> NDArray[np.float64]:
        """Return the force of what was sent."""
        return sent[self._wrench.name]

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Say how fast, or how strong."""
        figure = state["figure"].item()
        return f"was sent {figure:.1f} N" if code == Trip.FINGER_FORCE else f"moves at {figure:.2f} m/s"

    def rule(self, code: int, reading: Record) -> str:
        """Return the rule that a trip belongs to."""
        return "K1" if code == Trip.FINGER_FORCE else "K2"

    def rules(self) -> tuple[Rule, ...]:
        """Return K1 to K3."""
        most = f"{self._wrench.magnitude:g} N" if self._wrench.magnitude else ""
        return (
            Rule("K1", "force on the finger", f"{self._force:g} N", "", most, self.device.source("force")),
            Rule("K1", "force of all that pushes on one finger", f"{self._all:g} N", "", "", self._all_by),
            Rule("K2", "speed of the finger", f"forces fade above {default.ARM_SPEED:g} m/s",
                 f"{default.ARM_SPEED_TRIP:g} m/s"),
            Rule("K3", "increase of force", f"{default.FORCE_SLEW:g} N/s"),
        )  # fmt: skip
