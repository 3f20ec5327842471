"""A workload: a plugin of any kind at work for some ticks, so that its conduct can be examined."""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from itouch.loop import Engine
from itouch.plugin import Contact, ContactEvent, Record
from itouch.testing.harness import PERIOD, DeviceHarness, TwinBench
from itouch.testing.open_device import Opened
from itouch.testing.scenario import ModalityHarness
from itouch.world import Model

#: A call of the plugin: its name, the record that is passed (which a check may replace), and the function.
Call = tuple[str, Record, Callable[[Record], Any]]


class Workload(ABC):
    """A plugin at work; a context that is entered before the first tick and left after the last."""

    #: What is at work, in words.
    what: str
    #: Number of ticks after which everything has happened once.
    ticks: int

    @abstractmethod
    def tick(self) -> None:
        """Let the plugin work for a tick."""

    @abstractmethod
    def calls(self) -> Sequence[Call]:
        """Return the calls that the framework makes in every tick, each with the record that it passes."""

    @property
    @abstractmethod
    def params(self) -> Any:
        """The parameters that the plugin works with."""

    def __enter__(self) -> Workload:
        return self

    def __exit__(self, *_: object) -> None:  # noqa: B027
        """Do nothing: there is nothing to end."""


class TwinWorkload(Workload):
    """A twin on its bench."""

    what, ticks = "the twin", 1200

    def __init__(self, harness: DeviceHarness) -> None:
        self.bench: TwinBench = harness.bench()

    @property
    def params(self) -> Any:
        """The parameters of the twin."""
        return self.bench.twin.params

    def tick(self) -> None:
        """Drive, step and read."""
        self.bench.step()

    def calls(self) -> Sequence[Call]:
        """Return step and read."""
        b, twin = self.bench, self.bench.twin
        return (
            ("step(state, ...)", b.state, lambda state: twin.step(state, b.command, b.touch, PERIOD)),
            ("step(..., command, ...)", b.command, lambda command: twin.step(b.state, command, b.touch, PERIOD)),
            ("read(state, reading)", b.reading, lambda reading: twin.read(b.state, reading)),
        )


class DriverWorkload(Workload):
    """An open driver."""

    what, ticks = "the driver", 60

    def __init__(self, harness: DeviceHarness) -> None:
        self._harness = harness
        self._end = contextlib.ExitStack()
        self.opened: Opened

    @property
    def params(self) -> Any:
        """The parameters of the device."""
        return self.opened.device.params

    def __enter__(self) -> Workload:
        self.opened = self._end.enter_context(opened(self._harness))
        self.opened.fresh(5.0)
        return self

    def __exit__(self, *_: object) -> None:
        self._end.close()

    def tick(self) -> None:
        """Read, and send the safe command."""
        self.opened.exchange()

    def calls(self) -> Sequence[Call]:
        """Return read, and write if it has commands."""
        o = self.opened
        read: Call = ("read(reading)", o.reading, o.device.read)
        return (read, ("write(command)", o.command, o.device.write)) if o.command else (read,)


@contextlib.contextmanager
def opened(harness: DeviceHarness) -> Iterator[Opened]:
    """Lend the device that several checks share, or open one for this check alone."""
    if harness.shared is not None:
        with harness.shared.lent(harness) as lent:
            yield lent
        return
    with Opened(harness) as own:
        yield own


class ModalityWorkload(Workload):
    """A modality in its scene."""

    what = "the modality"

    def __init__(self, harness: ModalityHarness) -> None:
        self.engine: Engine = harness.engine()
        self.own = harness.own(self.engine)[0]
        self.ticks = round(harness.seconds / self.engine.model.period)

    @property
    def params(self) -> Any:
        """The parameters that it was made with."""
        return self.own.params

    def tick(self) -> None:
        """Let the engine run one tick."""
        self.engine.tick()

    def calls(self) -> Sequence[Call]:
        """Return on_contact and update."""
        own, period = self.own, self.engine.model.period * self.own.every
        event = touch(self.engine.model, self.engine.ticks)
        found: list[Call] = [
            ("update(model, state, ...)", self.engine.state, lambda s: own.instance.update(own.model, s, period))
        ]
        if event is not None and Contact.BEGIN in own.instance.subscribes_to:
            found.append(("on_contact(event, model, state)", self.engine.state,
                          lambda s: own.instance.on_contact(event, own.model, s)))  # fmt: skip
        return found


def touch(model: Model, tick: int) -> ContactEvent | None:
    """Return a made-up event of a contact that begins, or None if nothing can be touched."""
    if not model.objects or not model.probes:
        return None
    up, still = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    return ContactEvent(Contact.BEGIN, tick, model.probes[0].name, model.objects[0], 0, still, up, 0.0, 0.0,
                        still, 1e-4, 1.0, 0.0)  # fmt: skip


def workloads(harness: DeviceHarness | ModalityHarness) -> list[Callable[[], Workload]]:
    """Return what of a plugin can be put to work here: a modality; or a twin, and the driver if it can be opened."""
    if isinstance(harness, ModalityHarness):
        return [lambda: ModalityWorkload(harness)]
    found: list[Callable[[], Workload]] = [lambda: TwinWorkload(harness)]
    if harness.hardware or (harness.emulated and harness.cls.Emulator is not None):
        found.append(lambda: DriverWorkload(harness))
    return found
