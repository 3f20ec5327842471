"""What a device's twin must hold to; seen on a bench without a scene."""

from __future__ import annotations

import copy
import gc
import math
import statistics
import time
import tracemalloc
from typing import Any

import numpy as np

from itouch.plugin import Channel, Record
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.subject import PERIOD, ROOM, DeviceSubject, TwinBench


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


@check("twin-fills", "the twin fills every field of its reading")
def fills(subject: DeviceSubject) -> None:
    """Read into a record full of NaN."""
    bench = subject.bench()
    bench.step(5)
    for view in bench.reading.values():
        view[...] = np.nan
    for _ in range(max(1, round(subject.cls.period / PERIOD)) + 20):
        bench.step()
        if bench.fresh is not False:
            break
    for name, view in bench.reading.items():
        if np.isnan(view).any():
            raise _fail(
                f"the field '{name}' was not filled by read",
                "a forgotten field, or `reading = ...` in place of `reading[name] = ...`",
                "write every field on every read",
            )


@check("twin-finite", "readings stay finite and inside what the channels say")
def finite(subject: DeviceSubject) -> None:
    """Drive the twin for two seconds."""
    bench = subject.bench()
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


@check("twin-pose", "poses have unit quaternions, and locked axes do not move")
def pose(subject: DeviceSubject) -> None:
    """Watch the pose while the twin is driven."""
    bench = subject.bench()
    channel = _channel(bench, "pose")
    bench.step()
    first = bench.reading["pose"].copy()
    for _ in range(1000):
        bench.step()
        now = bench.reading["pose"]
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


def _channel(bench: TwinBench, name: str) -> Channel:
    found = next((channel for channel in bench.reads if channel.name == name), None)
    if found is None:
        raise NotApplicableError(f"it reads no {name}")
    return found


@check("twin-frame", "the twin is where the finger is, or where it was sent: frame, sign and unit agree")
def frame(subject: DeviceSubject) -> None:
    """Hold a finger, or command a target, off centre along each axis."""
    bench = subject.bench()
    channel = _channel(bench, "pose")
    target = next((c for c in bench.commands if c.name == "pose_target"), None)
    place = _sent(bench, target) if target is not None else _held(bench)
    seen, free = bench.reading["pose"][:3].copy(), [axis for axis in range(3) if axis not in channel.locked]
    _compare(seen[free], place[free], "where it was sent" if target is not None else "where the finger is")


def _sent(bench: TwinBench, target: Channel) -> Any:
    start = bench.start["pose"][:3].copy()
    goal = start + np.clip(
        np.array([0.004, -0.006, 0.005]), np.array(target.low[:3]) - start, np.array(target.high[:3]) - start
    )
    for tick in range(3000):
        part = min(1.0, tick / 1000)
        bench.command["pose_target"] = (*(start + part * (goal - start)), 1.0, 0.0, 0.0, 0.0)
        bench.step(driven=False)
    return goal


def _held(bench: TwinBench) -> Any:
    bench.touch.finger_attached = True
    place = np.array([0.004, -0.006, 0.005])
    bench.touch.finger_pose[:3] = place
    bench.step(600, driven=False)
    if not bench.reading["pose"][:3].any():
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


@check("twin-kelvin", "temperatures are kelvin and begin near the room's")
def kelvin(subject: DeviceSubject) -> None:
    """Read temperatures at rest."""
    bench = subject.bench()
    channels = [channel for channel in bench.reads if channel.unit == "K"]
    if not channels:
        raise NotApplicableError("it reads no temperature")
    bench.step(50, driven=False)
    for channel in channels:
        for value in np.ravel(bench.reading[channel.name]):
            if abs(value - ROOM) > 40.0:
                raise _fail(
                    f"'{channel.name}' reads {value:g} K in a room of {ROOM:g} K",
                    "degrees Celsius" if abs(value + 273.15 - ROOM) < 40 else "a twin that ignores `stand`",
                    "add 273.15; take the room from stand(ambient, ...)",
                )


@check("twin-rest", "under the safe command the device stays where it is")
def rest(subject: DeviceSubject) -> None:
    """Send the safe command for half a second with nobody there."""
    bench = subject.bench()
    if "pose" not in bench.reading:
        raise NotApplicableError("it reads no pose")
    bench.step(20, driven=False)
    first = bench.reading["pose"][:3].copy()
    bench.step(500, driven=False)
    moved = float(np.abs(bench.reading["pose"][:3] - first).max())
    if moved > 2e-3:
        raise _fail(
            f"it moves {1e3 * moved:.1f} mm in half a second under its safe command",
            "it moves when it is not enabled, or its safe command is none",
            "a device moves only by its command",
        )


@check("twin-command", "the twin changes neither the command nor what it is touched by")
def command_untouched(subject: DeviceSubject) -> None:
    """Compare command and touch before and after a step."""
    bench = subject.bench()
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


@check("state-declared", "everything that changes is in State")
def state_declared(subject: DeviceSubject) -> None:
    """Go on with a new twin object from copied State; it must not make a difference."""
    bench, other = subject.bench(seed=3), subject.bench(seed=99)
    bench.step(337)
    other.state.raw[:] = bench.state.raw
    other.tick = bench.tick
    before = _attributes(bench.twin)
    for tick in range(300):
        bench.step()
        other.step()
        if bench.state.tobytes() != other.state.tobytes() or bench.reading.tobytes() != other.reading.tobytes():
            names = [n for n in bench.state if bench.state[n].tobytes() != other.state[n].tobytes()] or ["the reading"]
            raise _fail(
                f"a restored twin goes on otherwise after {tick + 1} ticks, first in {', '.join(names[:3])}",
                "something that changes is kept in an attribute, a global or a generator of its own",
                "declare it in fields() and keep it in state; random words come from State",
            )
    after = _attributes(bench.twin)
    changed = [name for name in after if before.get(name) != after[name]]
    if changed:
        raise _fail(
            f"the twin's attribute {', '.join(changed)} changes while it runs",
            "State outside of State",
            "declare a field for it",
        )


def _attributes(thing: Any) -> dict[str, str]:
    found = {}
    for name, value in getattr(thing, "__dict__", {}).items():
        if name == "params" or callable(value):
            continue
        try:
            found[name] = repr(copy.deepcopy(value))
        except Exception:  # what can't be copied can't be compared
            continue
    return found


@check("determinism", "equal seeds give equal bytes, and two instances do not disturb each other")
def determinism(subject: DeviceSubject) -> None:
    """Run one alone, then two side by side."""
    alone = subject.bench(seed=5)
    alone.step(400)
    one, two = subject.bench(seed=5), subject.bench(seed=6)
    for _ in range(400):
        one.step()
        two.step(2)
    if one.state.tobytes() != alone.state.tobytes() or one.reading.tobytes() != alone.reading.tobytes():
        raise _fail(
            "a second run, beside another instance, gives other bytes",
            "a shared global, the clock, or random numbers that the seed does not decide",
            "keep everything in State, and draw from the rng that reset() gets",
        )


@check("keeps-nothing", "records are not kept")
def keeps_nothing(subject: DeviceSubject) -> None:
    """Give new records each tick, and look whether anybody still holds them."""
    bench = subject.bench()
    bench.step(3)
    reading, command = bench.reading.copy(), bench.command.copy()
    bench.twin.step(bench.state, command, bench.touch, PERIOD)
    bench.twin.read(bench.state, reading)
    _held_by(bench.twin, reading, "reading")
    _held_by(bench.twin, command, "command")


def _held_by(plugin: Any, record: Record, what: str) -> None:
    gc.collect()
    ours = {id(view) for view in record.values()}
    for value in _reach(plugin):
        shares = isinstance(value, np.ndarray) and value.size and np.shares_memory(value, record.raw)
        if value is record or id(value) in ours or shares:
            raise _fail(
                f"the {what} is kept after the call",
                f"an attribute holds the {what} record or a view of it",
                "copy the numbers you need: float(x), np.array(x)",
            )


def _reach(thing: Any, depth: int = 3) -> list[Any]:
    found: list[Any] = []
    if depth == 0:
        return found
    inner = (
        list(getattr(thing, "__dict__", {}).values())
        if not isinstance(thing, (dict, list, tuple))
        else (list(thing.values()) if isinstance(thing, dict) else list(thing))
    )
    for value in inner:
        found.append(value)
        holds = isinstance(value, (dict, list, tuple)) or hasattr(value, "__dict__")
        if holds and not isinstance(value, type) and not callable(value):
            found += _reach(value, depth - 1)
    return found


@check("allocates-nothing", "no memory is gathered from tick to tick")
def allocates_nothing(subject: DeviceSubject) -> str:
    """Compare what is allocated before and after two thousand ticks."""
    bench = subject.bench()
    bench.step(500)
    gc.collect()
    tracemalloc.start()
    try:
        bench.step(200)
        gc.collect()
        before, _ = tracemalloc.get_traced_memory()
        bench.step(2000)
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    grown = after - before
    if grown > 24_000:
        raise _fail(
            f"memory grows by {grown / 2000:.0f} bytes a tick",
            "a list that is appended to, or a log",
            "keep what must be kept in State, which has a fixed size",
        )
    return f"{grown / 2000:.1f} bytes a tick"


@check("twin-timing", "a step of the twin fits in the tick")
def timing(subject: DeviceSubject) -> str:
    """Time the step and the read; the figure is reported, a twin that waits is refused."""
    bench = subject.bench()
    bench.step(300)
    spent = []
    for _ in range(300):
        begin = time.perf_counter()
        bench.step(driven=False)
        spent.append(time.perf_counter() - begin)
    median, worst = statistics.median(spent), sorted(spent)[int(0.99 * len(spent))]
    if median > 0.5 * PERIOD:
        raise _fail(
            f"a step takes {1e3 * median:.2f} ms, the tick has {1e3 * PERIOD:g} ms",
            "it waits (sleep, a socket), or computes too much",
            "never wait in a twin; delays are State; compile heavy arithmetic",
        )
    return f"p50 {1e6 * median:.0f} us, p99 {1e6 * worst:.0f} us"


@check("twin-limits", "the twin survives every command that its channels allow")
def bounded(subject: DeviceSubject) -> None:
    """Drive to the limits of every command; readings stay finite afterwards."""
    bench = subject.bench()
    if not bench.commands:
        raise NotApplicableError("it obeys no command")
    for channel in bench.commands:
        if channel.name == "pose_target":
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
