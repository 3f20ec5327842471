"""Devices for random rigs: plates, an arm and a tapped table, whose channels have names of their own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from itouch.plugin import (
    Channel,
    Device,
    Field,
    Modality,
    Record,
    Role,
    Twin,
    TwinInputs,
    World,
    current,
    measured_wrench,
    pose,
    pose_target,
    temperature,
    temperature_target,
    wrench,
)

ROOM = 296.15


@dataclass(frozen=True, slots=True)
class Nothing:
    """No parameters."""


@dataclass(frozen=True, slots=True)
class PlateKind:
    """Parameters of a plate.

    ``device``, ``reads`` and ``obeys`` are the names of the device, its reading and its command; ``target`` says
    whether the command is a temperature instead of a current; ``power`` [W], ``capacity`` [J/K], ``period`` [s].
    """

    device: str
    reads: str
    obeys: str
    target: bool
    power: float
    capacity: float
    period: float


class _Plate(Twin):
    """A plate of one temperature, which loses 0.1 W for each kelvin above the room."""

    kind: ClassVar[PlateKind]

    def fields(self) -> tuple[Field, ...]:
        return (
            Field("true", unit="K", doc="true temperature"),
            Field("ticks", "i8", unit="tick", doc="periods so far"),
        )

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        state["true"] = ROOM

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        kind, true, drive = self.kind, state["true"].item(), command[self.kind.obeys].item()
        if kind.target:
            power = max(-kind.power, min(kind.power, 20.0 * (drive - true))) if drive > 200.0 else 0.0
        else:
            power = -kind.power * drive / 2.0
        state["true"] = true + (power - 0.1 * (true - ROOM)) * period / kind.capacity
        state["ticks"] += 1

    def read(self, state: Record, reading: Record) -> bool | None:
        reading[self.kind.reads] = state["true"].item() + 2e-4 * (state["ticks"].item() * 7919 % 11)
        return True


def plate(kind: PlateKind) -> type[Device]:
    """Return the class of a plate."""
    command = temperature_target(kind.obeys, low=250.0, high=400.0) if kind.target else current(kind.obeys, limit=2.0)
    reads = (temperature(kind.reads, Role.SKIN_CONTACT_TEMPERATURE),)
    return _device(type("PlateTwin", (_Plate,), {"kind": kind}), reads, (command,), kind.period)


#: Channels of the arm and of the table.
_POSE, FELT = pose(), measured_wrench(force=50.0)
_TARGET = pose_target(low=(-0.1, -0.1, 0.0), high=(0.1, 0.1, 0.04), speed=0.25)


class _Arm(Twin):
    """An arm whose finger stands still."""

    names: ClassVar[tuple[str, str]]

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Do nothing: the finger stands still."""

    def read(self, state: Record, reading: Record) -> bool | None:
        reading[_POSE.name] = (0.0, 0.0, 0.035, 1.0, 0.0, 0.0, 0.0)
        return True


def arm() -> type[Device]:
    """Return the class of an arm."""
    return _device(type("ArmTwin", (_Arm,), {}), (_POSE,), (wrench(force=8.0),), 0.0)


class _Table(Twin):
    """A table that follows its target at once, and is tapped: ``tapping`` is time on, time off [s], and force [N]."""

    tapping: ClassVar[tuple[float, float, float]]

    def fields(self) -> tuple[Field, ...]:
        return (Field("place", "f8", 3, unit="m", doc="where it is"), Field("time", unit="s", doc="time so far"))

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        state["place"] = command[_TARGET.name][:3]
        state["time"] += period

    def read(self, state: Record, reading: Record) -> bool | None:
        on, off, force = self.tapping
        pressed = force if math.fmod(state["time"].item(), on + off) < on else 0.0
        reading[_POSE.name] = (*state["place"].tolist(), 1.0, 0.0, 0.0, 0.0)
        reading[FELT.name] = (0.0, 0.0, -pressed if state["place"][2] > 0.001 else 0.0, 0.0, 0.0, 0.0)
        return True


def table(tapping: tuple[float, float, float], period: float) -> type[Device]:
    """Return the class of a table that is tapped."""
    target = _TARGET
    reads = (pose(locked=(3, 4, 5)), FELT)
    return _device(type("TableTwin", (_Table,), {"tapping": tapping}), reads, (target,), period)


def _device(twin: type[Twin], seen: tuple[Channel, ...], obeyed: tuple[Channel, ...], every: float) -> type[Device]:
    class Made(Device):
        """A device of a random rig."""

        Params = Nothing
        reads: ClassVar[tuple[Channel, ...]] = seen
        commands: ClassVar[tuple[Channel, ...]] = obeyed
        Twin = twin
        period: ClassVar[float] = every
        blocking: ClassVar[bool] = every > 0.0
        watchdog: ClassVar[float | None] = 0.5

        def open(self) -> None:
            """Twin only."""

        def close(self) -> None:
            """Twin only."""

        def read(self, reading: Record) -> bool | None:
            """Twin only."""
            return False

    return Made


class HostileModality(Modality):
    """A modality that commands the same targets all the time, and from ``since`` [s] on writes fields of others."""

    Params = Nothing
    targets: ClassVar[tuple[tuple[str, float], ...]] = ()
    foreign: ClassVar[tuple[tuple[str, float], ...]] = ()
    since: ClassVar[float] = 0.0

    def compile(self, name: str, params: Any, world: World) -> Any:
        """Return the name as the model."""
        return name

    def fields(self, model: Any) -> tuple[Field, ...]:
        """Return one field, the time so far."""
        return (Field("time", unit="s", doc="time so far"),)

    def reset(self, model: Any, state: Record) -> None:
        """Set the time to zero."""
        state[f"{model}.time"] = 0.0

    def commands(self, model: Any) -> tuple[str, ...]:
        """Return the commands that it drives."""
        return tuple(name for name, _ in self.targets)

    def update(self, model: Any, state: Record, period: float) -> None:
        """Command the targets, and from ``since`` on write the fields of others, too."""
        state[f"{model}.time"] += period
        for name, value in self.targets:
            device, _, channel = name.partition(".")
            state[f"{device}.command.{channel}"] = value
        if state[f"{model}.time"].item() > self.since:
            for name, value in self.foreign:
                if name in state:
                    state[name] = value
