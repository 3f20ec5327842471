"""Checks of a device's twin, on a bench without a scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from itouch.plugin import Channel, Role
from itouch.plugin.ideal import ROOM
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.harness import PERIOD, DeviceHarness, TwinBench


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


@check("twin-fills", "the twin fills its whole reading, always")
def fills(harness: DeviceHarness) -> None:
    """Read into a record full of NaN, many times, both free and touched."""
    bench = harness.bench()
    if not bench.reads:
        raise NotApplicableError("it reads nothing")
    bench.step(5)
    fresh = 0
    for _ in range(max(1000, round(3.0 * harness.cls.period / PERIOD))):
        for view in bench.reading.values():
            view[...] = np.nan
        bench.step()
        if bench.fresh is not False:
            fresh += 1
            _filled(bench)
    if not fresh:
        raise _fail(
            "nothing new was read in a thousand ticks",
            "read returns False for good",
            "return True when there is something new",
        )


def _filled(bench: TwinBench) -> None:
    for name, view in bench.reading.items():
        if np.isnan(view).any():
            raise _fail(
                f"the field '{name}' was not filled by read at tick {bench.tick}, which is {view}",
                "a forgotten field, or `reading = ...` in place of `reading[name] = ...`",
                "write every field on every read",
            )


@check("twin-finite", "readings are finite and within limits")
def finite(harness: DeviceHarness) -> None:
    """Drive the twin for two seconds."""
    bench = harness.bench()
    for _ in range(2000):
        bench.step()
        for channel in bench.reads:
            view = bench.reading[channel.name]
            if not np.isfinite(view).all():
                raise _fail(
                    f"'{channel.name}' is {view} at tick {bench.tick}",
                    "an integration that is not stable, or a division by zero",
                    "check the step for the servo period of 1 ms",
                )
            _inside(channel, view, bench.tick)


def _inside(channel: Channel, view: Any, tick: int) -> None:
    if channel.low and (view < np.array(channel.low)).any() or channel.high and (view > np.array(channel.high)).any():
        raise _fail(
            f"'{channel.name}' is {view} at tick {tick}, outside of {channel.low} to {channel.high}",
            "units: readings are SI, temperatures kelvin",
            "convert at the plugin's edge",
        )


@check("twin-pose", "unit quaternions; locked axes stay")
def pose(harness: DeviceHarness) -> None:
    """Watch the pose while the twin is driven."""
    bench = harness.bench()
    channel = _channel(bench, Role.TRACKED_POSE)
    bench.step()
    first = bench.reading[bench.pose].copy()
    for _ in range(1000):
        bench.step()
        now = bench.reading[bench.pose]
        if now[3] == 0.0 and abs(now[6]) == 1.0:
            raise _fail(
                f"the quaternion at rest is {now[3:]}: half a turn about z",
                "the order x y z w",
                "write w x y z; no rotation is 1 0 0 0",
            )
        if abs(float(np.linalg.norm(now[3:])) - 1.0) > 1e-6:
            raise _fail(
                f"the quaternion is {now[3:]}",
                "it was left zero, or is in the order x y z w",
                "write w x y z with unit length; no rotation is 1 0 0 0",
            )
        moved = [axis for axis in channel.locked if axis < 3 and abs(now[axis] - first[axis]) > 1e-9]
        turned = [axis for axis in channel.locked if axis >= 3 and abs(now[axis + 1] - first[axis + 1]) > 1e-9]
        if moved or turned:
            raise _fail(
                f"the locked axes {moved + turned} move",
                "the finger's whole pose was copied",
                "write only the axes that the mechanism has",
            )


def _channel(bench: TwinBench, role: Role) -> Channel:
    found = next((channel for channel in bench.reads if channel.role is role), None)
    if found is None:
        raise NotApplicableError(f"it reads no {role.value}")
    return found


@check("twin-frame", "it is where the finger is, or was sent")
def frame(harness: DeviceHarness) -> None:
    """Hold a finger, or command a target, off the origin along each axis, and compare the pose."""
    if harness.cls.input_source == "recording":
        raise NotApplicableError("it leads the finger")
    bench = harness.bench()
    channel = _channel(bench, Role.TRACKED_POSE)
    target = next((c for c in bench.commands if c.role is Role.SURFACE_POSE), None)
    place = _sent(bench, target) if target is not None else _held(bench)
    seen, free = bench.reading[bench.pose][:3].copy(), [axis for axis in range(3) if axis not in channel.locked]
    _compare(seen[free], place[free], "where it was sent" if target is not None else "where the finger is")


def _sent(bench: TwinBench, target: Channel) -> Any:
    start = bench.start[bench.pose][:3].copy()
    goal = start + np.clip(
        np.array([0.004, -0.006, 0.005]), np.array(target.low[:3]) - start, np.array(target.high[:3]) - start
    )
    for tick in range(3000):
        part = min(1.0, tick / 1000)
        bench.command[target.name] = (*(start + part * (goal - start)), 1.0, 0.0, 0.0, 0.0)
        bench.step(driven=False)
    return goal


def _held(bench: TwinBench) -> Any:
    bench.touch.finger_attached = True
    place = np.array([0.004, -0.006, 0.005])
    bench.touch.finger_pose[:3] = place
    bench.step(600, driven=False)
    if not bench.reading[bench.pose][:3].any():
        raise _fail(
            "the twin does not follow the finger",
            "touch.finger_pose is not used",
            "while touch.finger_attached, the device's end is at touch.finger_pose",
        )
    return place


def _compare(seen: Any, place: Any, what: str) -> None:
    if not len(place) or np.abs(seen - place).max() < 1.5e-3:
        return
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = float(np.median(np.abs(seen) / np.maximum(np.abs(place), 1e-12)))
    cause = "another frame: axes swapped, a sign, or an offset that the mount should have"
    if 300 < ratio < 3000:
        cause = "readings in millimetres: units are SI, metres"
    elif 3e-4 < ratio < 3e-3:
        cause = "millimetres read as micrometres, or a factor of 1000 too much"
    raise _fail(
        f"the pose reads {np.round(seen, 5)} m, but {what} is {np.round(place, 5)} m",
        cause,
        "readings are in the device's own frame, in metres",
    )


@check("twin-kelvin", "temperatures are kelvin, the room's at first")
def kelvin(harness: DeviceHarness) -> None:
    """Read temperatures at rest."""
    bench = harness.bench()
    channels = [channel for channel in bench.reads if channel.unit == "K"]
    if not channels:
        raise NotApplicableError("it reads no temperature")
    bench.step(50, driven=False)
    for channel in channels:
        for value in np.ravel(bench.reading[channel.name]):
            if abs(value - ROOM) > 40.0:
                raise _fail(
                    f"'{channel.name}' reads {value:g} K in a room of {ROOM:g} K",
                    "degrees Celsius" if abs(value + 273.15 - ROOM) < 40 else "a twin that ignores `set_environment`",
                    "add 273.15; take the room from set_environment(ambient, ...)",
                )


@check("twin-rest", "under the safe command nothing moves or heats")
def rest(harness: DeviceHarness) -> None:
    """Send the safe command for half a second without a finger."""
    bench = harness.bench()
    warm = [channel.name for channel in bench.reads if channel.unit == "K"]
    if not bench.pose and not warm:
        raise NotApplicableError("it reads neither a pose nor a temperature")
    bench.step(20, driven=False)
    before = {name: view.copy() for name, view in bench.reading.items()}
    bench.step(500, driven=False)
    for name in warm:
        change = float(np.abs(bench.reading[name] - before[name]).max())
        if change > 1.0:
            raise _fail(
                f"'{name}' changes by {change:.1f} K in half a second under its safe command",
                "it heats or cools when it is not enabled, or its safe command is none",
                "a device heats only by its command",
            )
    if not bench.pose:
        return
    moved = float(np.abs(bench.reading[bench.pose][:3] - before[bench.pose][:3]).max())
    if moved > 2e-3:
        raise _fail(
            f"it moves {1e3 * moved:.1f} mm in half a second under its safe command",
            "it moves when it is not enabled, or its safe command is none",
            "a device moves only by its command",
        )


@check("twin-command", "command and touch are left as they are")
def command_untouched(harness: DeviceHarness) -> None:
    """Compare command and twin inputs before and after a step."""
    bench = harness.bench()
    for _ in range(50):
        bench.drive()
        before, finger = bench.command.tobytes(), bench.touch.finger_pose.copy()
        bench.step(driven=False)
        if bench.command.tobytes() != before or (bench.touch.finger_pose != finger).any():
            raise _fail(
                "the twin writes into its command or its touch",
                "an operation in place on an argument",
                "copy before you change: np.array(command[...])",
            )


@check("twin-limits", "it withstands every command that is allowed")
def bounded(harness: DeviceHarness) -> None:
    """Drive every command to its limits; readings must stay finite."""
    bench = harness.bench()
    if not bench.commands:
        raise NotApplicableError("it obeys no command")
    for channel in bench.commands:
        if channel.role is Role.SURFACE_POSE:
            continue
        for ends in (channel.low, channel.high):
            if ends and all(math.isfinite(end) for end in ends):
                bench.command[channel.name] = ends
                bench.step(200, driven=False)
    for name, view in bench.reading.items():
        if not np.isfinite(view).all():
            raise _fail(
                f"'{name}' is {view} after commands at their limits",
                "no limit in the twin's physics",
                "the twin must survive every command that its channels allow",
            )


@check("twin-twist", "its velocity is that of its pose")
def velocity(harness: DeviceHarness) -> None:
    """Compare the twist with the change of the pose while the finger moves."""
    bench = harness.bench()
    twist = next((channel.name for channel in bench.reads if channel.role is Role.TRACKED_TWIST), "")
    if not bench.pose or not twist:
        raise NotApplicableError("it does not read both pose and twist")
    bench.step(300)
    places, speeds = [], []
    for _ in range(600):
        bench.step()
        places.append(bench.reading[bench.pose][:3].copy())
        speeds.append(bench.reading[twist][:3].copy())
    width = 40  # half the ticks of a difference: noise, and lags of a few ms, do not matter
    true = (np.array(places[2 * width :]) - np.array(places[: -2 * width])) / (2 * width * PERIOD)
    told = np.array([np.mean(speeds[i : i + 2 * width], axis=0) for i in range(len(speeds) - 2 * width)])
    scale = float(np.abs(true).max())
    if scale > 1e-3 and float(np.abs(told - true).max()) > 0.3 * scale:
        ratio = float((told * true).sum() / max(float((true * true).sum()), 1e-12))
        raise _fail(
            f"the twist is {ratio:.3g} times the velocity of the pose",
            "millimetres a second, a sign, another frame, or a velocity that is never set"
            if abs(ratio - 1.0) > 0.3
            else "axes that are swapped, or a lag of many ticks",
            "the twist is in metres and radians a second, in the frame of the pose",
        )
