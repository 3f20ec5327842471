"""The matrix through the entrance of hardware: a host's session drives devices behind exchanges.

Behind the exchanges is another session, whose twins fail as planned.  In lockstep an exchange takes a number of ticks,
and the result depends on nothing else; through threads it takes that long in real time.
"""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from typing import Any, ClassVar

from itouch.exchange import EveryNth, ThreadedDevice
from itouch.faults import FOREVER, Kind
from itouch.loop import DeviceFaultError, WallClock
from itouch.loop.device_runner import Runner
from itouch.plugin import Device, DeviceError, Record, Role
from itouch.plugin.discovery import Catalog, Found, find
from itouch.safety.sequence import AT_END, RETREAT
from itouch.session import Session, build, choose_twins, load_scene, restore
from itouch_evidence.faults.matrix import DELAY, KINDS, LASTS, RUN, Cell
from itouch_evidence.faults.phases import PHASES, moments, prepared
from itouch_evidence.faults.truth import Truth

#: A function that finds the entry points of a group.
Finder = Callable[[str], dict[str, Found]]
#: How long a cell runs before its fault [s]: devices that are enabled anew ramp up first.
BEFORE = 1.2
#: Ticks of an exchange with a device that carries a surface, and with one that neither heats nor moves anything.
_SURFACE_TICKS, _OTHER_TICKS = 5, 1
#: How much later [s] than its watchdog a device without commands is examined.
_GRACE = 0.02
_STEP = 10


@dataclasses.dataclass(slots=True)
class Box:
    """What is passed between a host's device and the twin behind it."""

    reading: bytes = b""
    count: int = 0
    error: DeviceError | None = None
    command: bytes = b""
    #: Whether the world stands still, as it does while a host is being enabled: reads are answered all the same then.
    rests: bool = False


class Line(Device):
    """The host's end of an exchange."""

    box: ClassVar[Box]
    #: How long an exchange takes in real time [s]; 0 in lockstep.
    lasts: ClassVar[float] = 0.0

    def open(self) -> None:
        """Take the next reading as new."""
        self._taken = -1

    def close(self) -> None:
        """Do nothing: no resource is held."""

    def write(self, command: Record) -> None:
        """Send a command."""
        self.box.command = command.tobytes()

    def read(self, reading: Record) -> bool | None:
        """Take the reading that has come; False if there is no new one.

        Raises
        ------
        DeviceError
            While the twin behind the exchange is disconnected.
        """
        if self.lasts:
            time.sleep(self.lasts)
        if self.box.error is not None:
            raise DeviceError(str(self.box.error))
        if self._taken == self.box.count and not (self.lasts and self.box.rests):
            return False
        self._taken = self.box.count
        reading.raw.data[:] = self.box.reading
        return True


class _Entry:
    value = "a device behind an exchange"

    def __init__(self, loaded: type[Device]) -> None:
        self._loaded = loaded

    def load(self) -> type[Device]:
        """Return the class."""
        return self._loaded


def _lined(cls: type[Device], ticks: int, period: float, threads: bool) -> type[Device]:
    """Return a device class with the declarations of another, but whose readings come through an exchange."""
    own = {
        "__init__": Device.__init__, "box": Box(), "lasts": ticks * period if threads else 0.0,
        "blocking": True, "period": 0.0, "delay": 0.0, "exchange_time": ticks * period, "command_wait": 0.0,
        "twin_only": False, "Emulator": None, "second_opener": False, "moves_on_open": False,
        "watchdog": cls.watchdog or 0.1, "watchdog_for": classmethod(lambda kind, params: kind.watchdog),
        "wires": classmethod(lambda kind, params: ()),
    }  # fmt: skip
    for name in ("open", "close", "read", "write"):
        own[name] = getattr(Line, name)
    return type(f"Lined{cls.__name__}", (cls,), own)


class Pair:
    """A host and the world behind it, which advance together, tick by tick.

    ``stored``: the State of such a world, and a saved session of its host, from which both go on; else they begin anew.
    ``catalog`` makes the host's catalog of plugins, which may rename everything that they have.
    """

    def __init__(
        self, scene: str | os.PathLike[str], ticks: int, *, threads: bool, slots: int = 1,
        stored: tuple[bytes, Path] | None = None, catalog: Callable[[Finder], Catalog] = Catalog,
    ) -> None:  # fmt: skip
        self.world = prepared(scene, slots=slots)
        self.ticks, self.threads = ticks, threads
        loaded, plugins = load_scene(scene), Catalog()
        found, boxes = dict(find("itouch.devices")), dict[str, Box]()
        period = self.world.model.period
        for device in loaded.devices:
            cls = plugins.device(device.plugin)
            if cls is not None:
                takes = self._takes(device.name)
                lined = _lined(cls, takes, period, threads)
                found[device.plugin] = Found(device.plugin, "bench", "1", _Entry(lined))  # type: ignore[arg-type]
                boxes[device.name] = lined.box  # type: ignore[attr-defined]
        lines = catalog(lambda group: found if group == "itouch.devices" else find(group))
        clock = WallClock() if threads else None
        self.truth = Truth(self.world)
        self._boxes = [(runner, boxes[runner.model.name]) for runner in self.world.runners]
        if stored is None:
            self.host = build(choose_twins(loaded, "none"), catalog=lines, clock=clock)
        else:
            self.world.adopt(stored[0])
            self.measure()
            self.host = restore(stored[1], catalog=lines, clock=clock)
        self.host.guarded = True  # its devices are simulated in this process, and end with it
        if not threads:
            self._take_into_step()
        self._heats = [post for runner in self.host.runners for post in runner.gate.heats]
        #: Number of checks of heat, and the time [s] over which they were counted.
        self.checks, self.watched = 0, 0.0
        self._checked = -1
        self._surfaces = [(r, r.true_position()) for r in self.world.runners if r.model.command(Role.SURFACE_POSE)]
        self._heights: list[list[float]] = []
        self._began = 0.0
        self.host.taps.append(self._tick)

    def _takes(self, name: str) -> int:
        device = self.world.model.devices[name]
        if device.reading(Role.SKIN_CONTACT_TEMPERATURE) is not None:
            return self.ticks
        return _SURFACE_TICKS if device.command(Role.SURFACE_POSE) is not None else _OTHER_TICKS

    def _take_into_step(self) -> None:
        """Let each device make its exchanges in the tick itself, not in a thread."""
        for runner in self.host.runners:
            if isinstance(runner.gate.device, ThreadedDevice):
                runner.gate.device = EveryNth(runner.gate.device.device, self._takes(runner.model.name))

    def _tick(self, tick: int) -> None:
        """Advance the world by a period after a tick of the host; the dead-man's switch is held all the time."""
        self._rest(False)
        if self.host.state["stopping"].item():
            self._persist()
        self._exchange()
        self._note()
        self.host.hold()
        for post in self._heats:
            if post.checked.item() != self._checked:
                self._checked = post.checked.item()
                self.checks += 1
        self.watched += self.world.model.period * bool(self._heats)

    def _persist(self) -> None:
        """Let the faults that are present when everything is stopped last: one that ends meanwhile is another case."""
        for runner, _ in self._boxes:
            state = runner.gate.twin_state
            there = (state["fault.begin"] <= state["fault.tick"]) & (state["fault.tick"] < state["fault.end"])
            state["fault.end"][there] = FOREVER

    def _rest(self, rests: bool) -> None:
        for _, box in self._boxes:
            box.rests = rests

    def _note(self) -> None:
        self.truth.note(self.world.ticks)
        self._heights.append([float(place[2]) for _, place in self._surfaces if place is not None])

    def _exchange(self) -> None:
        for runner, box in self._boxes:
            if box.command:
                runner.sent.raw.data[:] = box.command
        self.world.step_twins(bool(self.host.state["ready"].item()))  # nobody touches before the touch-off has ended
        self.measure()

    def measure(self) -> None:
        """Take the readings of all twins."""
        for runner, box in self._boxes:
            if runner.gate.twin is None:
                continue
            try:
                if runner.gate.twin.read(runner.gate.twin_state, runner.reading) is not False:
                    box.reading, box.count = runner.reading.tobytes(), box.count + 1
                box.error = None
            except DeviceError as error:
                box.error = error

    def adopt(self, stored: tuple[bytes, bytes]) -> None:
        """Go on from the stored States of both."""
        self.host.close()
        self.world.adopt(stored[0])
        self.host.adopt(stored[1])
        self.host.fault = None
        for session in (self.world, self.host):
            session.statistics.faults.clear()
            session.statistics.contacts.clear()
        for _, box in self._boxes:
            box.error, box.command = None, b""
        self.truth.clear()
        self._heights.clear()
        self._began = self.host.seconds

    def truly_safe(self, since: float, deaf: float = 0.0) -> bool:
        """Tell whether since a host's time [s] surfaces have retracted, and nothing else is driven.

        A device that no longer gets commands is given the time of its own watchdog, from the time ``deaf`` [s] at which
        its fault began: that may be later, if something else had stopped the session before.
        """
        period = self.host.model.period
        longest = max(device.limits.watchdog for device in self.world.model.devices.values()) + _GRACE
        while len(self._heights) * period < self._spent(max(since, deaf)) + longest:
            self._exchange()
            self._note()
        before, now = self._heights[round(self._spent(since) / period) - 1], self._heights[-1]
        bottoms = [r.model.command(Role.SURFACE_POSE).low[2] for r, place in self._surfaces if place is not None]  # type: ignore[union-attr]
        back = all(b - n >= RETREAT or n <= low + AT_END for b, n, low in zip(before, now, bottoms, strict=True))
        return back and all(self._acts_safely(runner) for runner in self.world.runners)

    def _spent(self, since: float) -> float:
        """Return a host's time [s] relative to the start of the cell."""
        return since - self._began

    def _acts_safely(self, runner: Runner) -> bool:
        """Tell whether the last commands that a twin received have their safe values, if these are numbers."""
        received = runner.gate.twin_state["fault.received"]
        at = 0
        for channel in runner.model.commands:
            if isinstance(channel.safe, tuple) and tuple(received[at : at + channel.size].tolist()) != channel.safe:
                return False
            at += channel.size
        return True

    def close(self) -> None:
        """Close both sessions."""
        self.host.close()
        self.world.close()

    def enable(self) -> None:
        """Take readings once, and enable the host's devices.

        Raises
        ------
        DeviceError
            If a device can't be opened.
        """
        self.measure()
        self._rest(True)
        self.host.hold()
        self.host.enable()


def stored(pair: Pair) -> dict[str, tuple[bytes, bytes]]:
    """Run a pair through its first contact, and return for each phase both States from which it is reached.

    Raises
    ------
    ValueError
        If there is no complete contact in the scene's script.
    """
    host, world, kept = pair.host, pair.world, {}
    start = world.state.tobytes(), host.state.tobytes()

    def keep() -> None:
        kept[host.ticks] = world.state.tobytes(), host.state.tobytes()

    pair.enable()
    host.run(120.0, each=keep, every=_STEP, until=lambda: bool(host.statistics.contacts))
    ready = next(tick for tick, (_, state) in sorted(kept.items()) if _ready(state, host))
    found = {}
    for name, moment in moments(host, ready).items():
        wanted = max(ready + 0.1 / host.model.period, moment - BEFORE / host.model.period)
        found[name] = kept[min(kept, key=lambda tick, at=wanted: abs(tick - at))]  # type: ignore[misc]
    return {"closed-open": start, **found}


def _ready(state: bytes, session: Session) -> bool:
    import numpy as np

    return bool(np.frombuffer(state, session.state.dtype)[0]["ready"])


def cells(
    pair: Pair, phases: Mapping[str, tuple[bytes, bytes]], *, both: bool = False, every: int = 1
) -> Iterator[Cell]:
    """Run every fault in every device in every phase, or with ``both`` every pair of faults in contact.

    Only one cell in ``every`` is run.
    """
    single = [(device, kind) for device in pair.host.model.devices for kind in KINDS]
    if both:
        for (one, first), (other, second) in list(combinations(single, 2))[::every]:
            yield run(pair, "contact", phases["contact"], [(one, first, 0), (other, second, int(one == other))])
        return
    for phase, (device, kind) in list(product(PHASES, single))[::every]:
        yield run(pair, phase, phases[phase], [(device, kind, 0)])


def run(pair: Pair, phase: str, state: tuple[bytes, bytes], faults: Sequence[tuple[str, Kind, int]]) -> Cell:
    """Run one cell from the stored States of its phase; ``faults``: device, kind and slot of each."""
    pair.adopt(state)
    early = phase == "closed-open"
    begin = pair.world.seconds + (0.0 if early else BEFORE + DELAY)
    for device, kind, slot in faults:
        pair.world.inject(device, kind.label, at=begin, duration=LASTS, slot=slot)
    refused, host = "", pair.host.seconds
    try:
        pair.enable()
        pair.host.run(RUN if early else BEFORE + RUN)
    except DeviceFaultError:
        pass
    except DeviceError as error:
        refused = str(error)
    return _cell(pair, phase, faults, host + (0.0 if early else BEFORE + DELAY), refused)


def _cell(pair: Pair, phase: str, faults: Sequence[tuple[str, Kind, int]], begin: float, refused: str) -> Cell:
    entries: list[dict[str, Any]] = [entry for entry in pair.host.report()["faults"] if entry["trip"] is not None]
    wanted = tuple((device, kind.label) for device, kind, _ in faults)
    told = {(entry["device"], entry["kind"]) for entry in pair.world.injected}
    first = entries[0] if entries else None
    safe: dict[str, Any] | None = first.get("safe") if first is not None else None
    reached = bool(refused) or safe is None or bool(safe["reached"])
    if (
        not reached and first is not None and safe is not None
    ):  # faulty sensors can't verify anything: then the truth counts, and that the report admits it
        honest = ("can't be verified", "retracted", "goes the wrong way")
        said = [text for text in safe["devices"].values() if text.startswith(honest)]
        reached = bool(said) and pair.truly_safe(first["time_s"], begin)
    early = first is not None and first["time_s"] < begin - 1e-9  # stopped before its fault: the machine was too busy
    return Cell(
        faults=wanted, phase=phase,
        trip=first["trip"] if first is not None else "refused" if refused else "",
        cause=first["cause"] if first is not None else refused,
        after=first["time_s"] - begin if first is not None else None,
        safe_after=safe["after_s"] if safe is not None else None,
        safe=reached,
        broken=tuple(pair.truth.broken()), told=early or bool(refused) or set(wanted) <= told,
    )  # fmt: skip
