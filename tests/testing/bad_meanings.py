"""Plugins whose declarations are wrong in one way each, by the name of the check that must find it."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from bad import bad
from slider import Slider, SliderTwin

from itouch.plugin import HOLD, Channel, Field, Role, current, deadman, plate_temperature, pose, temperature

POSE = pose(locked=(3, 4, 5))


@bad("meaning")
class SaysNoUnit(Slider):
    reads = (POSE, Channel("load", 1, "", doc="load of the motor"))
    Twin = None


@bad("meaning")
class SaysNotWhatItIs(Slider):
    reads = (POSE, Channel("load", 1, "N"))
    Twin = None


@bad("meaning")
class DeclaresKilopascals(Slider):
    reads = (POSE, Channel("bladder", 1, "kPa", doc="pressure in the bladder"))
    Twin = None


class UnsaidTwin(SliderTwin):
    def fields(self):
        return (*super().fields(), Field("secret"))


@bad("meaning")
class HidesAField(Slider):
    Twin = UnsaidTwin


class WronglyMeasuredTwin(SliderTwin):
    def fields(self):
        return (*super().fields(), Field("level", unit="mm Hg", doc="pressure in the bladder"))


@bad("meaning")
class MeasuresAFieldInMillimetresOfMercury(Slider):
    Twin = WronglyMeasuredTwin


@bad("roles")
class CallsAForceASwitch(Slider):
    reads = (POSE, Channel("grip", 1, "N", role=Role.DEADMAN, doc="force of the grip"))
    Twin = None


@bad("roles")
class ReadsWhatIsACommand(Slider):
    reads = (POSE, Channel("drive", 1, "A", role=Role.DRIVE, doc="current that flows"))
    Twin = None


@bad("roles")
class CommandsWhatIsAReading(Slider):
    commands = (*Slider.commands, Channel("held", 1, "1", (0.0,), (1.0,), safe=(0.0,), role=Role.DEADMAN, doc="switch"))
    Twin = None


class PlateTwin(SliderTwin):
    """A plate of 20 J/K behind a drive of 10 W/A; what is called the plate's temperature is the room's."""

    told: ClassVar[str] = "room"

    def fields(self):
        return (*super().fields(), Field("heat", unit="K", doc="how much warmer the plate is", show="no"))

    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        state["heat"] -= 0.5 * command["current"][0] * period

    def read(self, state, reading):
        reading["plate"], reading["back"] = 296.15, 296.15
        reading["plate" if self.told == "plate" else "back"] += state["heat"]
        return super().read(state, reading)


class FollowingTwin(PlateTwin):
    told = "plate"


@bad("roles")
class CallsTheRoomItsPlate(Slider):
    reads = (POSE, plate_temperature("plate"), temperature("back", Role.OTHER_TEMPERATURE))
    commands = (*Slider.commands, current(limit=4.0))
    Twin = PlateTwin


class FollowsItsPlate(CallsTheRoomItsPlate):
    """The same with a sensor on the plate: nothing is wrong with it."""

    Twin = FollowingTwin


class ReversedTwin(FollowingTwin):
    def read(self, state, reading):
        found = super().read(state, reading)
        reading["plate"] = 2.0 * 296.15 - reading["plate"]
        return found


@bad("roles")
class ReversesTheSensorOfItsPlate(CallsTheRoomItsPlate):
    Twin = ReversedTwin


class HeaterTwin(FollowingTwin):
    """A resistor, which heats when current flows."""

    def step(self, state, command, touch, period):
        SliderTwin.step(self, state, command, touch, period)
        state["heat"] += 0.5 * command["current"][0] * period


class HeatsItsPlate(CallsTheRoomItsPlate):
    """A plate that is only heated: nothing is wrong with it."""

    commands = (*Slider.commands, replace(current(limit=4.0), low=(0.0,)))
    Twin = HeaterTwin


class HasASwitch(Slider):
    """A switch that is one."""

    reads = (POSE, deadman("grip"))
    Twin = None


@bad("declarations")
class HoldsItsDrive(FollowsItsPlate):
    commands = (*Slider.commands, replace(current(limit=4.0), safe=HOLD))


@bad("declarations")
class ActsWhenItIsSafe(FollowsItsPlate):
    commands = (*Slider.commands, replace(current(limit=4.0), safe=(1.0,)))


@bad("declarations")
class IsSlowerThanItsWatchdog(Slider):
    period = 0.25


@bad("declarations")
class TakesLongerThanItsWatchdog(Slider):
    blocking, delay = True, 0.03
