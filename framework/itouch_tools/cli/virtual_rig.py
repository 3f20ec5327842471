"""``itouch-py virtual-rig``: the devices of a scene, simulated behind their real protocols.

Every device's twin stands where its parameters say that the device is (a serial port, a socket, USB/IP), coupled by
the same operator and the same finger as in a run on twins; another ``itouch-py`` runs the scene on it as on hardware.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from itouch.exchange import ServedEmulator
from itouch.plugin import Emulator
from itouch.schema import ItouchError
from itouch.schema.terminal import note
from itouch_tools.cli.arguments import Parser, output_file, seconds

if TYPE_CHECKING:
    from itouch.loop import Engine
    from itouch.loop.runner import Runner

#: A simulation this far behind goes on from now [s].
BEHIND = 0.1
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def main(argv: Sequence[str]) -> int:
    """Serve a scene's devices until Ctrl-C, or for a time."""
    parser = Parser(prog="itouch-py virtual-rig", description=main.__doc__)
    parser.add_argument("scene", metavar="SCENE.xml", help="the scene that another itouch-py will run")
    parser.add_argument("--rig", metavar="FILE", help="put another rig with the same device names under the scene")
    parser.add_argument("--for", dest="duration", type=seconds, metavar="60s", help="end after this time")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of all noise (default 0)")
    parser.add_argument("--run", action="store_true",
                        help="run the scene too, in this process and in step: as fast as the wires answer")  # fmt: skip
    parser.add_argument("--report", type=output_file, metavar="FILE.json", help="with --run: write the report as JSON")
    parser.add_argument("--trace", type=output_file, metavar="FILE", help="with --run: write what goes over the wires")
    parser.add_argument(
        "--only",
        metavar="DEVICE",
        action="append",
        default=[],
        help="with --run: only this device (repeat: these) on its wire, the rest without",
    )
    options = parser.parse_args(argv)
    if (options.report or options.trace or options.only) and not options.run:
        parser.error("--report, --trace and --only go with --run")
    if options.run:
        from itouch_tools.cli import lockstep

        return lockstep.main(options)
    from itouch.servo import realtime
    from itouch.servo.prepare import prepare

    session = prepare(options.scene, seed=options.seed, twin="all", rig=options.rig)
    rig = VirtualRig(session)
    ended: list[int] = []
    before = {number: signal.signal(number, lambda n, _: ended.append(n)) for number in _SIGNALS}
    try:
        for name, where in rig.open():
            print(f"{name}: {where}")
        print("ready; Ctrl-C ends it", flush=True)
        realtime.be_punctual()
        limit = time.monotonic() + options.duration if options.duration is not None else float("inf")
        rig.run(lambda: bool(ended) or time.monotonic() >= limit)
    finally:
        rig.close()
        for number, handler in before.items():
            signal.signal(number, handler)
        session.close()
    return 0


class VirtualRig:
    """The twins of a session behind their emulators, whose timers run ``speed`` times as fast as the host's.

    ``places`` are the parameters of those devices, by name, that are somewhere else than their scene says; ``wires``
    are the emulators of those that have another than their own.
    """

    def __init__(
        self,
        session: Engine,
        *,
        speed: float = 1.0,
        places: Mapping[str, Any] | None = None,
        wires: Mapping[str, Emulator] | None = None,
    ) -> None:
        self._session = session
        self._period = session.model.period
        self._lines: list[tuple[Runner, Emulator]] = []
        for runner in session.runners:
            emulator = (wires or {}).get(runner.model.name) or _emulator(runner, places or {})
            emulator.speed = speed
            self._lines.append((runner, emulator))
        #: Whether a host drives a device: then the operator's motion goes on.
        self.driven = False

    def open(self) -> list[tuple[str, str]]:
        """Begin to listen; return each device's name and where it is.

        Raises
        ------
        DeviceError
            If a device's place is taken.
        """
        self.step()
        return [(runner.model.name, emulator.open()) for runner, emulator in self._lines]

    def close(self) -> None:
        """Hang up."""
        for _, emulator in self._lines:
            emulator.close()

    def run(self, stop: Callable[[], bool]) -> None:
        """Simulate in real time, and answer each host in a thread of its own, until ``stop`` says so."""
        served = [(runner, ServedEmulator(emulator, runner.reading, runner.sent)) for runner, emulator in self._lines]
        due = time.monotonic()
        late = 0.0
        try:
            while not stop():
                due += self._period
                self._simulate(served)
                rest = due - time.monotonic()
                if rest > 0.0:
                    time.sleep(rest)
                elif -rest > BEHIND:
                    late -= rest
                    due -= rest
        finally:
            for _, wire in served:
                wire.close()
        if late:
            note(f"the simulation was {late:.1f} s too slow in all")

    def _simulate(self, served: list[tuple[Runner, ServedEmulator]]) -> None:
        """Do what the hosts have asked for last, for one period, and show them how it went."""
        for runner, wire in served:
            self.driven |= wire.take(runner.sent)
        self.step()
        now = self._session.seconds
        for runner, wire in served:
            wire.show(now, runner.reading)

    def step(self) -> None:
        """Simulate one period, and let the twins measure."""
        self._session.step_twins(self.driven)
        for runner, _ in self._lines:
            if runner.twin is not None:
                runner.twin.read(runner.twin_state, runner.reading)

    def look(self) -> None:
        """Let every emulator answer once."""
        now = self._session.seconds
        for runner, emulator in self._lines:
            self.driven |= emulator.serve(now, runner.reading, runner.sent)

    def keep_up(self) -> None:
        """Let those emulators live through the last period that have a course of their own."""
        now = self._session.seconds
        for runner, emulator in self._lines:
            if emulator.lives:
                self.driven |= emulator.serve(now, runner.reading, runner.sent)

    def handles(self) -> list[int]:
        """Return the file descriptors on which a host's next request comes."""
        return [handle for _, emulator in self._lines for handle in emulator.handles()]


def _emulator(runner: Runner, places: Mapping[str, Any]) -> Emulator:
    """Return the emulator of a device.

    Raises
    ------
    ItouchError
        If its plugin has none.
    """
    cls = runner.model.cls.Emulator
    if cls is None:
        raise ItouchError(f"device '{runner.model.name}': plugin '{runner.model.plugin}' has no emulator")
    found: Emulator = cls(places.get(runner.model.name, runner.model.params))
    return found
