"""Limits on one finger for all devices together: the sum of their forces, thermal dose, time in cold and in contact.

The scene's force limit holds for the sum of arms, surfaces and devices that press by a fluid; thermal dose, time in the
cold and time in contact are counted per finger, whichever device causes them.  A worn display is always in contact, and
its time counts while it is driven; where a surface would withdraw, the display's drive is let go.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import DeviceFaultError, Heat, Push, Surface, Trip
from itouch.monitors import default_limits as default
from itouch.monitors.thresholds import TOUCH_FORCE
from itouch.plugin import Role
from itouch.safety.device_monitors import InstalledMonitor
from itouch.safety.gate import Gate

if TYPE_CHECKING:
    from itouch.monitors.surface_kernels import FingerAbove


class Finger:
    """The devices that act on one finger; ``nearing``: where it is over each surface, by device name, if known."""

    def __init__(
        self, name: str, devices: Sequence[Gate], nearing: Mapping[str, FingerAbove] | None = None
    ) -> None:  # fmt: skip
        self.name, self.nearing = name, nearing or {}
        #: The arms that push it, and the devices that carry a surface to it.
        self.arms_of = [one for one in devices if any(c.role is Role.FORCE_ON_OPERATOR for c in one.model.commands)]
        self.tables = [one for one in devices if one.device_monitors.surface is not None]
        #: The devices that press by a fluid and measure their force, each with its monitor.
        self.pads = [
            (one, post.monitor)
            for one in devices
            for post in one.device_monitors.installed
            if isinstance(post.monitor, Push) and one.device_monitors.surface is None
        ]
        pushing = (*self.tables, *(one for one, _ in self.pads))
        self._heats = [(one, post) for one in devices for post in one.heats]
        brought = {one.model.name for one in self.tables}
        carriers = {one.model.name: one.model.carrier for one in devices}
        #: The displays that no surface brings to the finger, if one brings another.
        self.worn = [
            (one, post)
            for one, post in self._heats
            if self.tables and not brought & {*_chain(one.model.name, carriers)}
        ]
        limits = [one.model.limits for one in (*self.arms_of, *pushing)]
        #: Greatest force [N] of all devices that push on the finger together.
        self.force = min((one.finger_force for one in limits), default=0.0)
        #: Greatest torque [N m] of all arms on the finger together.
        self.torque = min((one.finger_torque for one in limits), default=0.0)
        self._trip = max((one.model.limits.plate_force_trip for one in pushing), default=0.0)
        self._wrenches = [
            [one.sent[c.name] for c in one.model.commands if c.role is Role.FORCE_ON_OPERATOR] for one in self.arms_of
        ]
        if len(self._heats) > 1:
            for one in {id(one): one for one, _ in self._heats}.values():
                one.shared.append(self)

    @property
    def plates(self) -> Sequence[InstalledMonitor]:
        """The monitors of the plates on the finger, which together give it its dose and its time in the cold."""
        return [post for _, post in self._heats]

    @property
    def alone(self) -> bool:
        """Whether nothing has to be limited together: no surface, at most one device that pushes, at most one plate."""
        return len(self.arms_of) + len(self.tables) + len(self.pads) < 2 and len(self._heats) < 2 and not self.tables

    @property
    def simple(self) -> bool:
        """Whether exactly one device carries a surface to the finger, at most one arm and one plate act on it."""
        few = len(self.arms_of) < 2 and not self.pads
        return len(self.tables) == 1 and few and len(self._heats) < 2

    def pressed(self, but: Gate | None = None) -> float:
        """Return the force [N] with which surfaces and fluid pads press on the finger, by their own sensors.

        ``but``: a surface that is not counted.
        """
        felt = (*(_felt(one) for one in self.tables if one is not but), *(force for _, force in self._padded()))
        return sum(force for force in felt if force > TOUCH_FORCE)

    def _padded(self) -> Iterator[tuple[Gate, float]]:
        """Yield each device that presses by a fluid, with the force [N] that it measures."""
        for one, push in self.pads:
            yield one, push.felt(one.device_monitors.seen)

    def taken(self) -> float:
        """Return the force [N] that arms must leave to the others: what they press with, and what that may rise by."""
        if not self.nearing:
            return self.pressed()
        from itouch.monitors.surface_kernels import rise  # here, so that the compiler is loaded only if a device runs

        near = [self.nearing.get(table.model.name) for table in self.tables]
        felt = [_felt(table, over) for table, over in zip(self.tables, near, strict=True)]
        forces = (*felt, *(force for _, force in self._padded()))
        total = sum(force for force in forces if force > TOUCH_FORCE)
        for over, force in zip(near, felt, strict=True):
            total += rise(over, force) if over is not None else 0.0
        return total

    def check(self, tick: int) -> None:
        """Give each arm the force that surfaces and pads leave, and run the clock of T4.

        Raises
        ------
        DeviceFaultError
            If all devices together pass a limit: force, thermal dose, time in the cold or in contact.
        """
        pressed = self.pressed()
        if len(self.tables) + len(self.pads) > 1 and pressed > self._trip:
            each = [*((one, _felt(one)) for one in self.tables), *self._padded()]
            most, _ = max(each, key=lambda pair: pair[1])
            what = f"presses with others on the finger of '{self.name}' with {pressed:.1f} N"
            raise DeviceFaultError(most.model.name, tick, Trip.FINGER_FORCE, what)
        left = max(0.0, self.force - (self.taken() if self.arms_of else 0.0))
        for arm in self.arms_of:
            arm.actuation.moving.room[0], arm.actuation.moving.turning[0] = left, self.torque
        if self.tables:
            self._touch(tick)
        if len(self._heats) > 1:
            self._doses(tick)

    def told(self, tick: int) -> None:
        """Act on what the compiled clock of T4 has found.

        Raises
        ------
        DeviceFaultError
            If the surface was touched for too long.
        """
        for table in self.tables:
            table.device_monitors.told_of_contact(tick)

    def reduce(self, arm: Gate) -> None:
        """Reduce an arm's force and torque to what the other arms leave, too, just before its command is limited."""
        others = [views for one, views in zip(self.arms_of, self._wrenches, strict=True) if one is not arm]
        left = self.force - self.taken()
        arm.actuation.moving.room[0] = max(0.0, left - sum(_size(views) for views in others))
        most = min(self.torque, left * default.FINGER_LEVER)
        arm.actuation.moving.turning[0] = max(0.0, most - sum(_size(views, 3) for views in others))

    @property
    def arms(self) -> Sequence[Gate]:
        """The arms, if there are several."""
        return self.arms_of if len(self.arms_of) > 1 else ()

    def _touch(self, tick: int) -> None:
        """Run the clock of T4 of every surface, forwards while the finger touches any or wears a driven display."""
        withdrawn = any(table.device_monitors.withdrawn for table in self.tables)
        touched = any(table.device_monitors.touched for table in self.tables if table.latch.enabled)
        touched = touched or any(_acts(one, post, withdrawn) for one, post in self.worn)
        for table in self.tables:
            table.device_monitors.count_contact(tick, touched)
        if self.worn:
            part = 0.0 if any(table.device_monitors.withdrawn for table in self.tables) else 1.0
            for one, _ in self.worn:
                one.device_monitors.limit_share(self.name, part)

    def _doses(self, tick: int) -> None:
        said = self._over()
        if said is not None:
            name, trip, sentence = said
            raise DeviceFaultError(name, tick, trip, sentence)

    def _over(self) -> tuple[str, Trip, str] | None:
        """Return the trip if the plates on the finger have together given too much: device, trip, sentence."""
        dose = sum(post.state["dose"].item() for _, post in self._heats)
        cold = sum(post.state["cold_time"].item() for _, post in self._heats)
        limits = [one.model.limits for one, _ in self._heats]
        if dose > min(one.dose or default.DOSE for one in limits):
            name = self._worst("dose").model.name
            return (
                name,
                Trip.DOSE,
                f"has given, with others on the same finger, a thermal dose of {dose / 60:.2f} CEM43",
            )
        if cold > min(one.cold_time or default.COLD_TIME for one in limits):
            name = self._worst("cold_time").model.name
            return name, Trip.COLD, f"was touched while cold, with others on the same finger, for {cold:.1f} s"
        return None

    def _worst(self, field: str) -> Gate:
        return max(self._heats, key=lambda pair: float(pair[1].state[field]))[0]

    def spent(self) -> str:
        """Return the words for a budget of the finger that is used up; empty: none is."""
        said = self._over()
        return said[2] if said is not None else ""


def _felt(table: Gate, near: FingerAbove | None = None) -> float:
    """Return the force on a surface [N] by its sensors; where a finger is known, with a loud one's noise averaged out.

    0: nothing watches it.
    """
    post: InstalledMonitor | None = table.device_monitors.surface
    monitor = post.monitor if post is not None else None
    return monitor.felt(table.device_monitors.seen, near) if isinstance(monitor, Surface) else 0.0


def _acts(one: Gate, post: InstalledMonitor, withdrawn: bool) -> bool:
    heat = post.monitor
    return (
        one.latch.enabled
        and isinstance(heat, Heat)
        and heat.acts(one.device_monitors.seen, one.sent, withdrawn=withdrawn)
    )


def _chain(name: str, carriers: Mapping[str, str]) -> Iterator[str]:
    """Yield a device, the one that carries it, the one that carries that, and so on, as far as known."""
    while name:
        yield name
        name = carriers.get(name, "")


def _size(views: Sequence[NDArray[np.float64]], first: int = 0) -> float:
    """Return the sum of the forces of wrenches [N]; with ``first`` 3, of their torques [N m]."""
    return sum(math.hypot(*view[first : first + 3].tolist()) for view in views)
