"""A stranger's hardware for a study: a tracked stick, a lift behind a wire and a plate, and a person who touches.

The scene's operator is for its twins: here nobody moves by that script.  The person is a file of four numbers that the devices read: height [m] of the fingertip, whether the switch is held,
whether the stick's cable is out, and whether the plate's driver fails when it is to switch its drive off.  Each device keeps what it was sent in a file of its own: seconds, then the numbers.
"""

from __future__ import annotations

import itertools
import json
import mmap
import struct
from pathlib import Path

import third_party_plugins

MODULE = '''
import json, mmap, os, struct, time
from dataclasses import dataclass

from itouch.plugin import (
    Device, DeviceError, Field, Modality, Role, current, deadman, measured_wrench, pose, pose_target, schema,
    temperature, wrench,
)

FOLDER = os.environ["STUDY_BENCH"]


@dataclass(frozen=True)
class Nothing:
    """Nothing to set."""


class Told:
    """What a device was sent, and how often it was opened."""

    def __init__(self, name):
        self.path, self.lines, self.last = os.path.join(FOLDER, name + ".log"), [], None

    def note(self, *numbers):
        if numbers != self.last:
            self.lines.append([round(time.monotonic(), 4), *numbers])
            self.last = numbers

    def flush(self, what):
        with open(self.path, "a") as stream:
            stream.write(json.dumps({"what": what, "pid": os.getpid(), "at": round(time.monotonic(), 4),
                                     "sent": self.lines}) + "\\n")
        self.lines = []


class Stick(Device):
    Params = Nothing
    reads = (pose(), deadman())
    commands = (wrench(force=3.0),)
    watchdog = 0.1

    def open(self):
        self.told = Told("stick")
        self.told.flush("open")
        with open(os.path.join(FOLDER, "person"), "r+b") as stream:
            self.person = mmap.mmap(stream.fileno(), 32)
        self.height = None

    def close(self):
        self.told.flush("close")

    def read(self, reading):
        wanted, held, out = struct.unpack("dddd", self.person[:32])[:3]
        if out:
            raise DeviceError("the cable is out")
        if self.height is None:
            self.height = wanted
        self.height += max(-1e-4, min(1e-4, wanted - self.height))  # 0.1 m/s
        reading["pose"] = (0.0, 0.0, self.height, 1.0, 0.0, 0.0, 0.0)
        reading["deadman"] = held

    def write(self, command):
        self.told.note(round(float(command["wrench"][2]), 3))


class Lift(Device):
    Params = Nothing
    reads = (pose(locked=(3, 4, 5)), measured_wrench(force=50.0))
    commands = (pose_target(low=(-0.1, -0.1, 0.0), high=(0.1, 0.1, 0.04), speed=0.25),)
    watchdog, blocking, period = 0.2, True, 0.004

    def open(self):
        self.told, self.place, self.then = Told("lift"), 0.0, time.monotonic()
        self.told.flush("open")
        self.goal = 0.0

    def close(self):
        self.told.flush("close")

    def read(self, reading):
        now = time.monotonic()
        way = 0.25 * (now - self.then)
        self.then = now
        self.place += max(-way, min(way, self.goal - self.place))
        reading["pose"] = (0.0, 0.0, self.place, 1.0, 0.0, 0.0, 0.0)
        reading["wrench"] = (0.0, 0.0, -0.2 if self.place < 0.018 else 0.0, 0.0, 0.0, 0.0)  # its cable pulls a little

    def write(self, command):
        self.goal = float(command["pose_target"][2])
        self.told.note(round(self.goal, 4))


class Plate(Device):
    Params = Nothing
    reads = (temperature("warmth", Role.SKIN_CONTACT_TEMPERATURE),)
    commands = (current(limit=1.0),)
    watchdog = 0.1

    def open(self):
        self.told, self.kelvin = Told("plate"), 300.0
        with open(os.path.join(FOLDER, "person"), "r+b") as stream:
            self.person = mmap.mmap(stream.fileno(), 32)
        self.told.flush("open")
        self.amperes = 0.0

    def close(self):
        self.told.flush("close")

    def read(self, reading):
        self.kelvin += (300.0 - 2.0 * self.amperes - self.kelvin) * 0.0005
        reading["warmth"] = self.kelvin + 1e-3 * (time.monotonic() % 0.01)

    def write(self, command):
        if struct.unpack("dddd", self.person[:32])[3] and not command["current"][0]:
            raise DeviceError("its amplifier does not answer")
        self.amperes = float(command["current"][0])
        self.told.note(round(self.amperes, 3))


class Thermometer(Device):
    """Commands nothing."""

    Params = Nothing
    reads = (temperature("room", Role.OTHER_TEMPERATURE),)

    def open(self):
        if os.path.exists(os.path.join(FOLDER, "no-" + type(self).__name__)):
            raise DeviceError("nothing is plugged in")

    def close(self):
        pass

    def read(self, reading):
        reading["room"] = 295.0


class Lamp(Thermometer):
    """May be absent."""

    commands = (current("light", limit=0.1, harmless="it is a lamp that nobody touches"),)
    watchdog = 0.1


@dataclass(frozen=True)
class CoolParams:
    """How many numbers it keeps."""

    kept: int = schema.integer(low=1, high=9, default=1, doc="numbers in State")


class Cool(Modality):
    """Cools the plate a little, all the time."""

    Params = CoolParams

    def compile(self, name, params, world):
        self.kept = params.kept
        return name

    def fields(self, model):
        return (
            Field("time", unit="s", doc="time so far"),
            Field("kept", size=self.kept, unit="1", doc="nothing, in so many numbers"),
        )

    def reset(self, model, state):
        state[f"{model}.time"] = 0.0

    def commands(self, model):
        return ("plate.current",)

    def update(self, model, state, period):
        state[f"{model}.time"] += period
        state["plate.command.current"] = 0.3
'''
SCENE = """<itouch version="1.0" xmlns:bench="urn:itouch:plugin:bench">
  <materials><material name="wood"><contact stiffness="1.2 N/mm" static-friction="0.4"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices>
    <device name="stick" plugin="bench-stick" twin="no"/>
    <device name="lift" plugin="bench-lift" twin="no"><limits speed="0.25 m/s"/></device>
    <device name="plate" plugin="bench-plate" twin="no"><mount on="lift" pos="0 0 0 mm"/></device>
    <device name="room" plugin="bench-thermometer" twin="no"/>
    <device name="lamp" plugin="bench-lamp" twin="no" optional="yes"/>
  </devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="stick" force-to="stick" surface-to="lift"/>
    <operator probe="finger"><motion><to pos="0 0 27.7 mm" in="0.5 s" hold="1 s"/></motion></operator>
    <bench:cool/>
  </interaction>
</itouch>"""
STUDY = """<study version="1.0" scene="scene.xml" seed="5">
  <factor name="height" levels="low mid high" values="0 0 10 mm;0 0 10.3 mm;0 0 10.6 mm" set="block.pos"/>
  <task kind="identify" factor="height"/>
  <order repetitions="1"/>
  <contact object="block" duration="0.1 s" pause="0 s" reach="5 s"/>
</study>
"""
UP, DOWN = 0.034, 0.0277


def install(folder: Path) -> Path:
    """Lay the distribution out as pip does, and the study beside it; return the folder to put on the path."""
    listed = (
        "[itouch.devices]\nbench-stick = study_bench:Stick\nbench-lift = study_bench:Lift\n"
        "bench-plate = study_bench:Plate\nbench-thermometer = study_bench:Thermometer\nbench-lamp = study_bench:Lamp\n"
        "[itouch.modalities]\nbench.cool = study_bench:Cool\n"
    )
    site = third_party_plugins.install(folder / "site", "bench", listed, module="study_bench", code=MODULE)
    (folder / "scene.xml").write_text(SCENE)
    (folder / "study.xml").write_text(STUDY)
    (folder / "no-Lamp").write_text("")
    (folder / "person").write_bytes(struct.pack("dddd", UP, 1.0, 0.0, 0.0))
    return site


class Person:
    """Holds the switch, and touches when told."""

    def __init__(self, folder: Path) -> None:
        with (folder / "person").open("r+b") as stream:
            self._file = mmap.mmap(stream.fileno(), 32)
        self._folder = folder
        self.height, self.held, self.out, self.stuck = UP, True, False, False
        self.set()

    def set(
        self, *, height: float | None = None, held: bool | None = None, out: bool | None = None,
        stuck: bool | None = None,
    ) -> None:  # fmt: skip
        """Go somewhere, hold the switch or let it go, pull the cable, break the plate's driver."""
        self.height = self.height if height is None else height
        self.held = self.held if held is None else held
        self.out = self.out if out is None else out
        self.stuck = self.stuck if stuck is None else stuck
        self._file[:32] = struct.pack("dddd", self.height, float(self.held), float(self.out), float(self.stuck))

    def sent(self, device: str) -> list[dict[str, object]]:
        """Return what a device was told, from its opening to its closing each."""
        return [json.loads(line) for line in (self._folder / f"{device}.log").read_text().splitlines()]

    def touched_at(self, *among: float) -> list[float]:
        """Return at which of these heights [mm] the lift has stood for a while, in turn; it waits at 21 mm."""
        sent: list[tuple[float, float]] = [pair for entry in self.sent("lift") for pair in entry["sent"]]  # type: ignore[attr-defined]
        stayed = [round(1e3 * height, 1) for (at, height), (after, _) in itertools.pairwise(sent) if after - at > 0.03]
        found = [height for height in stayed if height in among]
        return [height for index, height in enumerate(found) if index == 0 or height != found[index - 1]]
