"""What joins a tick of a device's supervision does what its Python does: the same bytes from the same State."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import ClassVar

import numpy as np
import pytest
from small_devices import ARM, PERIOD, PLATE, TABLE, Channels, Fake, FakeTwin, Slow, Supervised, model, state

from itouch.compiling import kernel
from itouch.joining import SKIP
from itouch.monitors import DeviceFaultError, Surface
from itouch.plugin import (
    Bound,
    Moment,
    Monitor,
    Record,
    Watched,
    current,
    plate_temperature,
    temperature_target,
    wrench,
)
from itouch.plugin.timestamps import Timestamped
from itouch.safety import Finger
from itouch.safety.monitor_step import LOOK, TOLD
from itouch.world.rig import DeviceModel

#: A heater that is held at a temperature, and a force that may turn: every kind of channel.
HOLDER: Channels = ((plate_temperature(),), (temperature_target(),))
TURNING: Channels = (ARM[0], (wrench(force=8.0, torque=0.5, locked=()),))


@kernel
def _copy(source: np.ndarray, target: np.ndarray) -> int:
    if source[0] == 99.0:
        return 1  # nothing new
    for i in range(target.shape[0]):
        target[i] = source[1 + i]
    return 0


class Bench:
    """Two supervisors of twins that read the same; one is run by its Python, one by what joins."""

    def __init__(self, channels: Channels, cls: type[Fake] = Fake, offered: Sequence[type[Monitor]] = ()) -> None:
        self.source = np.zeros(40)
        self.one, self.other = (self._make(channels, cls, offered) for _ in range(2))

    def _make(
        self, channels: Channels, cls: type[Fake], offered: Sequence[type[Monitor]]
    ) -> tuple[DeviceModel, Record, Supervised]:
        made = model(channels, twin=True, cls=cls, offered=offered)
        memory, twin = state(made), Reading(self.source)
        found = Supervised(made, memory, PERIOD, twin=twin)
        found.lifecycle.reset()
        found.lifecycle.open()
        return made, memory, found

    def say(self, numbers: Sequence[float]) -> None:
        """Let both read these numbers next."""
        self.source[0] = 0.0
        self.source[1 : 1 + len(numbers)] = numbers

    def both(self, act: Callable[[Supervised], None]) -> None:
        """Do something with both."""
        for _, _, one in (self.one, self.other):
            act(one)

    def tick(self, tick: int) -> str:
        """Run a tick of both; return what fault it was, and check that both have become the same."""
        for _, memory, _ in (self.one, self.other):
            memory["tick"] = tick
        said = [
            _told(lambda: (self.one[2].gate.read(tick), self.one[2].gate.actuation.guard(tick))),
            _told(lambda: _joined(self.other[2], tick)),
        ]
        assert said[0] == said[1]
        for name, view in self.one[1].items():
            assert view.tobytes() == self.other[1][name].tobytes(), (name, view, self.other[1][name])
        assert self.one[2].gate.device_monitors.share == self.other[2].gate.device_monitors.share
        assert self.one[2].gate.device_monitors.seen == self.other[2].gate.device_monitors.seen
        return said[0]


class Reading(FakeTwin):
    """A twin that reads an array behind its first number; 99 there: nothing new."""

    def __init__(self, source: np.ndarray) -> None:
        super().__init__()
        self.source = source

    def bound_read(self, state: Record, reading: Record) -> Bound:
        return Bound(_copy, self.source, reading.numbers)

    def read(self, state: Record, reading: Record) -> bool | None:
        return not self.bound_read(state, reading)()


def _told(act: Callable[[], object]) -> str:
    try:
        act()
    except DeviceFaultError as error:
        return str(error)
    return ""


def _run(bounds: Sequence[Bound], answer: Callable[[int], None]) -> None:
    for bound in bounds:
        code = bound()
        if code == SKIP:
            return
        if code:
            answer(code)
            return


def _answer(supervisor: Supervised, code: int, tick: int) -> None:
    if code >= TOLD:
        supervisor.gate.acquisition.told(code - TOLD, tick)
    elif code == LOOK:
        supervisor.gate.acquisition.look(tick)
    else:
        supervisor.gate.acquisition.watch(tick)


def _joined(supervisor: Supervised, tick: int) -> None:
    take, watch, guard = (
        supervisor.gate.acquisition.bound_take(),
        supervisor.gate.acquisition.bound_watch(),
        supervisor.gate.actuation.bound_guard(),
    )
    assert take
    assert watch
    assert guard
    _run(take, lambda code: supervisor.gate.acquisition.take(tick))
    _run(watch, lambda code: _answer(supervisor, code, tick))
    _run(guard, lambda code: supervisor.gate.actuation.guard(tick))


def _numbers(channels: Channels, rng: np.random.Generator) -> list[float]:
    """Return what such a device may read: near the last reading most of the time."""
    found: list[float] = []
    for channel in channels[0]:
        rest, most = {"K": (300.0, 8.0), "m": (0.02, 0.3)}.get(channel.unit, (0.0, 0.3))
        wild = most if rng.random() < 0.1 else 0.0
        found += (rest + rng.normal(0.0, 1e-4 + wild, channel.size)).tolist()
        if channel.size == 7:
            found[-4:] = [1.0, 0.0, 0.0, 0.0]
    return found


@pytest.mark.parametrize("cls", [Fake, Slow])
@pytest.mark.parametrize(
    "channels", [ARM, TABLE, PLATE, HOLDER, TURNING], ids=["arm", "table", "plate", "holder", "turning"]
)
def test_a_device_goes_the_same_way_joined(channels: Channels, cls: type[Fake]) -> None:
    rng = np.random.default_rng(3)
    bench, faults = Bench(channels, cls), 0
    bench.say(_numbers(channels, rng))
    bench.both(lambda one: one.lifecycle.enable())
    for tick in range(400):
        if rng.random() < 0.1:
            bench.source[0] = 99.0
        else:
            bench.say(_numbers(channels, rng))
        wanted = np.concatenate([rng.normal(0.0, 3.0, channel.size) for channel in channels[1]])
        if tick % 97 == 96:
            wanted[0] = math.nan
        bench.both(lambda one: one.command.numbers.__setitem__(slice(None), wanted))  # noqa: B023
        bench.both(lambda one: setattr(one.gate.actuation, "closing", 0.05))
        if tick % 31 == 30:
            bench.both(lambda one: one.gate.device_monitors.leave_out(3))
        if bench.tick(tick):
            faults += 1
            bench.both(lambda one: one.gate.fault(one.latch.trip, tick))  # noqa: B023
            bench.tick(tick)  # a reading that only tells how a stopped device is
            bench.both(lambda one: one.lifecycle.close())
            bench.tick(tick)  # nothing is taken of a closed one
            bench.both(lambda one: one.latch._trip.__setitem__(..., 0))
            bench.both(lambda one: one.lifecycle.open())
            bench.tick(tick)  # open, not enabled
            bench.both(lambda one: one.lifecycle.enable())
            bench.both(lambda one: one.gate.actuation.ramp_in())
    assert faults


def test_a_twin_behind_a_wire_or_in_python_is_read_by_python() -> None:
    made = model(ARM, twin=True)

    class Late(Reading, Timestamped):
        pass

    class Plain(Reading):
        def read(self, state: Record, reading: Record) -> bool | None:
            return True

    class Unsure(Reading):
        def bound_read(self, state: Record, reading: Record) -> Bound | None:  # type: ignore[override]
            return None

    for twin in (Late(np.zeros(40)), Plain(np.zeros(40)), Unsure(np.zeros(40)), FakeTwin(), None):
        assert Supervised(made, state(made), PERIOD, twin=twin).gate.acquisition.bound_take() == ()


def test_a_device_that_reads_nothing_is_watched_by_python() -> None:
    made = model(((), (current(limit=1.0),)), twin=True)
    assert Supervised(made, state(made), PERIOD, twin=FakeTwin()).gate.acquisition.bound_watch() == ()


def test_an_arm_that_shares_a_finger_with_others_is_limited_by_python() -> None:
    made = model(ARM, twin=True)
    supervisor = Supervised(made, state(made), PERIOD, twin=FakeTwin())
    assert supervisor.gate.actuation.bound_guard()
    supervisor.gate.actuation.leave_room = lambda: None
    assert supervisor.gate.actuation.bound_guard() == ()


def test_a_state_of_odd_bytes_is_watched_by_python() -> None:
    made = model(PLATE, twin=True)
    whole = state(made)
    odd = Record(np.dtype([("odd", "u1"), *whole.dtype.descr]))
    assert Supervised(made, whole, PERIOD, twin=FakeTwin()).gate.acquisition.bound_watch()
    assert Supervised(made, odd, PERIOD, twin=FakeTwin()).gate.acquisition.bound_watch() == ()


def test_what_is_looked_at_together_is_simple_with_one_surface() -> None:
    models = [
        model(channels, name=name, twin=True) for name, channels in (("arm", ARM), ("one", TABLE), ("two", TABLE))
    ]
    memory = state(*models)
    arm, one, two = (Supervised(made, memory, PERIOD, twin=FakeTwin()) for made in models)
    assert Finger("finger", [arm.gate, one.gate]).simple
    assert not Finger("finger", [arm.gate, one.gate, two.gate]).simple
    assert not Finger("finger", [arm.gate]).simple
    post = one.gate.device_monitors.surface
    assert post is not None and isinstance(post.monitor, Surface)
    assert post.monitor.allowed[:3] == (5.0, 10.0, 60.0)


def test_a_twin_that_is_replaced_in_a_run_is_read_by_python() -> None:
    bench = Bench(ARM)
    bench.say([0.1] * 3 + [0.5] * 4)
    bench.tick(0)
    bench.both(lambda one: setattr(one.gate, "twin", Reading(np.array([0.0] + [0.2] * 3 + [-0.5] * 4 + [0.0] * 32))))
    bench.tick(1)
    assert bench.one[2].reading["pose"].tolist() == [0.2] * 3 + [-0.5] * 4


@pytest.mark.parametrize("channels", [ARM, TABLE, PLATE], ids=["arm", "table", "plate"])
def test_a_quiet_tick_leaves_nothing_to_python(channels: Channels) -> None:
    """Nor do the turns of the monitors of plates, every ten milliseconds, in which a sensor changes by next to nothing."""
    bench = Bench(channels)
    bench.say(_numbers(channels, np.random.default_rng(1)))
    bench.both(lambda one: one.lifecycle.enable())
    bench.tick(0)
    joined, memory = bench.other[2], bench.other[1]
    looks = 0
    for tick in range(1, 101):
        memory["tick"] = tick
        if channels is PLATE:
            bench.source[1] += 1e-4
            looks += int(memory["it.heat.checked"]) == tick - 1
        for bound in (
            *joined.gate.acquisition.bound_take(),
            *joined.gate.acquisition.bound_watch(),
            *joined.gate.actuation.bound_guard(),
        ):
            assert bound() in (0, SKIP)
    assert looks == (10 if channels is PLATE else 0)  # what is placed is looked at where the finger is


@pytest.mark.parametrize("channels", [ARM, TABLE, PLATE], ids=["arm", "table", "plate"])
def test_a_share_that_a_reading_had_is_given_back_by_the_next_that_is_believed(channels: Channels) -> None:
    bench = Bench(channels)
    bench.say(_numbers(channels, np.random.default_rng(1)))
    bench.both(lambda one: one.lifecycle.enable())
    bench.tick(0)
    for _, memory, _ in (bench.one, bench.other):
        memory["it.readings.share"] = 0.5
    bench.tick(1)
    assert bench.other[1]["it.readings.share"] == 1.0


def test_what_was_bound_before_a_twin_was_replaced_leaves_every_reading_to_python() -> None:
    """As a plan does, which binds once."""
    bench = Bench(PLATE)
    bench.say(_numbers(PLATE, np.random.default_rng(1)))
    bench.tick(0)
    joined, memory = bench.other[2], bench.other[1]
    due, *_ = joined.gate.acquisition.bound_take()
    memory["tick"] = 1
    assert due() == 0
    joined.gate.twin = Reading(bench.source)
    assert due() == 1


class TooWarm(Monitor):
    """A stranger's monitor, on the clock: it trips on a plate of more than 305 K."""

    name = "too-warm"
    trips: ClassVar[dict[int, str]] = {1: "the warmth"}

    @classmethod
    def of(cls, device: Watched) -> Iterator[Monitor]:
        yield cls(device)

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        return -1.0 if reading["plate_temperature"].item() > 305.0 else 1.0


def test_a_stranger_s_monitor_is_asked_by_python_and_trips_as_it_does_there() -> None:
    bench, said = Bench(PLATE, offered=[TooWarm]), ""
    for tick in range(1, 400):
        bench.say([300.0 + 0.02 * tick, 300.0, 0.0])
        said = said or bench.tick(tick)
        if said:
            break
    assert "stopped by the warmth" in said
    assert 250 <= tick <= 261  # the clock looks each 10 ms


def test_the_goal_that_a_wire_is_known_to_have_taken_is_the_newest() -> None:
    made = model(TABLE, name="it")
    memory = state(made, wire=True)
    supervisor = Supervised(made, memory, PERIOD)
    assert supervisor.gate.acquisition.departures.newest is None  # none yet
    for count in range(1, 20):
        memory["it.gone"].reshape(-1, 4)[(count - 1) % 8] = (count, 0.0, 0.0, 0.001 * count)
        memory["it.goings"] = count
        assert supervisor.gate.acquisition.departures.newest == 0.001 * count
    assert Supervised(made, state(made), PERIOD).gate.acquisition.departures.newest is None  # no wire
