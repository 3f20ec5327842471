"""Plugins that are wrong in one way each, by the name of the check that must find it."""

from __future__ import annotations

import contextlib
import math
import os
import threading
import time
from dataclasses import dataclass, replace

import numpy as np
from slider import Slider, SliderEmulator, SliderParams, SliderTwin

from itouch.plugin import Channel, Field, Record, Role, TwinInputs, pose, schema, temperature, twist, wrench

#: Class -> the check that names it.
BAD: dict[type[Slider], str] = {}


def bad(check: str):
    def note(cls: type[Slider]) -> type[Slider]:
        cls.__doc__ = cls.__doc__ or "A slider that is wrong."
        cls.__qualname__ = cls.__name__
        BAD[cls] = check
        return cls

    return note


def with_twin(check: str):
    """Make a device of a twin that is wrong."""

    def note(twin: type[SliderTwin]) -> type[SliderTwin]:
        BAD[type(twin.__name__, (Slider,), {"Twin": twin, "__doc__": "A slider.", "__module__": twin.__module__})] = (
            check
        )
        return twin

    return note


@bad("twin-fills")
class ForgetsAField(Slider):
    reads = (pose(locked=(3, 4, 5)), twist())


@with_twin("keeps-nothing")
class KeepsTheReading(SliderTwin):
    def read(self, state: Record, reading: Record) -> bool:
        self.last = reading["pose"]
        return super().read(state, reading)


@with_twin("keeps-nothing")
class KeepsTheCommand(SliderTwin):
    def step(self, state, command, touch, period):
        self.last = [command]
        super().step(state, command, touch, period)


@bad("driver-keeps-nothing")
class DriverKeepsTheReading(Slider):
    def read(self, reading: Record) -> bool:
        self.last = {"reading": reading}
        return super().read(reading)


@bad("driver-timing")
class Blocks(Slider):
    def read(self, reading: Record) -> bool:
        time.sleep(0.004)
        return super().read(reading)


@with_twin("twin-timing")
class TwinWaits(SliderTwin):
    def step(self, state, command, touch, period):
        time.sleep(0.001)
        super().step(state, command, touch, period)


@with_twin("allocates-nothing")
class GathersMemory(SliderTwin):
    log: list = []

    def step(self, state, command, touch, period):
        self.log.append(touch.finger_pose.copy())
        super().step(state, command, touch, period)


@bad("declarations")
class HasNoLimit(Slider):
    commands = (Channel("wrench", 6, "N", safe=(0.0,) * 6, locked=(3, 4, 5)),)


@bad("declarations")
class HasAnEndlessLimit(Slider):
    commands = (Channel("wrench", 6, "N", (-math.inf,) * 6, (math.inf,) * 6, safe=(0.0,) * 6, locked=(3, 4, 5)),)


@bad("declarations")
class SaysNothingOfSafety(Slider):
    commands = (replace(wrench(force=5.0), safe=None),)


@bad("declarations")
class IsSafeOutsideItsLimits(Slider):
    commands = (replace(wrench(force=5.0), safe=(0.0, 0.0, 9.0, 0.0, 0.0, 0.0)),)


@dataclass(frozen=True)
class PlainParams(SliderParams):
    """Parameters of which one is no grammar."""

    gain: float = 3.0


@bad("declarations")
class HasAPlainParameter(Slider):
    Params = PlainParams


@dataclass
class ThawedParams:
    """Parameters that can be changed."""

    port: str = schema.text(default="loop://", doc="port")


@bad("declarations")
class HasThawedParameters(Slider):
    Params = ThawedParams


@dataclass(frozen=True)
class SilentParams(SliderParams):
    """Parameters of which one is not explained."""

    gain: float = schema.quantity("N/m", low=0.0, high=10.0, default=3.0)


@bad("documentation")
class ExplainsNothing(Slider):
    Params = SilentParams


@dataclass(frozen=True)
class OutOfItsRange(SliderParams):
    """Parameters with a default that their own range refuses."""

    gain: float = schema.quantity("N/m", low=0.0, high=10.0, default=30.0, doc="gain")


@dataclass(frozen=True)
class Required(SliderParams):
    """Parameters of which one has no default."""

    gain: float = schema.quantity("N/m", low=0.0, high=10.0, doc="gain")


@bad("declarations")
class NeedsAParameter(Slider):
    Params = Required


@with_twin("twin-pose")
class LeavesTheQuaternionZero(SliderTwin):
    def read(self, state: Record, reading: Record) -> bool:
        super().read(state, reading)
        reading["pose"][3:] = 0.0
        return True


@with_twin("twin-pose")
class TurnsALockedAxis(SliderTwin):
    def read(self, state: Record, reading: Record) -> bool:
        super().read(state, reading)
        half = 5.0 * state["place"][0]
        reading["pose"][3:] = (math.cos(half), math.sin(half), 0.0, 0.0)
        return True


@bad("reopens")
class LeaksAThread(Slider):
    def open(self) -> None:
        super().open()
        threading.Thread(target=time.sleep, args=(30.0,), daemon=True).start()


@bad("unplug")
class SwallowsErrors(Slider):
    def read(self, reading: Record) -> bool:
        with contextlib.suppress(Exception):
            super().read(reading)
        return True


@with_twin("twin-rest")
class MovesByItself(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        state["place"][0] += 0.02 * period


@bad("disabled-is-still")
class PushesWhenItIsOpened(Slider):
    def open(self) -> None:
        super().open()
        if self._line >= 0:
            os.write(self._line, b"F 3.0\n")


@with_twin("twin-frame")
class ReadsMillimetres(SliderTwin):
    def read(self, state: Record, reading: Record) -> bool:
        super().read(state, reading)
        reading["pose"][:3] *= 1000.0
        return True


@with_twin("twin-frame")
class SwapsAxes(SliderTwin):
    def read(self, state: Record, reading: Record) -> bool:
        super().read(state, reading)
        reading["pose"][:3] = reading["pose"][[1, 0, 2]]
        return True


@with_twin("twin-frame")
class TurnsASign(SliderTwin):
    def read(self, state: Record, reading: Record) -> bool:
        super().read(state, reading)
        reading["pose"][2] *= -1.0
        return True


class CelsiusTwin(SliderTwin):
    def read(self, state: Record, reading: Record) -> bool:
        reading["temperature"] = 23.0
        return super().read(state, reading)


@bad("twin-kelvin")
class ReadsCelsius(Slider):
    reads = (pose(locked=(3, 4, 5)), temperature(role=Role.OTHER_TEMPERATURE, low=0.0, high=400.0))
    Twin = CelsiusTwin


@with_twin("state-declared")
class KeepsStateInAnAttribute(SliderTwin):
    lag = 0.0

    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        self.lag += 0.1 * (touch.finger_pose[0] - self.lag)
        state["place"][0] = 0.999 * state["place"][0] + 0.001 * self.lag


@with_twin("determinism")
class ThrowsDice(SliderTwin):
    def read(self, state: Record, reading: Record) -> bool:
        super().read(state, reading)
        reading["pose"][0] += 1e-6 * np.random.random()
        return True


@with_twin("determinism")
class SharesAGlobal(SliderTwin):
    count = [0]

    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        self.count[0] += 1
        state["place"][1] += 1e-7 * (self.count[0] % 5)


@with_twin("determinism")
class LooksAtTheClock(SliderTwin):
    def read(self, state: Record, reading: Record) -> bool:
        super().read(state, reading)
        reading["pose"][0] += 1e-6 * math.sin(time.perf_counter() * 1e5)
        return True


@bad("writes-in-read")
class WritesInRead(Slider):
    def read(self, reading: Record) -> bool:
        command = Record.of([Field("wrench", "f8", 6)])
        self.write(command)
        return super().read(reading)


@with_twin("twin-finite")
class DividesByZero(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        with np.errstate(all="ignore"):
            state["place"] = state["place"] / np.where(touch.force > 0.9, 0.0, 1.0) * 1.0


@with_twin("twin-command")
class ChangesTheCommand(SliderTwin):
    def step(self, state, command, touch, period):
        command["wrench"] *= 0.5
        super().step(state, command, touch, period)


@with_twin("twin-command")
class ChangesTheTouch(SliderTwin):
    def step(self, state, command, touch: TwinInputs, period):
        touch.finger_pose[:3] += 1e-3
        super().step(state, command, touch, period)


class WindingTwin(SliderTwin):
    def fields(self):
        return (*super().fields(), Field("wound", "f8", 1))

    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        push = abs(float(command["wrench"][2]))
        if push > 4.9:
            state["wound"] = state["wound"] * 1e3 + 1.0

    def read(self, state: Record, reading: Record) -> bool:
        with np.errstate(all="ignore"):
            super().read(state, reading)
            reading["pose"][0] += 0.0 * state["wound"][0]
        return True


@bad("twin-limits")
class WindsUpAtItsLimit(Slider):
    Twin = WindingTwin


@bad("lifecycle")
class CannotClose(Slider):
    def close(self) -> None:
        super().close()
        raise RuntimeError("already closed")


@bad("errors-are-named")
class LetsLibrariesSpeak(Slider):
    def open(self) -> None:
        self._line, self._rest, self._place = -1, b"", (0.0, 0.0, 0.0)
        if self.params.port != "loop://":
            self._line = os.open(self.params.port, os.O_RDWR)


@bad("driver-fills")
class DriverForgetsTheQuaternion(Slider):
    def read(self, reading: Record) -> bool:
        reading["pose"][:3] = self._place
        return True


class CentimetreEmulator(SliderEmulator):
    def serve(self, now: float, reading: Record, command: Record) -> bool:
        other = reading.copy()
        other["pose"][:3] = 100.0 * reading["pose"][:3] + 0.5
        return super().serve(now, other, command)


@bad("twin-and-driver-agree")
class DisagreesWithItsTwin(Slider):
    Emulator = CentimetreEmulator


@bad("locked-axes")
class LocksOnlyItsPose(Slider):
    commands = (wrench(force=5.0, torque=0.1),)


@bad("parameters")
class HasADefaultOutOfItsRange(Slider):
    Params = OutOfItsRange
