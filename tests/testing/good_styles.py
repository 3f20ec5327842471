"""Good plugins that are written unlike the others; no check may blame them."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import deque
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from slider import Slider, SliderParams, SliderTwin

from itouch.plugin import (
    Channel,
    Device,
    DeviceError,
    Field,
    IdealTwin,
    Record,
    Role,
    Twin,
    current,
    pose,
    schema,
    temperature,
    twist,
    wrench,
)

#: Every one of them.
GOOD: list[type[Device]] = []


def good(cls: type[Device]) -> type[Device]:
    cls.__doc__ = cls.__doc__ or "A slider of another style."
    GOOD.append(cls)
    return cls


@dataclass(frozen=True)
class NoParams:
    """Nothing to say."""


@good
class OnlyReads(Slider):
    """A tracker without any command."""

    Params = NoParams
    commands = ()
    Twin = SliderTwin
    Emulator = None

    def open(self) -> None:
        self._line = -1
        self._rest, self._place = b"", (0.0, 0.0, 0.0)


@good
class HasNoTwin(Slider):
    Twin = None


@good
class BuffersTwinDevice(Slider):
    class Twin(SliderTwin):
        """Works in arrays that it makes once, and leaves them as they are."""

        def __init__(self, params) -> None:
            super().__init__(params)
            self.room, self.words = np.empty(3), [0.0, 0.0, 0.0]

        def step(self, state, command, touch, period):
            np.multiply(touch.finger_pose[:3], 1.0, out=self.room)
            self.words[:] = self.room.tolist()
            if touch.finger_attached:
                state["place"] = self.words


@good
class SlottedTwinDevice(Slider):
    class Twin(SliderTwin):
        """Has slots and properties."""

        __slots__ = ("_half",)

        def __init__(self, params) -> None:
            super().__init__(params)
            self._half = params.travel / 2

        @property
        def half(self) -> float:
            return self._half

        @cached_property
        def full(self) -> float:
            return 2.0 * self.half

        def step(self, state, command, touch, period):
            super().step(state, command, touch, period)
            np.clip(state["place"], -self.full, self.full, out=state["place"])


@good
class IdealInHeritance(Slider):
    class Twin(IdealTwin):
        """Is an ideal twin with something of its own."""

        def __init__(self, params) -> None:
            super().__init__(params, Slider)

        def read(self, state, reading):
            reading["pose"] = state["pose"]
            return True


@good
class SlowSlider(Slider):
    """Read as seldom as an arm may be (W1): fifty times a second."""

    period = 0.02
    watchdog = 1.0

    class Twin(SliderTwin):
        """Says something new fifty times a second."""

        def fields(self):
            return (*super().fields(), Field("count", "i8", unit="tick", doc="ticks so far"))

        def step(self, state, command, touch, period):
            super().step(state, command, touch, period)
            state["count"] += 1

        def read(self, state, reading):
            return super().read(state, reading) if int(state["count"]) % 20 == 0 else False


@good
class ThreadedSlider(Slider):
    """Brings a thread of its own, and ends it."""

    blocking = True

    def open(self) -> None:
        super().open()
        self._new_events: deque[tuple[float, float, float]] = deque(maxlen=4)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="slider")
        self._thread.start()

    def _listen(self) -> None:
        while not self._over.wait(0.002):
            self._new_events.append((0.0, 0.0, 0.0))

    def read(self, reading: Record) -> bool:
        try:
            place = self._new_events.popleft()
        except IndexError:
            return False
        reading["pose"] = (*place, 1.0, 0.0, 0.0, 0.0)
        return True

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        super().close()


@good
class AsyncSlider(Slider):
    """Talks through an event loop in a thread."""

    blocking = True

    def open(self) -> None:
        super().open()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="loop")
        self._thread.start()

    def _do(self, work):
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(1.0)

    async def _exchange(self) -> tuple[float, float, float]:
        await asyncio.sleep(0.001)
        return (0.0, 0.0, 0.0)

    def read(self, reading: Record) -> bool:
        reading["pose"] = (*self._do(self._exchange()), 1.0, 0.0, 0.0, 0.0)
        return True

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        super().close()


@dataclass(frozen=True)
class ForceParams(SliderParams):
    """Parameters with a limit that is kept."""

    max_force: float = schema.quantity("N", low=0.5, high=10.0, default=5.0, doc="greatest force")


@good
class LimitedSlider(Slider):
    """Its channels depend on its parameters."""

    Params = ForceParams

    @classmethod
    def channels(cls, params):
        return cls.reads, (wrench(force=params.max_force, locked=(0, 1, 3, 4, 5)),)


@good
class MovingSlider(Slider):
    """Tells its speed, a little late."""

    reads = (pose(locked=(3, 4, 5)), twist(locked=(3, 4, 5)))

    class Twin(SliderTwin):
        """Follows, and filters its speed."""

        def fields(self):
            return (*super().fields(), Field("speed", "f8", 3, unit="m/s", doc="speed of the end"))

        def step(self, state, command, touch, period):
            super().step(state, command, touch, period)
            state["speed"] += 0.3 * (touch.finger_twist[:3] - state["speed"])

        def read(self, state, reading):
            reading["twist"][:3], reading["twist"][3:] = state["speed"], 0.0
            return super().read(state, reading)

    def read(self, reading: Record) -> bool:
        reading["twist"] = 0.0
        return super().read(reading)


@good
class Heater(Device):
    """A plate without a pose, that a current warms; it tells one parameter of everything."""

    @dataclass(frozen=True)
    class Params:
        """What it may hold."""

        mass: float = schema.quantity("kg", low=1e-3, high=1.0, default=0.05, doc="mass of the plate")

    reads = (
        temperature("block_temperature", Role.OTHER_TEMPERATURE),
        Channel("flag", 1, "1", doc="1 while it is well"),
    )
    commands = (current(limit=2.0, harmless="it warms a block that nobody touches"),)
    watchdog = 1.0

    class Twin(Twin):
        """A block that loses heat to the room."""

        def set_environment(self, ambient, skin_temperature):
            self._room = ambient

        def fields(self):
            return (Field("temperature", unit="K", doc="temperature of the block"),)

        def reset(self, state, rng):
            state["temperature"] = self._room

        def step(self, state, command, touch, period):
            heat = 5.0 * float(command["current"][0]) ** 2 - 0.5 * (float(state["temperature"]) - touch.ambient)
            state["temperature"] += heat * period / (self.params.mass * 900.0)

        def read(self, state, reading):
            reading["block_temperature"], reading["flag"] = state["temperature"], 1.0
            return True

    def open(self) -> None:
        self._open = True

    def close(self) -> None:
        self._open = False

    def read(self, reading: Record) -> bool:
        reading["block_temperature"], reading["flag"] = 296.15, 0.0
        return True


@good
class TwinOnly(Slider):
    """Has no driver."""

    twin_only = True

    def open(self) -> None:
        raise DeviceError("there is no driver for this slider: use its twin")


class _Session:
    """Keeps a port open as long as somebody uses it."""

    def __init__(self) -> None:
        self.users = 0

    @contextlib.contextmanager
    def use(self):
        self.users += 1
        try:
            yield self
        finally:
            self.users -= 1


@good
class SharedPort(Slider):
    """Two sliders may share a port, which is counted."""

    sessions: ClassVar[dict[str, _Session]] = {}

    def open(self) -> None:
        super().open()
        self._stack = contextlib.ExitStack()
        self._stack.enter_context(self.sessions.setdefault(self.params.port, _Session()).use())

    def close(self) -> None:
        self._stack.close()
        super().close()


@good
class ConvertsErrors(Slider):
    """Turns every error of its library into a DeviceError."""

    def read(self, reading: Record) -> bool:
        try:
            return super().read(reading)
        except Exception as error:
            raise DeviceError(f"the slider does not answer: {error}") from error
