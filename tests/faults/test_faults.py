"""Fault injection: each kind does what it says, on twins only, and the same again with the same seed."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.faults import FaultyTwin, Injection, Kind
from itouch.faults.kinds import AMOUNTS, UNITS
from itouch.plugin import (
    Bound,
    Device,
    DeviceError,
    Field,
    IdealTwin,
    Record,
    Role,
    TwinInputs,
    current,
    plate_temperature,
    pose,
    pose_target,
    temperature,
    wrench,
)
from itouch.scene.elements import FAULTS
from itouch.schema.units import parse_unit

Write = Callable[[str, str], Path]
FIRST = SCENES / "first_touch.xml"


class Steady(IdealTwin):
    """A twin that reads what it was last sent, and counts."""

    def __init__(self, reads: Any, commands: Any) -> None:
        device = type("Bare", (Device,), {"reads": reads, "commands": commands})
        super().__init__(None, device)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        super().step(state, command, touch, period)
        self.sent = {name: view.tolist() for name, view in command.items()}

    def position(self, state: Record) -> Any:
        return state["pose"][:3] if "pose" in state else None


TABLE = ((pose(),), (pose_target(low=(-1, -1, 0), high=(1, 1, 0.1), speed=0.3),))
PLATE = ((plate_temperature(),), (current(limit=5.0),))
ARM = ((pose(),), (wrench(force=8.0),))


class Bent:
    """A faulty twin with its State, read and stepped as in a tick."""

    def __init__(self, channels: Any, kind: Kind, *, begin: int = 2, end: int = 1000, channel: str = "",
                 amount: float = math.nan) -> None:  # fmt: skip
        reads, commands = channels
        self.inner = Steady(reads, commands)
        plan = [Injection(kind, begin, end, channel, amount)]
        self.twin = FaultyTwin(self.inner, reads, commands, plan, period=1e-3, watchdog=0.005)
        self.state = Record.of(self.twin.fields())
        self.twin.reset(self.state, np.random.default_rng(1))
        self.reading = Record.of([Field.of(c) for c in reads])
        self.command = Record.of([Field.of(c) for c in commands])

    def tick(self, command: Any = None) -> bool | None:
        new = self.twin.read(self.state, self.reading)
        if command is not None:
            next(iter(self.command.values()))[:] = command
        self.twin.step(self.state, self.command, TwinInputs(), 1e-3)
        return new


def test_scenes_and_program_know_the_same_kinds() -> None:
    assert set(FAULTS) == {kind.label for kind in Kind if kind is not Kind.NONE}
    assert len(FAULTS) == 12
    assert Kind.of("wrong-units") is Kind.WRONG_UNITS
    for unknown in ("none", "nan ", "NAN"):
        with pytest.raises(ValueError, match="is not one of disconnect"):
            Kind.of(unknown)


def test_a_disconnected_device_makes_itself_safe() -> None:
    bent = Bent(PLATE, Kind.DISCONNECT, end=20)
    bent.tick(2.0)
    bent.tick(2.0)
    sent = []
    for _ in range(10):
        with pytest.raises(DeviceError, match="disconnected"):
            bent.twin.read(bent.state, bent.reading)
        bent.command["current"][0] = 4.0
        bent.twin.step(bent.state, bent.command, TwinInputs(), 1e-3)
        sent.append(bent.inner.sent["current"][0])
    assert sent == [2.0] * 5 + [0.0] * 5
    table = Bent(TABLE, Kind.DISCONNECT)
    for _ in range(2):
        table.tick((0, 0, 0.05, 1, 0, 0, 0))
    for _ in range(8):
        table.twin.step(table.state, table.command, TwinInputs(), 1e-3)
    assert table.inner.sent["pose_target"][2] == pytest.approx(0.05 - 3 * 0.25e-3)


def test_frozen_and_late_readings() -> None:
    bent = Bent(TABLE, Kind.FREEZE, end=6)
    seen = []
    for n in range(8):
        bent.tick((0.001 * n, 0, 0, 1, 0, 0, 0))
        seen.append(bent.reading["pose"][0])
    assert seen == pytest.approx([0, 0, 0.001, 0.001, 0.001, 0.001, 0.005, 0.006])
    late = Bent(TABLE, Kind.DELAY)
    seen = []
    for n in range(30):
        late.tick((0.001 * n, 0, 0, 1, 0, 0, 0))
        seen.append(late.reading["pose"][0])
    assert seen[:2] == [0.0, 0.0]
    assert seen[25] == pytest.approx(0.001 * (25 - 1 - 20))  # ten readings late, of commands that are ten late


@pytest.mark.parametrize(
    ("kind", "channels", "expected"),
    [
        (Kind.BIAS, PLATE, 305.0), (Kind.WRONG_UNITS, PLATE, 26.85), (Kind.BIAS, TABLE, 0.105),
        (Kind.WRONG_UNITS, TABLE, 100.0),
    ],
)  # fmt: skip
def test_shifted_and_mistaken_readings(kind: Kind, channels: Any, expected: float) -> None:
    bent = Bent(channels, kind)
    first = next(iter(bent.reading))
    for _ in range(4):
        bent.state[first][0] = 300.0 if first.endswith("temperature") else 0.1
        bent.twin.read(bent.state, bent.reading)
        bent.state["fault.tick"] = bent.state["fault.tick"].item() + 1
    assert bent.reading[first][0] == pytest.approx(expected)
    if first == "pose":
        assert bent.reading["pose"][3:].tolist() == [1.0, 0.0, 0.0, 0.0]  # no quaternion has a unit


@pytest.mark.parametrize(("unit", "wrong"), [("m", "mm"), ("N", "mN"), ("W/m^2", "kW/m^2"), ("m/s", "mm/s")])
def test_a_wrong_unit_is_one_that_somebody_may_take_for_the_right_one(unit: str, wrong: str) -> None:
    assert UNITS[unit] == (pytest.approx(parse_unit(unit).factor / parse_unit(wrong).factor), 0.0)


def test_drift_grows_and_spikes_are_rare() -> None:
    drift = Bent(PLATE, Kind.DRIFT, begin=0, channel="plate_temperature", amount=2.0)
    for _ in range(501):
        drift.tick(0.0)
    assert drift.reading["plate_temperature"].item() == pytest.approx(296.15 + 1.0)
    spikes = Bent(PLATE, Kind.SPIKE, begin=0)
    seen = []
    for _ in range(1000):
        spikes.tick(0.0)
        seen.append(spikes.reading["plate_temperature"].item() - 296.15)
    assert sorted({round(value) for value in seen}) == [-30, 0, 30]
    assert 25 < sum(value != 0.0 for value in seen) < 80


def test_nan_and_garbage_replace_readings() -> None:
    bent = Bent(TABLE, Kind.NAN)
    for _ in range(3):
        bent.tick()
    assert np.all(np.isnan(bent.reading["pose"]))
    garbage = Bent(TABLE, Kind.GARBAGE)
    seen = set()
    for _ in range(10):
        garbage.tick()
        seen.add(garbage.reading["pose"].tobytes())
    assert len(seen) == 10


def test_a_fifth_of_readings_and_commands_is_dropped() -> None:
    bent = Bent(PLATE, Kind.DROP, begin=0, end=10**6)
    missed, stale = 0, 0
    for n in range(1, 1001):
        missed += bent.tick(0.001 * n) is False
        stale += bent.inner.sent["current"][0] != pytest.approx(0.001 * n, abs=1e-9)
    assert 150 < missed < 250
    assert 150 < stale < 250


def test_reversed_signs() -> None:
    arm = Bent(ARM, Kind.REVERSED_SIGN)
    for _ in range(3):
        arm.tick((1.0, -2.0, 3.0, 0, 0, 0))
    assert arm.inner.sent["wrench"] == [-1.0, 2.0, -3.0, 0, 0, 0]
    table = Bent(TABLE, Kind.REVERSED_SIGN)
    for height in (0.05, 0.05, 0.05, 0.06, 0.01, -0.5):
        table.tick((0, 0, height, 1, 0, 0, 0))
        seen = table.inner.sent["pose_target"][2]
    assert seen == 0.1  # the end of its travel
    sensor = Bent(PLATE, Kind.REVERSED_SIGN, channel="plate_temperature")
    for temperature_now in (300.0, 300.0, 300.0, 301.0):
        sensor.state["plate_temperature"][0] = temperature_now
        sensor.tick(1.0)
    assert sensor.reading["plate_temperature"].item() == 299.0
    assert sensor.inner.sent["current"] == [1.0]


def test_saturated_actuators() -> None:
    arm = Bent(ARM, Kind.SATURATED)
    for _ in range(3):
        arm.tick((0.3, 0.4, 0, 0, 0, 0))
    assert arm.inner.sent["wrench"] == pytest.approx([4.8, 6.4, 0, 0, 0, 0])
    arm.tick((0, 0, 0, 0, 0, 0))
    assert arm.inner.sent["wrench"] == [0.0] * 6
    plate = Bent(PLATE, Kind.SATURATED)
    for wanted in (0.1, 0.1, -0.1):
        plate.tick(wanted)
    assert plate.inner.sent["current"] == [-5.0]
    table = Bent(TABLE, Kind.SATURATED)
    for _ in range(2):
        table.tick((0, 0, 0.05, 1, 0, 0, 0))
    table.tick((0.001, 0.0001, 0.04, 1, 0, 0, 0))
    assert table.inner.sent["pose_target"][:3] == pytest.approx([1.0, 0.0001, 0.0])


def test_a_fault_may_affect_one_channel_alone() -> None:
    bent = Bent(
        ((temperature("a", Role.OTHER_TEMPERATURE), temperature("b", Role.OTHER_TEMPERATURE)), (current(limit=5.0),)),
        Kind.NAN,
        channel="b",
    )
    for _ in range(3):
        bent.tick(1.0)
    assert bent.reading["a"].item() == 296.15
    assert math.isnan(bent.reading["b"].item())
    command = Bent(
        ((temperature("a", Role.OTHER_TEMPERATURE),), (current(limit=5.0),)), Kind.REVERSED_SIGN, channel="current"
    )
    for _ in range(3):
        command.tick(1.0)
    assert command.inner.sent["current"] == [-1.0]
    with pytest.raises(ValueError, match="channel = 'c' is not one of a, current"):
        command.twin.write_plan(command.state, 0, Injection(Kind.NAN, 0, channel="c"))


def test_a_fault_ends() -> None:
    bent = Bent(PLATE, Kind.NAN, begin=1, end=3)
    seen = []
    for _ in range(5):
        bent.tick(0.0)
        seen.append(math.isnan(bent.reading["plate_temperature"].item()))
    assert seen == [False, True, True, False, False]


class Seldom(Steady):
    """A twin whose readings come over a wire: a new one in every third tick."""

    calls = -1

    def read(self, state: Record, reading: Record) -> bool | None:
        self.calls += 1
        return super().read(state, reading) if self.calls % 3 == 0 else False


@pytest.mark.parametrize("kind", [k for k in Kind if k not in (Kind.NONE, Kind.DISCONNECT)], ids=lambda k: k.label)
def test_a_reading_that_has_not_come_is_not_falsified(kind: Kind) -> None:
    bent = Bent(PLATE, kind, begin=4)
    bent.inner.__class__ = Seldom
    before = bent.reading.tobytes()
    for _ in range(60):
        new = bent.tick(1.0)
        assert bent.reading.tobytes() == before or new is not False
        before = bent.reading.tobytes()


def test_late_readings_over_a_wire_are_ten_of_them_late() -> None:
    late = Bent(TABLE, Kind.DELAY, channel="pose")
    late.inner.__class__ = Seldom
    seen = []
    for n in range(90):
        late.tick((0.001 * n, 0, 0, 1, 0, 0, 0))
        seen.append(late.reading["pose"][0])
    assert seen[87] == pytest.approx(0.001 * (87 - 1 - 3 * 10 - 10))  # of commands that are ten late


def faulty(write: Write, *faults: str) -> Path:
    text = FIRST.read_text(encoding="utf-8").replace("</itouch>", "\n".join(["", *faults, "</itouch>"]))
    return write("s.xml", text)


def test_a_scene_injects_and_the_report_tells_cause_and_line(write: Write) -> None:
    path = faulty(write, '<fault device="arm" kind="nan" at="1 s" for="0.2 s"/>')
    engine = itouch.build(path)
    with pytest.raises(itouch.DeviceFaultError, match=r"device 'arm' reads NaN \(pose\) \(T8 .*\) at tick 1000"):
        engine.run()
    line = (
        path.read_text(encoding="utf-8").splitlines().index('<fault device="arm" kind="nan" at="1 s" for="0.2 s"/>') + 1
    )
    tripped, injected = sorted(engine.report()["faults"], key=lambda entry: entry["trip"] is None)
    assert tripped["trip"] == "not-a-number"
    assert tripped["injected"] == [{"device": "arm", "kind": "nan", "scene": f"{path}:{line}:1"}]
    assert tripped["safe"]["reached"] is True
    assert (injected["trip"], injected["kind"], injected["time_s"], injected["until_s"]) == (None, "nan", 1.0, 1.2)
    assert injected["scene"] == f"{path}:{line}:1"
    assert "nan" in injected["cause"]


def test_a_fault_that_has_not_begun_is_not_told(write: Write) -> None:
    engine = itouch.build(faulty(write, '<fault device="arm" kind="nan" at="1 s"/>'))
    engine.run(0.5)
    assert engine.report()["faults"] == []


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ('<fault device="arm" kind="nonsense" at="1 s"/>', "bad-value"),
        ('<fault device="leg" kind="nan" at="1 s"/>', "unknown-name"),
        ('<fault device="arm" kind="nan"/>', "missing-attribute"),
        ('<fault device="arm" kind="nan" at="-1 s"/>', "out-of-range"),
        ('<fault device="arm" kind="nan" at="1 s" for="0 s"/>', "out-of-range"),
        ('<fault device="arm" kind="nan" at="nan"/>', "bad-value"),
        ('<fault device="arm" kind="bias" at="1 s" channel="poses"/>', "missing-channel"),
        ('<fault device="arm" kind="bias" at="1 s" amount="3 mm"/>', "requires"),
        ('<fault device="arm" kind="bias" at="1 s" channel="pose" amount="3 kg"/>', "bad-value"),
        ('<fault device="arm" kind="nan" at="1 s" wen="3"/>', "unknown-attribute"),
        ('<fault device="arm" kind="freeze" at="1 s" channel="pose" amount="5 mm"/>', "bad-value"),
    ],
)
def test_what_is_wrong_with_a_fault_has_a_place(write: Write, fault: str, code: str) -> None:
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(faulty(write, fault))
    assert [problem.code for problem in caught.value.problems] == [code]
    assert caught.value.problems[0].place is not None


def test_a_fault_on_hardware_is_a_problem_with_its_place(write: Write) -> None:
    path = faulty(write, '<fault device="arm" kind="nan" at="1 s"/>')
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(path, twin="none")
    (problem,) = [problem for problem in caught.value.problems if problem.code == "fault-on-hardware"]
    assert problem.place is not None
    assert 'device="arm"' in problem.place.text
    assert "--twin all" in problem.advice


def test_amounts_are_in_the_units_of_their_channel(write: Write) -> None:
    path = faulty(write, '<fault device="arm" kind="bias" at="0.3 s" channel="pose" amount="1 mm"/>')
    plain, shifted = itouch.build(FIRST), itouch.build(path)
    for engine in (plain, shifted):
        engine.run(0.4)
    assert shifted.state["arm.pose"][0] - plain.state["arm.pose"][0] == pytest.approx(0.001)


def test_injected_faults_are_the_same_again_and_survive_restoring(write: Write, tmp_path: Path) -> None:
    path = faulty(
        write, '<fault device="arm" kind="drop" at="0.2 s" for="1 s"/>', '<fault device="arm" kind="delay" at="0.9 s"/>'
    )
    straight = itouch.build(path, seed=3)
    straight.run(1.5)
    broken = itouch.build(path, seed=3)
    broken.run(0.7)
    broken.save(tmp_path / "s.itouch")
    again = itouch.restore(tmp_path / "s.itouch")
    again.run(1.5 - again.seconds)
    assert again.state.tobytes() == straight.state.tobytes()


def test_faults_from_python(write: Write) -> None:
    engine = itouch.build(faulty(write, '<fault device="arm" kind="nan" at="100 s"/>'))
    engine.run(0.3)
    plain = itouch.build(FIRST)
    plain.run(0.3)
    engine.inject("arm", "bias", duration=0.1, channel="pose", amount=0.001)
    for shift in (0.001, 0.0):
        for one in (engine, plain):
            one.run(0.05 if shift else 0.1)
        assert engine.state["arm.pose"][0] - plain.state["arm.pose"][0] == pytest.approx(shift, abs=1e-4)
    assert [entry["kind"] for entry in engine.report()["faults"]] == ["bias"]
    for wrong in ({"device": "arm", "kind": "x"}, {"device": "arm", "kind": "nan", "slot": 1},
                  {"device": "arm", "kind": "nan", "channel": "x"}):  # fmt: skip
        with pytest.raises(ValueError, match="is not one of|no slot"):
            engine.inject(**wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="kind 'freeze' has no amount: of bias, drift, spike only"):
        engine.inject("arm", "freeze", channel="pose", amount=0.005)
    for never in (-4.0, math.nan, math.inf, 1e300):
        for when in ("at", "duration"):
            with pytest.raises(ValueError, match=f"{when} = .* must be a finite number, at least 0 s"):
                engine.inject("arm", "nan", **{when: never})  # type: ignore[arg-type]
    with pytest.raises(DeviceError, match="there is no device named 'leg'"):
        engine.inject("leg", "nan")
    with pytest.raises(ValueError, match="no slot"):
        itouch.build(FIRST).inject("arm", "nan")


def test_a_fault_from_python_lasts_a_tick_at_least(write: Write) -> None:
    engine = itouch.build(faulty(write, '<fault device="arm" kind="nan" at="100 s"/>'))
    engine.run(0.1)
    engine.inject("arm", "bias", at=engine.seconds + 0.005, duration=1e-6, channel="pose", amount=0.001)
    heights: list[float] = []
    engine.run(0.02, each=lambda: heights.append(float(engine.state["arm.pose"][0])))
    assert sum(abs(step) > 5e-4 for step in np.diff(heights)) == 2
    shown = [n for n, step in enumerate(np.diff(heights)) if abs(step) > 5e-4]
    assert shown[1] - shown[0] == 1


class Compiled(Steady):
    """A twin of calls that are bound once; every third leaves its tick to Python."""

    def __init__(self, reads: Any, commands: Any) -> None:
        super().__init__(reads, commands)
        self.bound: list[str] = []
        self.calls = self.python = 0

    def _call(self, what: str, records: tuple[Record, ...]) -> Bound:
        def call() -> int:
            self.calls += 1
            if self.calls % 3 == 0:
                return 1
            if what == "read":
                state, reading = records
                reading["pose"] = state["pose"]
            else:
                state, command = records
                state["pose"][:3] = command["pose_target"][:3]
            return 0

        self.bound.append(what)
        return Bound(call)

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound:
        return self._call("step", (state, command))

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        self.python += 1
        state["pose"][:3] = command["pose_target"][:3]

    def bound_read(self, state: Record, reading: Record) -> Bound:
        return self._call("read", (state, reading))

    def read(self, state: Record, reading: Record) -> bool:
        self.python += 1
        reading["pose"] = state["pose"]
        return True


def test_a_twin_of_compiled_calls_is_bound_once_for_what_it_works_on() -> None:
    reads, commands = TABLE
    inner, touch = Compiled(reads, commands), TwinInputs()
    twin = FaultyTwin(inner, reads, commands, [Injection(Kind.FREEZE, 1000)], period=1e-3, watchdog=0.005)
    command = Record.of([Field.of(channel) for channel in commands])
    for _ in range(2):  # each time with another State, and another reading
        state, reading = Record.of(twin.fields()), Record.of([Field.of(channel) for channel in reads])
        twin.reset(state, np.random.default_rng(1))
        for tick in range(12):
            command["pose_target"][:3] = (0.01 * tick, 0.0, 0.0)
            twin.step(state, command, touch, 1e-3)
            assert twin.read(state, reading)
            assert reading["pose"][:3].tolist() == command["pose_target"][:3].tolist()
    assert sorted(inner.bound) == ["read", "read", "step", "step"]
    assert (inner.calls, inner.python) == (48, 16)


def test_the_page_says_how_large_a_fault_is_that_has_no_size_of_its_own() -> None:
    """`docs/how-to/inject-faults.md`, a row for each kind; speeds are those of readings that few devices have."""
    page = (SCENES.parent / "docs" / "how-to" / "inject-faults.md").read_text(encoding="utf-8")
    length, force, kelvin, flux = (AMOUNTS[unit] for unit in ("m", "N", "K", "W/m^2"))
    for column, (kind, per) in enumerate((("bias", ""), ("drift", "/s"), ("spike", ""))):
        (row,) = (line for line in page.splitlines() if line.startswith(f"| `{kind}` |"))
        said = row.split("|")[3].strip().split(", ")
        assert said[:3] == [
            f"{1e3 * length[column]:g} mm{per}", f"{force[column]:g} N{per}", f"{kelvin[column]:g} K{per}"
        ]  # fmt: skip
        assert said[3] == f"{1e-3 * flux[column]:g} kW/m²{' a second' if per else ''}"
