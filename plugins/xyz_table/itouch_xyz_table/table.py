"""The XYZ table as a device: three translations presented as six degrees of freedom, rotations locked.

Each axis is a servo (moteus or ODrive) or a stepper (on a TMCL module) with a screw or belt.  The travel, speed and
friction of the tables in the literature are not published; the defaults here are ours.
"""

from __future__ import annotations

import math
import os
import stat
from dataclasses import dataclass
from typing import Any

from itouch.plugin import (
    RETRACT,
    ROTATIONS,
    Attached,
    Channel,
    Device,
    DeviceError,
    Emulation,
    Opening,
    Record,
    Timing,
    measured_wrench,
    pose,
    pose_target,
    schema,
)
from itouch_xyz_table.drives import Drives, opened
from itouch_xyz_table.emulator import TableEmulator
from itouch_xyz_table.homing import home
from itouch_xyz_table.servos import AXES, NO_ADAPTOR, Goal, ServoError, Servos, ServoState, check
from itouch_xyz_table.tmcl import Steppers
from itouch_xyz_table.tmclframes import SIZE
from itouch_xyz_table.twin import XyzTableTwin

#: Seconds without a command after which the servos stop by themselves.
WATCHDOG = 0.1
#: An axis farther [m] than this beyond twice what its greatest speed allows counts from another zero.
FURTHER = 2e-3
#: Longest time [s] between two commanded poses for which their difference is fed forward as a velocity.
_STALE = 0.05
#: Number of requests in an exchange with a TMCL module (two checks, three positions, three goals), and the time that
#: each takes besides its bytes [s], an estimate.
_REQUESTS, _TURN = 8, 1e-3


def _without_adaptor() -> str:
    """Say that a table whose scene names no port has none; empty: one is attached, or it cannot be looked for."""
    try:
        from moteus.fdcanusb_device import FdcanusbDevice
    except ImportError:
        return ""  # opening says what to install
    try:
        return "" if FdcanusbDevice.detect_fdcanusbs() else NO_ADAPTOR
    except OSError:
        return NO_ADAPTOR  # as opening says then


def _other_than_terminal(number: int) -> bool:
    """Tell whether a character device is known to be another kind than a terminal, such as /dev/null."""
    kind = f"/sys/dev/char/{os.major(number)}:{os.minor(number)}/subsystem"
    return os.path.exists(kind) and os.path.basename(os.path.realpath(kind)) != "tty"


@dataclass(frozen=True, slots=True)
class XyzTableParams:
    """A table of three axes on servos or steppers; its origin is the middle of the x and y travel, at the bottom."""

    travel: tuple[float, float, float] = schema.quantity(
        "m", size=3, low=0.005, high=1.0, default=(0.16, 0.12, 0.04), doc="full travel along x, y and z"
    )
    speed: float = schema.quantity("m/s", low=0.01, high=2.0, default=0.3, doc="greatest speed of an axis")
    acceleration: float = schema.quantity(
        "m/s^2", low=0.1, high=200, default=20.0, doc="greatest acceleration of an axis"
    )
    mass: float = schema.quantity("kg", low=0.05, high=20, default=0.6, doc="of the twin: moving mass")
    friction: float = schema.quantity("N", low=0.0, high=20, default=0.8, doc="of the twin: dry friction of an axis")
    bandwidth: float = schema.quantity(
        "Hz", low=5, high=100, default=40.0, doc="of the twin: bandwidth of its position control"
    )
    port: str = schema.text(default="", doc="serial port of the CAN-FD adaptor; empty: the one that is attached")
    bus: str = schema.text(
        default="",
        doc="of ODrive servos: INTERFACE:CHANNEL of python-can, such as socketcan:can0; empty: moteus servos",
    )
    tmcl: str = schema.text(
        default="", doc="of steppers: serial port of a Trinamic module that speaks TMCL; empty: servos"
    )
    baud: int = schema.integer(low=9600, high=1_000_000, default=115200, doc="of a TMCL module: speed of its port")
    address: int = schema.integer(low=1, high=255, default=1, doc="of a TMCL module: its address on the line")
    heartbeat: bool = schema.flag(
        default=True,
        doc="of a TMCL module: whether it stops its motors when the host is silent; no: guardian and hold-to-run only",
    )
    motors: tuple[float, float, float] = schema.quantity(
        "", size=3, low=0, high=5, default=(0.0, 1.0, 2.0), doc="of a TMCL module: numbers of the motors of x, y and z"
    )
    microsteps: tuple[float, float, float] = schema.quantity(
        "",
        size=3,
        low=1,
        high=1e6,
        default=(51200.0, 51200.0, 51200.0),
        doc="of a TMCL module: microsteps per turn of each motor",
    )
    torque_constant: tuple[float, float, float] = schema.quantity(
        "",
        size=3,
        low=1e-4,
        high=10.0,
        default=(0.04, 0.04, 0.04),
        doc="of ODrive servos: N m per ampere of each motor",
    )
    ids: tuple[float, float, float] = schema.quantity(
        "", size=3, low=1, high=126, default=(1.0, 2.0, 3.0), doc="numbers of the servos of x, y and z on the bus"
    )
    lead: tuple[float, float, float] = schema.quantity(
        "m", size=3, low=1e-4, high=0.5, default=(0.01, 0.01, 0.01), doc="travel of an axis a turn of its servo"
    )
    direction: tuple[float, float, float] = schema.quantity(
        "",
        size=3,
        low=-1,
        high=1,
        default=(1.0, 1.0, 1.0),
        doc="1 or -1: which way an axis goes as its servo turns",
    )
    max_torque: tuple[float, float, float] = schema.quantity(
        "N*m", size=3, low=0.001, high=20, default=(0.05, 0.05, 0.05), doc="greatest torque of each servo"
    )
    weight: float = schema.quantity("N", low=0.0, high=200, default=0.0, doc="what the z axis carries, fed forward")
    efficiency: float = schema.quantity("", low=0.1, high=1.0, default=0.9, doc="efficiency of the screws or belts")
    homing: str = schema.choice(
        "stops", "absolute", default="stops",
        doc="stops: each axis goes gently against its low end; absolute: the servos know where they are",
    )  # fmt: skip
    force_noise: float = schema.quantity(
        "N", low=0.0, high=0.5, default=0.005, doc="of the twin: rms of the force sensor"
    )

    def __post_init__(self) -> None:
        schema.validate(self)
        if any(abs(sign) != 1.0 for sign in self.direction):
            raise ValueError(f"direction = {self.direction} must be 1 or -1 for each axis")
        if len({int(number) for number in self.ids}) < 3 or any(number % 1 for number in self.ids):
            raise ValueError(f"ids = {self.ids} must be three different whole numbers")
        if sum(map(bool, (self.bus, self.port, self.tmcl))) > 1:
            raise ValueError("port is of moteus servos, bus of ODrive servos and tmcl of steppers: write one of them")
        if len({int(number) for number in self.motors}) < 3 or any(number % 1 for number in self.motors):
            raise ValueError(f"motors = {self.motors} must be three different whole numbers")
        if self.bus and (":" not in self.bus or max(self.ids) > 63):
            raise ValueError(f"bus = '{self.bus}' must be INTERFACE:CHANNEL, and ids of ODrive servos are 1 to 63")


class XyzTable(Device):
    """An encountered-type display: it carries a plate to where the finger meets a surface."""

    Params = XyzTableParams
    reads = (pose(locked=ROTATIONS), measured_wrench(force=50.0, locked=ROTATIONS))
    commands = (pose_target(low=(-0.08, -0.06, 0.0), high=(0.08, 0.06, 0.04), speed=0.3, safe=RETRACT),)
    Twin = XyzTableTwin
    timing = Timing(blocking=True, watchdog=WATCHDOG)
    opening = Opening(moves_on_open=True)
    emulation = Emulation(Emulator=TableEmulator)

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels, with the travel and speed from the parameters."""
        x, y, z = params.travel
        target = pose_target(
            low=(-x / 2, -y / 2, 0.0), high=(x / 2, y / 2, z), speed=params.speed, safe=RETRACT, locked=ROTATIONS
        )
        # Steppers measure no force: only their positions are read.
        return cls.reads[:1] if params.tmcl else cls.reads, (target,)

    @classmethod
    def exchange_time_for(cls, params: Any) -> float:
        """Return how long one exchange takes [s]: a TMCL module answers its requests one after the other."""
        if not params.tmcl:
            return super().exchange_time_for(params)
        seconds: float = round(_REQUESTS * (2 * SIZE * 10.0 / params.baud + _TURN), 3)
        return seconds

    @classmethod
    def discover(cls) -> tuple[Attached, ...]:
        """Look for attached CAN-FD adaptors."""
        try:
            from moteus.fdcanusb_device import FdcanusbDevice
        except ImportError:
            return (Attached("CAN-FD adaptors", False, "cannot be looked for: pip install 'itouch-py[moteus]'"),)
        ports = FdcanusbDevice.detect_fdcanusbs()
        return tuple(Attached(port, True, "a CAN-FD adaptor; its servos are asked when it is opened") for port in ports)

    @classmethod
    def unavailable_reason(cls, bound: XyzTableParams) -> str:
        """Say why the port cannot be used: there is none, or this user may not open it; empty if nothing is missing."""
        kind, _, bus = bound.bus.partition(":")
        place = bound.port or bound.tmcl or bus.partition("@")[0]  # behind @: the speed of the port
        if not place:
            return "" if bound.bus else _without_adaptor()  # opening says what is wrong with a bus without a channel
        if kind == "socketcan" and not os.path.exists(f"/sys/class/net/{place}"):
            return f"there is no network interface '{place}': plug the CAN adaptor in, and set the interface up"
        if not place.startswith("/"):
            return ""
        try:
            found = os.stat(place)
        except OSError:
            return f"there is nothing at '{place}': check its plug"
        if not stat.S_ISCHR(found.st_mode) or _other_than_terminal(found.st_rdev):
            return f"'{place}' is not a serial port"
        allowed = os.access(place, os.R_OK | os.W_OK)
        return "" if allowed else f"you may not open '{place}': its group may, to which you can be added (see ls -l)"

    @classmethod
    def wires(cls, params: Any) -> tuple[str, ...]:
        """Name the port or bus; the attached adaptor if none is named."""
        return (params.port or params.tmcl or params.bus.partition("@")[0] or "the CAN-FD adaptor that is attached",)

    @classmethod
    def watchdog_for(cls, params: Any) -> float | None:
        """Return the drives' watchdog [s]; None for a module without a heartbeat, which does not stop by itself."""
        return None if cls.second_opener_for(params) else cls.watchdog

    @classmethod
    def second_opener_for(cls, params: Any) -> bool:
        """Tell whether a guardian can stop it: a module without a heartbeat, whose port can be opened twice."""
        return bool(params.tmcl) and not params.heartbeat

    def __init__(self, params: XyzTableParams) -> None:
        super().__init__(params)
        #: Travel per revolution [m], with sign.
        self._leads = tuple(lead * sign for lead, sign in zip(params.lead, params.direction, strict=True))
        self._servos: Drives | None = None
        self._goal: tuple[float, ...] | None = None
        self._before: tuple[float, ...] = ()
        self._when = 0.0
        #: Positions of the axes [m] in the last exchange, and when it ended [s].
        self._found: tuple[tuple[float, ...], float] | None = None
        self._lost = False

    def open(self) -> None:
        """Open the bus, clear latched faults and time-outs, and home.

        Raises
        ------
        DeviceError
            If a servo is missing, has a fault, does not find its end, or does not know its position.
        """
        p = self.params
        x, y, _ = p.travel
        servos = opened(p, WATCHDOG, self.timeout_factor, self.trace)
        try:
            servos.query()
            states = servos.stop(latched=True)
            check(states, driven=False)
            if p.homing == "stops" and isinstance(servos, Steppers):
                servos.search(p.travel, (-x / 2, -y / 2, 0.0))
            elif p.homing == "stops":
                home(servos, leads=self._leads, torques=p.max_torque, travel=p.travel, low=(-x / 2, -y / 2, 0.0))
            else:
                self._trust(servos, states)
            servos.ready()
        except BaseException:
            servos.close()
            raise
        self._servos, self._goal, self._found, self._lost = servos, None, None, False

    def close(self) -> None:
        """Stop the servos and release the bus; servos that do not answer are stopped by their own watchdogs."""
        servos, self._servos = self._servos, None
        if servos is None:
            return
        try:
            servos.stop()
        except DeviceError:
            if not self._lost:
                raise
        finally:
            servos.close()

    def make_safe(self, safe: Record) -> None:
        """Stop the motors where they are, as a heartbeat would: without homing or moving them."""
        servos = opened(self.params, WATCHDOG, self.timeout_factor, self.trace)
        try:
            servos.stop()
        finally:
            servos.close()

    def write(self, command: Record) -> None:
        """Set the goal; the next exchange sends it.

        Raises
        ------
        ValueError
            If a rotation is commanded: rotations are locked.
        """
        x, y, z, w, *rotation = command["pose_target"].tolist()
        if abs(abs(w) - 1.0) > 1e-6 or any(abs(part) > 1e-6 for part in rotation):
            raise ValueError("the table's rotations are locked: the quaternion must be 1 0 0 0")
        self._goal = (x, y, z)

    def read(self, reading: Record) -> bool:
        """Exchange: send the goal with its watchdog, read position and force.

        Raises
        ------
        DeviceError
            If a servo does not answer, has stopped, has jumped, or its watchdog has expired.
        """
        if self._servos is None:
            raise DeviceError("the table is not open")
        goal = self._goal
        try:
            states = self._servos.query() if goal is None else self._servos.command(self._goals(goal))
        except DeviceError:
            self._lost = True
            raise
        check(states, driven=goal is not None)
        self._follow(states)
        self._tell(states, reading)
        return True

    def _trust(self, servos: Drives, states: tuple[ServoState, ...]) -> None:
        """Check that servos with absolute positions can be right about them.

        Raises
        ------
        ServoError
            If one does not know its position, or reports one outside its travel: it would be driven against an end.
        """
        lost = servos.lost() if isinstance(servos, Servos) else ()
        x, y, z = self.params.travel
        ends = ((-x / 2, x / 2), (-y / 2, y / 2), (0.0, z))
        for axis, (state, lead, (low, high)) in enumerate(zip(states, self._leads, ends, strict=True)):
            place, why = state.position * lead, ""
            if axis in lost:
                why = "counts from where it was switched on"
            elif not low - FURTHER <= place <= high + FURTHER:
                why = f"says {1e3 * place:.1f} mm, outside its travel of {1e3 * low:g} to {1e3 * high:g} mm"
            if why:
                raise ServoError(
                    f"axis {AXES[axis]} does not know where it is: its servo {why}; home it first, or write "
                    'homing="stops"'
                )

    def _follow(self, states: tuple[ServoState, ...]) -> None:
        """Check that no axis has jumped: a servo that has restarted counts from another zero.

        Raises
        ------
        ServoError
            If one has: its position is not to be trusted, and it must not be driven.
        """
        places = tuple(state.position * lead for state, lead in zip(states, self._leads, strict=True))
        now, before, self._found = self.clock(), self._found, None
        if before is not None:
            room = FURTHER + 2.0 * self.params.speed * (now - before[1])
            for axis, (place, last) in enumerate(zip(places, before[0], strict=True)):
                if abs(place - last) > room:
                    raise ServoError(
                        f"axis {AXES[axis]} says that it is {1e3 * abs(place - last):.1f} mm from where it just was: "
                        "its servo has restarted, or its encoder fails; check its supply, then connect it again"
                    )
        self._found = places, now

    def _goals(self, goal: tuple[float, ...]) -> list[Goal | None]:
        """Return the servos' commands: position, its rate of change, and the weight as a feed-forward torque."""
        p, now = self.params, self.clock()
        lapse = now - self._when
        moved = [0.0] * 3
        if self._before and 0.0 < lapse < _STALE:
            speed = p.speed
            moved = [max(-speed, min(speed, (a - b) / lapse)) for a, b in zip(goal, self._before, strict=True)]
        self._before, self._when = goal, now
        goals: list[Goal | None] = []
        for axis, lead in enumerate(self._leads):
            hold = p.weight * lead / (math.tau * p.efficiency) if axis == 2 else 0.0
            limit = p.max_torque[axis]
            goals.append(
                Goal(goal[axis] / lead, moved[axis] / lead, max(-limit, min(limit, hold)), limit, p.speed / abs(lead))
            )
        return goals

    def _tell(self, states: tuple[ServoState, ...], reading: Record) -> None:
        """Fill the reading; the force on the table is the one that the motors push against, less the weight."""
        p = self.params
        reading["pose"] = (
            *(s.position * lead for s, lead in zip(states, self._leads, strict=True)),
            1.0,
            0.0,
            0.0,
            0.0,
        )
        if p.tmcl:
            return
        forces = [
            -state.torque * math.tau / lead * p.efficiency for state, lead in zip(states, self._leads, strict=True)
        ]
        forces[2] += p.weight
        reading["wrench"] = (*forces, 0.0, 0.0, 0.0)
