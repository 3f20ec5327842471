"""Small devices and their part of State, for tests of the supervisor without a scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from itouch.monitors import Trip, TripError
from itouch.plugin import (
    Channel,
    Device,
    DeviceError,
    Field,
    Moment,
    Monitor,
    Record,
    Twin,
    TwinInputs,
    current,
    heat_flux,
    measured_wrench,
    plate_temperature,
    pose,
    pose_target,
    sink_temperature,
    wrench,
)
from itouch.safety import Gate, Lifecycle
from itouch.world.limits import DeviceLimits
from itouch.world.rig import DeviceModel
from itouch.world.supervision import monitors_of, supervision, watched

PERIOD = 1e-3
LIMITS = DeviceLimits(
    force=3.0, torque=0.06, speed=0.25, speed_near=0.10, current=2.0, temperature=(288.15, 313.15), watchdog=0.02,
    plate_force=2.0, contact_time=10.0, plate_rate=10.0, flux=15e3, dose=120.0,
)  # fmt: skip

ARM = ((pose(),), (wrench(force=8.0),))
TABLE = (
    (pose(locked=(3, 4, 5)), measured_wrench(force=50.0)),
    (pose_target(low=(-0.1, -0.1, 0.0), high=(0.1, 0.1, 0.06), speed=0.3),),
)
PLATE = (
    (plate_temperature(), sink_temperature(), heat_flux(full_scale=2e4)),
    (current(limit=4.0),),
)
Channels = tuple[tuple[Channel, ...], tuple[Channel, ...]]


class Supervised:
    """A device as the loop has it: with a gate and a lifecycle, which go by one latch."""

    __slots__ = ("command", "gate", "latch", "lifecycle", "model", "reading", "sent")

    def __init__(
        self, model: DeviceModel, state: Record, period: float, *, device: Device | None = None,
        twin: Twin | None = None,
    ) -> None:  # fmt: skip
        self.model, self.gate = model, Gate(model, state, period, device=device, twin=twin)
        self.lifecycle, self.latch = Lifecycle(self.gate, state, period), self.gate.latch
        self.reading, self.command, self.sent = self.gate.reading, self.gate.command, self.gate.sent


class Fake(Device):
    """A device that says what it is told to, and keeps what it is sent."""

    Params: ClassVar[type] = type(None)
    period: ClassVar[float] = 0.0

    def __init__(self, params: Any = None) -> None:
        super().__init__(params)
        self.calls: list[str] = []
        self.written: list[dict[str, list[float]]] = []
        self.says: Callable[[Record], bool | None] = lambda reading: True
        self.open_fails: Exception | None = None
        self.write_fails: Exception | None = None
        self.close_fails: Exception | None = None

    def open(self) -> None:
        self.calls.append("open")
        if self.open_fails:
            raise self.open_fails

    def close(self) -> None:
        self.calls.append("close")
        if self.close_fails:
            raise self.close_fails

    def read(self, reading: Record) -> bool | None:
        return self.says(reading)

    def write(self, command: Record) -> None:
        if self.write_fails:
            raise self.write_fails
        self.written.append({name: view.tolist() for name, view in command.items()})


class Slow(Fake):
    """The same, with a new reading every 5 ms."""

    period: ClassVar[float] = 0.005


class FakeTwin(Twin):
    """A twin that says what it is told to, and stands where it is told to."""

    def __init__(self) -> None:
        super().__init__(None)
        self.says: Callable[[Record], bool | None] = lambda reading: True
        self.place: list[float] | None = None

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Stay."""

    def position(self, state: Record) -> np.ndarray | None:
        return None if self.place is None else np.array(self.place)

    def read(self, state: Record, reading: Record) -> bool | None:
        return self.says(reading)


def model(
    channels: Channels, *, name: str = "it", limits: DeviceLimits = LIMITS, twin: bool = False, carrier: str = "",
    cls: type[Device] = Fake, optional: bool = False, offered: Sequence[type[Monitor]] = (),
) -> DeviceModel:  # fmt: skip
    """Return the model of a device with these channels."""
    reads, commands = channels
    monitors = monitors_of(watched(name, "fake", None, channels, limits, twin=twin), offered)
    return DeviceModel(
        name, "fake", cls, None, reads, commands, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), carrier, limits,
        twin, optional, 0, 296.15, None, monitors=monitors,
    )  # fmt: skip


def state(*models: DeviceModel, wire: bool = False) -> Record:
    """Return a State for devices."""
    fields = [Field("tick", "i8"), Field("hold", "i8"), Field("stopping", "i8")]
    for one in models:
        fields += [Field(f"{one.name}.{c.name}", "f8", c.size) for c in one.reads]
        fields += [Field(f"{one.name}.command.{c.name}", "f8", c.size) for c in one.commands]
        fields += [Field(f"{one.name}.sent.{c.name}", "f8", c.size) for c in one.commands]
        fields += [Field(f"{one.name}.{f.name}", f.dtype, f.size) for f in supervision(one.monitors)]
        fields.append(Field(f"{one.name}.measured", "i8", max(1, len(one.reads))))
        if wire:
            fields += [Field(f"{one.name}.left", "i8"), Field(f"{one.name}.gone", "f8", (8, 4))]
            fields.append(Field(f"{one.name}.goings", "i8"))
            fields += [Field(f"{one.name}.out.{c.name}", "f8", c.size) for c in one.commands]
    return Record.of(fields)


class Asked:
    """One monitor with what it looks at, asked by a test; a trip is raised."""

    def __init__(self, kind: type[Monitor], channels: Channels, limits: DeviceLimits = LIMITS, index: int = 0) -> None:
        device = watched("it", "fake", None, channels, limits, twin=False)
        self.monitor = list(kind.of(device))[index]
        self.state = Record.of(self.monitor.fields())
        self.reading, self.sent, self.moment = record(channels[0]), record(channels[1]), Moment()
        self.monitor.reset(self.state)
        self.share = 1.0

    def check(self, seconds: float = PERIOD, *, fresh: bool = True) -> float:
        """Check after so many seconds; return the share."""
        moment = self.moment
        moment.now, moment.seconds, moment.fresh = round(moment.now + seconds, 9), seconds, fresh
        moment.time = moment.now if fresh else moment.time
        found = self.monitor.check(self.state, self.reading, self.sent, moment)
        if found < 0.0:
            code = int(-found)
            raise TripError(Trip(code), self.monitor.sentence(code, self.state, self.reading, moment))
        self.share = found
        return found

    def forget(self) -> None:
        """Forget what was measured."""
        self.monitor.clear_history(self.state)


def record(channels: Sequence[Channel]) -> Record:
    """Return a record of channels alone."""
    return Record.of([Field.of(channel) for channel in channels])


def lost(*_: Any) -> bool:
    """Fail as a device does whose plug was pulled."""
    raise DeviceError("the plug is out")
