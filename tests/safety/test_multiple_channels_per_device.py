"""A device that has several of what most have one of: each is supervised, not only the first; and odd ways to read."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_devices import TABLE, Asked
from test_irregular_timing import Exchanges
from test_third_party_device_supervision import Entry, Nothing, catalog, scene

import itouch
from itouch.exchange import ThreadedDevice
from itouch.exchange.in_step import EveryNth
from itouch.loop import WallClock
from itouch.monitors import Surface, Trip, TripError
from itouch.plugin import (
    Channel,
    Device,
    DeviceError,
    Modality,
    Record,
    Role,
    current,
    deadman,
    heat_flux,
    measured_wrench,
    plate_temperature,
    pose,
    pose_target,
    sink_temperature,
    temperature,
    wrench,
)
from itouch.plugin.discovery import Catalog, Found
from itouch.session.building import load_scene
from itouch.world.model import compile_scene

K0 = 273.15
Says = Callable[[int, Record], object]
HELD, PLATE = deadman("held"), temperature("t", Role.SKIN_CONTACT_TEMPERATURE)


def built(folder: Path, says: Says, reads: tuple[Channel, ...], commands: tuple[Channel, ...], **more: Any) -> Any:
    """Return a session with a device of this kind, which says of its n-th reading what ``says`` says."""

    class Stranger(Device):
        Params, watchdog = Nothing, 0.5

        def open(self) -> None:
            self.count = 0

        def close(self) -> None: ...

        def read(self, reading: Record) -> Any:
            self.count += 1
            reading[HELD.name] = 1.0
            return says(self.count, reading)

    Stranger.reads, Stranger.commands = (*reads, HELD), commands
    elements = more.pop("elements", "")
    for name, value in more.items():
        setattr(Stranger, name, value)
    return itouch.build(scene(folder, "pad", twin="no", more=elements), catalog=catalog({"stranger": Stranger}))


def warm(count: int, reading: Record, name: str = "t") -> None:
    reading[name] = K0 + 30.0 + 1e-3 * (count % 7)


# --- what a driver says and hands over ------------------------------------------------------------------------------


@pytest.mark.punctual  # in a thread: each word holds for 80 ms
@pytest.mark.parametrize("no", [False, np.bool_(False), 0])
@pytest.mark.parametrize("behind", ["inline", "in step", "in a thread"])
def test_whatever_is_false_is_no_news(tmp_path: Path, no: object, behind: str) -> None:
    def says(count: int, reading: Record) -> object:
        warm(count, reading)
        reading[HELD.name] = 0.0
        return no if count > 20 else None

    session = built(tmp_path, says, (PLATE,), (current(limit=4.0),), blocking=behind != "inline", period=0.002)
    (runner,) = session.runners
    if behind == "in step":
        runner.gate.device = Exchanges(runner.gate.device.device, itertools.repeat(7))
    if behind == "in a thread":
        assert isinstance(runner.gate.device, ThreadedDevice)
        session.clock = WallClock()
    session.hold()
    session.enable()
    with pytest.raises(itouch.DeviceFaultError, match=r"was silent for 0\.5"):
        session.run(3.0, each=session.hold)
    session.close()


@pytest.mark.punctual
@pytest.mark.parametrize("behind", ["in step", "in a thread"])
@pytest.mark.parametrize(
    "time", [{"inside": -1e9}, {"ago": -1e9}, {"inside": math.nan}, {"ago": math.inf}, {"ago": -0.01}]
)
def test_no_reading_is_from_the_future_or_from_never(tmp_path: Path, time: dict[str, float], behind: str) -> None:
    def read(self: Device, reading: Record) -> None:
        self.count += 1  # type: ignore[attr-defined]
        reading[HELD.name] = 1.0
        warm(self.count, reading)  # type: ignore[attr-defined]
        if self.count > 20:  # type: ignore[attr-defined]
            self.timestamps.measured(**time)

    session = built(tmp_path, warm, (PLATE,), (current(limit=4.0),), blocking=True, period=0.002, read=read)
    (runner,) = session.runners
    if behind == "in step":
        runner.gate.device = EveryNth(runner.gate.device.device, 3)
    else:
        session.clock = WallClock()
    session.enable()
    with pytest.raises(itouch.DeviceFaultError, match=r"= .* must be seconds that have passed") as caught:
        session.run(3.0)
    assert caught.value.trip is Trip.DEVICE_ERROR
    session.close()


def test_what_a_driver_has_not_handed_over_is_seen_by_nobody(tmp_path: Path) -> None:
    def says(count: int, reading: Record) -> bool:
        if count % 50 == 49:
            reading["t"] = K0 + 300.0
            return False
        warm(count, reading)
        return True

    session, seen = built(tmp_path, says, (PLATE,), (current(limit=4.0),)), []
    session.taps.append(lambda tick: seen.append(float(session.state["pad.t"].item())))
    session.enable()
    session.run(0.5)
    assert max(seen) < K0 + 31.0


def test_what_a_driver_does_to_its_command_changes_nothing_that_was_sent(tmp_path: Path) -> None:
    def says(count: int, reading: Record) -> None:
        warm(count, reading)

    def write(self: Device, command: Record) -> None:
        command["current"] *= 1e3  # in mA

    session = built(tmp_path, says, (PLATE,), (current(limit=4.0),), write=write)
    session.enable()
    session.run(0.5, each=lambda: session.state["pad.command.current"].fill(0.5))
    assert 0.0 < session.state["pad.sent.current"].item() <= 0.5


# --- several plates in one device -----------------------------------------------------------------------------------

TWO = tuple(temperature(name, Role.SKIN_CONTACT_TEMPERATURE) for name in ("near", "far"))
DRIVES = current("i_left", limit=4.0), current("i_right", limit=4.0)
FLUXES = heat_flux("j_left", full_scale=3e4), heat_flux("j_right", full_scale=3e4)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("plates", [1, 2])
def test_the_flux_of_every_plate_counts(tmp_path: Path, side: int, plates: int) -> None:
    def says(count: int, reading: Record) -> None:
        for name in ("near", "far")[:plates]:
            warm(count, reading, name)
        reading["j_left"] = reading["j_right"] = 0.0
        reading[FLUXES[side].name] = 20.2e3

    session = built(tmp_path, says, (*TWO[:plates], *FLUXES), DRIVES[:plates])
    session.enable()
    with pytest.raises(itouch.DeviceFaultError, match=r"mean flux of 20\.2 kW/m\^2 for a second \(T6"):
        session.run(3.0)
    assert session.state[f"pad.heat{'2' if side and plates == 2 else ''}.figure"][0] > 20e3


def test_a_flux_trips_at_every_rate_of_the_loop(tmp_path: Path) -> None:
    def reads(count: int, reading: Record) -> None:
        warm(count, reading)
        reading["heat_flux"] = 20.2e3

    for rate in (250, 256, 270, 290, 299, 300, 500, 700, 4000):
        folder = tmp_path / str(rate)
        folder.mkdir()
        element = f'<rates servo="{rate} Hz"/>'
        session = built(folder, reads, (PLATE, heat_flux(full_scale=3e4)), (current(limit=4.0),), elements=element)
        session.enable()
        with pytest.raises(itouch.DeviceFaultError, match="mean flux"):
            session.run(1.5)
        (runner,) = session.runners
        assert runner.gate.device_monitors.clock / rate <= 0.010 + 1e-9


def switch(name: str) -> Channel:
    return Channel(name, 1, "1", (0.0,), (1.0,), safe=(0.0,), role=Role.OUTPUT_SWITCH, doc="1 while it is on")


@pytest.mark.parametrize("switches", [("on_left", "on_right"), ("on",), ("on", "on_too", "on_three"), ()])
def test_a_plate_is_off_with_its_own_switch(tmp_path: Path, switches: tuple[str, ...]) -> None:
    def says(count: int, reading: Record) -> None:
        warm(count, reading, "near")
        reading["far"] = K0 + 25.0 + 1.5e-3 * count  # warms, though it is cooled

    session = built(tmp_path, says, TWO, (*DRIVES, *map(switch, switches)))

    def each() -> None:
        session.state["pad.command.i_right"] = 4.0
        for name in switches[-1:]:
            session.state[f"pad.command.{name}"] = 1.0

    session.enable()
    with pytest.raises(itouch.DeviceFaultError, match=r"went 2\.0 K against its drive"):
        session.run(4.0, each=each)


def test_of_several_heat_sinks_the_hottest_counts(tmp_path: Path) -> None:
    def says(count: int, reading: Record) -> None:
        reading["plate"], reading["one"], reading["other"] = K0 + 30.0 + 1e-3 * (count % 7), K0 + 30.0, K0 + 54.0

    sinks = sink_temperature("one"), sink_temperature("other")
    session = built(tmp_path, says, (plate_temperature("plate"), *sinks), (current(limit=4.0),))
    session.enable()
    session.run(0.5)
    assert session.runners[0].gate.device_monitors.share == pytest.approx(0.2)


# --- a switch that is lost while it is held -------------------------------------------------------------------------


@pytest.mark.parametrize(("how", "after"), [("unplugged", 0.081), ("silent", 0.081)])
def test_a_switch_that_is_lost_is_let_go_though_its_device_is_optional(tmp_path: Path, how: str, after: float) -> None:
    class Pedal(Device):
        Params, watchdog = Nothing, 0.5
        reads, commands = (HELD,), ()

        def open(self) -> None:
            self.count = 0

        def close(self) -> None: ...

        def read(self, reading: Record) -> bool:
            self.count += 1
            reading[HELD.name] = 1.0
            if self.count > 200 and how == "unplugged":
                raise DeviceError("the plug is out")
            return self.count <= 200

    class Pad(Device):
        Params, watchdog = Nothing, 0.5
        reads, commands = (PLATE,), (current(limit=4.0),)

        def open(self) -> None:
            self.count = 0

        def close(self) -> None: ...

        def read(self, reading: Record) -> None:
            self.count += 1
            warm(self.count, reading)

    path = tmp_path / "scene.xml"
    listed = '<device name="pad" plugin="pad" twin="no"/><device name="pedal" plugin="pedal" twin="no" optional="yes"/>'
    path.write_text(f'<itouch version="1.0"><devices>{listed}</devices></itouch>', "utf-8")
    session = itouch.build(path, catalog=catalog({"pad": Pad, "pedal": Pedal}))
    session.enable()
    with pytest.raises(itouch.DeviceFaultError, match="was let go: nobody holds the switch"):
        session.run(2.0)
    assert 0.199 <= session.fault.tick * session.model.period <= 0.2 + after


# --- several forces, and a finger that no probe pushes --------------------------------------------------------------


def wrench_called(name: str) -> Channel:
    return replace(wrench(force=8.0), name=name)


@pytest.mark.parametrize("names", [("one", "other"), ("one", "other", "third")])
def test_an_arm_of_several_forces_pushes_no_harder_than_one_of_one(tmp_path: Path, names: tuple[str, ...]) -> None:
    def says(count: int, reading: Record) -> None:
        reading["pose"] = (0.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0)

    probe = '<interaction><probe name="finger" pose-from="pad"/></interaction>'
    session, sums = built(tmp_path, says, (pose(),), tuple(map(wrench_called, names)), elements=probe), [0.0]

    def each() -> None:
        for name in names:
            session.state[f"pad.command.{name}"] = (5.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        sums.append(sum(session.state[f"pad.sent.{name}"][0].item() for name in names))

    session.enable()
    session.run(1.5, each=each)
    assert 2.99 < max(sums) <= 3.0 + 1e-9
    assert max(np.diff(sums)) <= 1.0 + 1e-9  # K3


@pytest.mark.parametrize("bound", ['force-to="pad"', ""])
def test_a_fast_finger_stops_an_arm_whoever_commands_its_force(tmp_path: Path, bound: str) -> None:
    def says(count: int, reading: Record) -> None:
        reading["pose"] = (1e-3 * (1.3 * count % 300.0), 0.0, 0.1, 1.0, 0.0, 0.0, 0.0)

    probe = f'<interaction><probe name="finger" pose-from="pad" {bound}/></interaction>'
    session = built(tmp_path, says, (pose(),), (wrench(force=8.0),), elements=probe)
    session.enable()
    with pytest.raises(itouch.DeviceFaultError, match=r"moves at 1\.\d+ m/s \(K2"):
        session.run(0.2)


class Pulls(Modality):
    """Commands a device that no probe knows."""

    Params = Nothing

    def compile(self, name: str, params: Any, world: Any) -> None: ...
    def reset(self, model: Any, state: Record) -> None: ...

    def commands(self, model: Any) -> tuple[str, ...]:
        return (type(self).command,)

    def update(self, model: Any, state: Record, period: float) -> None: ...


@pytest.mark.parametrize("twin", ["yes", "no"])
@pytest.mark.parametrize("command", [wrench(force=8.0), pose_target(low=(0, 0, 0), high=(0.1, 0.1, 0.1), speed=0.2)])
def test_what_acts_on_a_finger_that_no_probe_tells_of_is_unmonitored(
    tmp_path: Path, command: Channel, twin: str
) -> None:
    class Rod(Device):
        Params, watchdog = Nothing, 0.5
        reads, commands = (pose(), HELD), (command,)

        def open(self) -> None: ...
        def close(self) -> None: ...
        def read(self, reading: Record) -> None: ...

    pulls = type("Of", (Pulls,), {"command": f"rod.{command.name}"})
    path = tmp_path / "scene.xml"
    listed = f'<devices><device name="rod" plugin="rod" twin="{twin}"/></devices>'
    path.write_text(
        f'<itouch version="1.0" xmlns:tone="urn:itouch:plugin:tone">{listed}<interaction><tone:pulls name="pulls"/>'
        "</interaction></itouch>", "utf-8",
    )  # fmt: skip
    groups = {"itouch.devices": {"rod": Rod}, "itouch.modalities": {"tone.pulls": pulls}}
    plugins = Catalog(lambda g: {n: Found(n, "t", "1", Entry(v)) for n, v in groups.get(g, {}).items()})
    said = "no probe says where the finger is that 'rod' acts on"
    if twin == "no":
        with pytest.raises(itouch.SceneError, match=said):
            itouch.build(path, catalog=plugins)
    else:
        _, problems = compile_scene(load_scene(path, catalog=plugins), plugins)
        assert [(one.code, one.severity) for one in problems if said in one.sentence] == [
            ("unmonitored-drive", "warning")
        ]


@pytest.mark.parametrize("command", [wrench(force=8.0), pose_target(low=(0, 0, 0), high=(0.1, 0.1, 0.1), speed=0.2)])
def test_what_a_script_would_command_on_a_finger_that_no_probe_tells_of_is_not_enabled(
    tmp_path: Path, command: Channel
) -> None:
    def says(count: int, reading: Record) -> None:
        reading["pose"] = (1e-3 * (1.3 * count % 300.0), 0.0, 0.1, 1.0, 0.0, 0.0, 0.0)

    bound = "surface-to" if command.size == 7 else "pose-from"
    said = f"no probe says where the finger is that '{command.name}' acts on: add a probe with {bound}=\"pad\""
    session = built(tmp_path, says, (pose(),), (command,))
    assert f"device 'pad' is only read, it can't be enabled: {said}" in session.notices
    for act in (session.enable, session.rearm):
        with pytest.raises(DeviceError, match=re.escape(f"device 'pad' can't be enabled: {said}")):
            act()
        assert not session.runners[0].latch.enabled
    session.close()


class Stand(Device):
    """A tracker that pushes nobody, or what does on it."""

    Params, watchdog = Nothing, 0.5

    def open(self) -> None:
        self.count = 0

    def close(self) -> None: ...

    def read(self, reading: Record) -> None:
        self.count += 1
        if "pose" in reading:
            reading["pose"] = (1e-3 * (1.3 * self.count % 300.0), 0.0, 0.1, 1.0, 0.0, 0.0, 0.0)
        if HELD.name in reading:
            reading[HELD.name] = 1.0


def test_a_fast_finger_stops_what_is_mounted_on_its_tracker_and_pushes_it(tmp_path: Path) -> None:
    tracker = type("Tracker", (Stand,), {"reads": (pose(), HELD), "commands": ()})
    glove = type("Glove", (Stand,), {"reads": (HELD,), "commands": (wrench(force=8.0),)})
    path = tmp_path / "scene.xml"
    path.write_text(
        '<itouch version="1.0"><devices><device name="eye" plugin="eye" twin="no"/><device name="glove" plugin="glove" '
        'twin="no"><mount on="eye"/></device></devices><interaction><probe name="finger" pose-from="eye"/></interaction>'
        "</itouch>", "utf-8",
    )  # fmt: skip
    session = itouch.build(path, catalog=catalog({"eye": tracker, "glove": glove}))
    session.enable()
    with pytest.raises(itouch.DeviceFaultError, match=r"'glove' moves at 1\.\d+ m/s \(K2"):
        session.run(0.2)


def still(reading: Record) -> None:
    reading["pose"], reading[HELD.name] = (0.0, 0.0, 0.010, 1.0, 0.0, 0.0, 0.0), 1.0


@pytest.mark.parametrize("bound", ['force-to="arm"', ""])
def test_an_arm_leaves_to_a_plate_what_that_presses_with_whoever_commands_its_force(tmp_path: Path, bound: str) -> None:
    class Plate(Stand):
        reads, commands = (pose(locked=(3, 4, 5)), measured_wrench(force=50.0)), (TABLE[1][0],)

        def open(self) -> None:
            self.at = np.zeros(3)

        def read(self, reading: Record) -> None:
            reading["pose"] = (*self.at, 1.0, 0.0, 0.0, 0.0)
            reading["wrench"] = (0.0, 0.0, -1.5, 0.0, 0.0, 0.0)

        def write(self, command: Record) -> None:
            self.at = command["pose_target"][:3].copy()

    arm = type("Arm", (Stand,), {"reads": (pose(), HELD), "commands": (wrench(force=8.0),)})
    arm.read = lambda self, reading: still(reading)  # type: ignore[attr-defined]
    path = tmp_path / "scene.xml"
    path.write_text(
        '<itouch version="1.0"><devices><device name="arm" plugin="arm" twin="no"/><device name="table" plugin="table" '
        'twin="no"><calibration method="none"/></device></devices><interaction><probe name="finger" pose-from="arm" '
        f'{bound} surface-to="table"/></interaction></itouch>', "utf-8",
    )  # fmt: skip
    session, sizes = itouch.build(path, catalog=catalog({"arm": arm, "table": Plate})), [0.0]

    def each() -> None:
        session.state["arm.command.wrench"][0] = 5.0
        sizes.append(session.state["arm.sent.wrench"][0].item())

    session.enable()
    session.run(1.5, each=each)
    session.close()
    assert max(sizes) <= 1.5 + 1e-9


# --- several force sensors under one surface ------------------------------------------------------------------------


@pytest.mark.parametrize("loads", [("wrench",), ("wrench", "other"), ("other", "wrench")])
def test_every_force_sensor_of_a_surface_counts(loads: tuple[str, ...]) -> None:
    reads = (pose(locked=(3, 4, 5)), *(replace(measured_wrench(force=50.0), name=name) for name in loads))
    surface = Asked(Surface, (reads, TABLE[1]))
    surface.moment.gap, surface.moment.tracking_error, surface.moment.finger = -0.001, 0.0, (0.0, 0.0, 0.01)
    surface.reading["pose"] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    surface.reading[loads[-1]] = (0.0, 0.0, -0.1, 0.0, 0.0, 0.0)
    surface.check(0.02)
    assert surface.moment.touched
    for beyond in ((0.0, 0.0, -9.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.6, 0.0, 0.0)):
        surface.reading[loads[-1]] = beyond
        with pytest.raises(TripError, match=r"presses with [69]\.0 N"):
            surface.check()


@pytest.mark.parametrize("restored", [False, True])
@pytest.mark.parametrize("pressed", [True, False])
@pytest.mark.parametrize("fault", ["silent", "hot"])
def test_rearming_asks_the_devices_own_switch_anew(
    tmp_path: Path, fault: str, pressed: bool, restored: bool
) -> None:  # fmt: skip
    now = {"fails": False, "held": 1.0}

    def says(count: int, reading: Record) -> bool:
        warm(count, reading)
        reading[HELD.name] = now["held"]
        if now["fails"] and fault == "hot":
            reading["t"] = K0 + 50.0
        return not (now["fails"] and fault == "silent")

    session = built(tmp_path, says, (PLATE,), (current(limit=4.0),))
    session.enable()
    session.run(0.05)
    now["fails"] = True
    with pytest.raises(itouch.DeviceFaultError):
        session.run(2.0)
    now["fails"], now["held"] = False, float(pressed)
    if restored:
        session.save(tmp_path / "stopped.itouch")
        session.close()
        devices = catalog({"stranger": type(session.runners[0].gate.device)})
        session = itouch.restore(tmp_path / "stopped.itouch", catalog=devices)
    if pressed:
        session.rearm()
        session.run(0.2)
    else:
        with pytest.raises(itouch.ItouchError, match="nobody holds the dead-man's switch"):
            session.rearm()


# --- a surface that does not rise along its own z -------------------------------------------------------------------

TILTED = """<itouch version="1.0"><devices><device name="arm" plugin="usb-arm"/>
  <device name="base" plugin="xyz-table"><mount rpy="%s deg"/></device>
  <device name="table" plugin="xyz-table"><mount on="base" pos="0 0 -8 mm" rpy="%s deg"/></device></devices>
  <interaction><probe name="finger" pose-from="arm" force-to="arm" surface-to="table"/></interaction></itouch>"""


@pytest.mark.parametrize(("base", "table", "tilt"), [
    ("0 0 0", "0 90 0", "90"), ("0 0 0", "180 0 0", "180"), ("20 0 0", "20 0 0", "40"), ("0 24 0", "0 0 70", "24"),
    ("0 20 0", "0 0 70", ""), ("30 0 0", "-30 0 0", ""), ("0 0 180", "0 -20 0", ""),
])  # fmt: skip
def test_a_surface_that_is_mounted_so_that_it_rises_sideways_is_refused(
    tmp_path: Path, base: str, table: str, tilt: str
) -> None:
    (tmp_path / "scene.xml").write_text(TILTED % (base, table), "utf-8")
    if not tilt:
        itouch.build(tmp_path / "scene.xml")
        return
    with pytest.raises(itouch.SceneError, match=f"mounted with its z axis {tilt} deg from upright"):
        itouch.build(tmp_path / "scene.xml")


@pytest.mark.parametrize(("base", "table", "at"), [
    ("0 0 0", "25 0 0", 'rpy="25 0 0 deg"'), ("0 40 0", "0 0 5", 'rpy="0 40 0 deg"'),
])  # fmt: skip
def test_of_a_surface_that_rises_sideways_it_is_said_where_and_how_far_it_may_be_turned(
    tmp_path: Path, base: str, table: str, at: str
) -> None:
    """The advice was 24 deg, which was refused with the same words, and the place was that of <device>."""
    (tmp_path / "scene.xml").write_text(TILTED % (base, table), "utf-8")
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(tmp_path / "scene.xml")
    (problem,) = caught.value.problems
    assert problem.place is not None
    assert problem.place.text[problem.place.column - 1 :].startswith(at)
    most = problem.advice.split("at most ")[1].split(" deg")[0]
    (tmp_path / "scene.xml").write_text(TILTED % ("0 0 0", f"{most} 0 0"), "utf-8")
    itouch.build(tmp_path / "scene.xml")


@pytest.mark.parametrize(("turn", "tilt"), [
    ("25 0 0", "25"), ("0 -90 0", "90"), ("180 0 0", "180"), ("2.1 0 30", "2.1"), ("1 -1 90", ""), ("0 0 180", ""),
])  # fmt: skip
def test_a_face_that_is_mounted_tilted_on_what_carries_it_is_refused(tmp_path: Path, turn: str, tilt: str) -> None:
    """It was taken for level: a plate upside down rendered every touch, with a flux error of 0.3 %."""
    pad = f'<device name="pad" plugin="thermal"><mount on="table" pos="0 0 4 mm" rpy="{turn} deg"/></device></devices>'
    (tmp_path / "scene.xml").write_text((TILTED % ("0 0 0", "0 20 0")).replace("</devices>", pad), "utf-8")
    if not tilt:
        itouch.build(tmp_path / "scene.xml")
        return
    with pytest.raises(
        itouch.SceneError, match=f"'pad' is mounted with its face tilted by {tilt} deg on 'table'"
    ) as caught:
        itouch.build(tmp_path / "scene.xml")
    (problem,) = caught.value.problems
    assert problem.place is not None
    assert problem.place.text[problem.place.column - 1 :].startswith("rpy=")


# --- two who hold ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("other", ["a word", "a switch"])
def test_who_lets_a_devices_switch_go_is_not_covered_by_another(tmp_path: Path, other: str) -> None:
    second, now = deadman("second"), {"held": 1.0, "second": float(other == "a switch")}

    def says(count: int, reading: Record) -> None:
        warm(count, reading)
        reading[HELD.name], reading["second"] = now["held"], now["second"]

    def each() -> None:
        if other == "a word":
            session.hold()

    session = built(tmp_path, says, (PLATE, second), (current(limit=4.0),))
    session.enable()
    session.run(0.05, each=each)
    now["held"] = 0.0
    with pytest.raises(itouch.DeviceFaultError, match="one of those who held the switch let it go at tick 50"):
        session.run(1.0, each=each)
    each()
    session.rearm()  # the other one holds on
    session.run(0.3, each=each)
    now["held"] = 1.0
    session.run(0.1, each=each)
    session.close()
    session.enable()
    session.run(0.05, each=each)
