"""Plugins whose State is not all that there is, or that are not decided by their seed, by the check that finds it."""

from __future__ import annotations

import os
import random
import tempfile
import time
import uuid
from pathlib import Path

import numpy as np
from bad import bad, with_twin
from slider import Slider, SliderTwin

from itouch.plugin import Channel, Record, TwinInputs, measured_wrench, pose, twist, wrench

LAG = {"place": 0.0}
FILE = Path(tempfile.gettempdir()) / f"slider-state-{os.getpid()}"


@with_twin("state-declared")
class KeepsStateInAGlobal(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        LAG["place"] += 0.05 * (touch.finger_pose[0] - LAG["place"])
        state["place"][0] += 1e-3 * LAG["place"]


@with_twin("state-declared")
class KeepsStateInItsClass(SliderTwin):
    lag = 0.0

    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        type(self).lag += 0.05 * (touch.finger_pose[0] - self.lag)
        state["place"][0] += 1e-3 * self.lag


def lagging():
    lag = 0.0

    def follow(place):
        nonlocal lag
        lag += 0.05 * (place - lag)
        return lag

    return follow


@with_twin("state-declared")
class KeepsStateInAClosure(SliderTwin):
    follow = staticmethod(lagging())

    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        state["place"][0] += 1e-3 * self.follow(touch.finger_pose[0])


@with_twin("state-declared")
class KeepsStateInAFile(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        lag = float(FILE.read_text()) if FILE.exists() else 0.0
        lag += 0.05 * (touch.finger_pose[0] - lag)
        FILE.write_text(str(lag))
        state["place"][0] += 1e-3 * lag


@with_twin("state-declared")
class KeepsStateInAnArray(SliderTwin):
    def __init__(self, params) -> None:
        super().__init__(params)
        self.line = np.zeros(5)

    def step(self, state, command, touch: TwinInputs, period):
        super().step(state, command, touch, period)
        state["place"][0] = self.line[-1]
        self.line[1:] = self.line[:-1].copy()
        self.line[0] = touch.finger_pose[0]


@with_twin("state-declared")
class KeepsStateInASlot(SliderTwin):
    __slots__ = ("last",)

    def step(self, state, command, touch: TwinInputs, period):
        super().step(state, command, touch, period)
        state["place"][0] += 1e-3 * getattr(self, "last", 0.0)
        self.last = float(touch.finger_pose[0])


@with_twin("state-declared")
class CountsInAnAttribute(SliderTwin):
    count = 0

    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        self.count += 1


@with_twin("determinism")
class DrawsFromTheModule(SliderTwin):
    def reset(self, state, rng):
        super().reset(state, rng)
        state["noise"] = random.getrandbits(62)


@with_twin("determinism")
class ReadsTheWallClock(SliderTwin):
    def reset(self, state, rng):
        super().reset(state, rng)
        state["noise"] = time.time_ns()


@with_twin("determinism")
class LooksAtItsAddress(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        state["place"][1] += 1e-9 * (id(self) % 1009)


@with_twin("determinism")
class TakesAUniqueNumber(SliderTwin):
    def reset(self, state, rng):
        super().reset(state, rng)
        state["noise"] = uuid.uuid4().int >> 66


class HashingTwin(SliderTwin):
    """Takes its noise from the hash of a text."""

    def reset(self, state, rng):
        super().reset(state, rng)
        state["noise"] = abs(hash("slider"))


@bad("determinism")
class TakesAHash(Slider):
    Twin = HashingTwin


class SetTwin(SliderTwin):
    """Goes through a set of texts."""

    def reset(self, state, rng):
        super().reset(state, rng)
        words = {"left", "middle", "right", "back", "front", "top", "bottom"}
        state["noise"] = int.from_bytes("".join(word[:1] for word in words).encode())


@bad("determinism")
class GoesThroughASet(Slider):
    Twin = SetTwin


class PidTwin(SliderTwin):
    """Takes the number of the process."""

    def reset(self, state, rng):
        super().reset(state, rng)
        state["noise"] = os.getpid()


@bad("determinism")
class TakesTheProcessNumber(Slider):
    Twin = PidTwin


@with_twin("keeps-nothing")
class KeepsTheState(SliderTwin):
    def step(self, state, command, touch, period):
        self.seen = state["place"]
        super().step(state, command, touch, period)


@with_twin("keeps-nothing")
class KeepsTheTouch(SliderTwin):
    def step(self, state, command, touch, period):
        self.touch = touch
        super().step(state, command, touch, period)


KEPT: list = []


@with_twin("keeps-nothing")
class KeepsAViewInAGlobal(SliderTwin):
    def read(self, state, reading):
        KEPT[:] = [reading["pose"][:3]]
        return super().read(state, reading)


@bad("driver-keeps-nothing")
class DriverKeepsTheCommand(Slider):
    def write(self, command: Record) -> None:
        self.later = lambda: command["wrench"]
        super().write(command)


@with_twin("twin-fills")
class ForgetsNowAndThen(SliderTwin):
    def read(self, state, reading):
        if state["place"][0] < 0.009:
            return super().read(state, reading)
        reading["pose"][:3] = state["place"]
        return True


@with_twin("twin-pose")
class WritesTheQuaternionBackwards(SliderTwin):
    def read(self, state, reading):
        super().read(state, reading)
        reading["pose"][3:] = (0.0, 0.0, 0.0, 1.0)
        return True


class FastTwin(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        self.speed = 1000.0 * touch.finger_twist

    def read(self, state, reading):
        reading["twist"] = getattr(self, "speed", 0.0)
        return super().read(state, reading)


@bad("twin-twist")
class ReadsMillimetresASecond(Slider):
    reads = (pose(locked=(3, 4, 5)), twist())
    Twin = FastTwin


@bad("units")
class DeclaresMillinewtons(Slider):
    reads = (pose(locked=(3, 4, 5)), Channel("load", 1, "mN"))
    Twin = None


@bad("units")
class DeclaresCelsius(Slider):
    reads = (pose(locked=(3, 4, 5)), Channel("motor_temperature", 1, "degC"))
    Twin = None


@bad("units")
class DeclaresAnUnknownUnit(Slider):
    reads = (pose(locked=(3, 4, 5)), Channel("motor_temperature", 1, "Celsius"))
    Twin = None


@bad("units")
class GivesItsPeriodInMilliseconds(Slider):
    period = 5.0


@bad("units")
class GivesItsWatchdogInMilliseconds(Slider):
    watchdog = 100.0


class HeatingTwin(SliderTwin):
    def fields(self):
        from itouch.plugin import Field

        return (*super().fields(), Field("heat"))

    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        state["heat"] += 10.0 * period

    def read(self, state, reading):
        reading["temperature"] = 296.15 + state["heat"]
        return super().read(state, reading)


@bad("twin-rest")
class HeatsByItself(Slider):
    from itouch.plugin import Role, temperature

    reads = (pose(locked=(3, 4, 5)), temperature("temperature", Role.OTHER_TEMPERATURE))
    Twin = HeatingTwin


class SilentTwin(SliderTwin):
    def read(self, state, reading):
        return False


@bad("twin-fills")
class NeverReads(Slider):
    reads = (pose(locked=(3, 4, 5)), measured_wrench())
    Twin = SilentTwin


@bad("commands-arrive")
class ForgetsTwoAxes(Slider):
    commands = (wrench(force=5.0),)


@bad("commands-arrive")
class SendsMillinewtons(Slider):
    def write(self, command: Record) -> None:
        if self._line >= 0:
            os.write(self._line, f"F {1000.0 * float(command['wrench'][2]):.3f}\n".encode())


@bad("commands-arrive")
class SendsTheWrongSign(Slider):
    def write(self, command: Record) -> None:
        if self._line >= 0:
            os.write(self._line, f"F {-float(command['wrench'][2]):.3f}\n".encode())


@bad("unplug")
class ReadsNaNWhenItIsUnplugged(Slider):
    def read(self, reading: Record) -> bool:
        from itouch.plugin import DeviceError

        try:
            return super().read(reading)
        except DeviceError:
            reading["pose"] = np.nan
            return True


@bad("watched")
class DrivesUnwatched(Slider):
    from itouch.plugin import Role

    commands = (*Slider.commands, Channel("heater", 1, "W", (0.0,), (5.0,), safe=(0.0,), role=Role.DRIVE))


@bad("watched")
class DoesNotSayWhatFor(Slider):
    commands = (*Slider.commands, Channel("voltage", 1, "V", (0.0,), (5.0,), safe=(0.0,)))
