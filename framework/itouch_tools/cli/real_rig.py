"""A scene on its devices' real protocols in real time: the virtual rig here, the session in a servo process of its own.

The session is run as on hardware, with guardian, watchdogs and threads; besides, it is shown the true states of the
twins behind the emulators, so that each touch is judged by the truth, as in lockstep.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from itouch.exchange import TruthReader, TruthWriter
from itouch.loop.run_statistics import Histogram
from itouch.plugin import Role
from itouch.servo.serve import Servo, build
from itouch.session import Session
from itouch_tools.cli.served_twins import VirtualRig, placed, require_switch
from itouch_tools.cli.wake_ups import WakeUps

if TYPE_CHECKING:
    from itouch.servo.launcher_pipe import Outbox
    from itouch.servo.shared_memory import SharedMemory

#: Period [s] at which this process checks whether the session has ended.
_LOOK = 0.05
#: Widths of the bins of distances [m] and of ages [s].
_DISTANCE, _AGE = 1e-6, 1e-4


class ObservedSession(Servo):
    """A session that is shown the twins' true states after every tick, and notes how old its readings are."""

    def __init__(self, session: Session, segment: SharedMemory, outbox: Outbox, config: dict[str, Any]) -> None:
        super().__init__(session, segment, outbox, config)
        self._truth = TruthReader(config["truth"])
        #: Number of ticks, and of those in which no newer true states were known.
        self._ticks = self._old = 0
        self._surfaces = [_Surface(session, name) for name in _surfaces(session)]
        session.taps.append(self._see)

    def _see(self, tick: int) -> None:
        session, before = self.session, self._truth.now
        new = self._truth.read() and self._truth.now != before
        self._ticks, self._old = self._ticks + 1, self._old + (not new)
        for modality in session.model.modalities:
            modality.instance.on_ground_truth(modality.model, session.state, self._truth.states)
        for surface in self._surfaces:
            surface.see(tick)

    def report(self) -> dict[str, Any]:
        """Return the report, with the figures of the wires added."""
        told = {one.name: one.told() for one in self._surfaces}
        return {**super().report(), "wires": {"ticks": self._ticks, "truth_old": self._old, "surfaces": told}}


class _Surface:
    """How far a surface moves while its newest reading ages."""

    def __init__(self, session: Session, name: str) -> None:
        model, state = session.model.devices[name], session.state
        self.name, self._period = name, session.model.period
        channels = [channel.role for channel in model.reads]
        self._measured = state[f"{name}.measured"][channels.index(Role.TRACKED_POSE) :]
        self._sent, self._ready, self._tick = (
            state[model.field(Role.SURFACE_POSE, "sent")],
            state["ready"],
            state["tick"],
        )
        self._last = self._sent[:3].copy()
        self._moved, self._ages = Histogram(_DISTANCE), Histogram(_AGE)

    def see(self, tick: int) -> None:
        """Count a tick."""
        speed = float(np.linalg.norm(self._sent[:3] - self._last)) / self._period
        self._last[:] = self._sent[:3]
        if not self._ready.item():
            return
        age = (self._tick.item() - int(self._measured[0])) * self._period
        self._ages.add(age)
        self._moved.add(speed * age)

    def told(self) -> dict[str, Any]:
        """Return the distributions, over all ticks, of the age of its readings and of speed times age."""
        return {"age_ms": self._ages.summary(1e3), "speed_times_age_mm": self._moved.summary(1e3)}


def _surfaces(session: Session) -> list[str]:
    """Return the names of the devices that move a surface and measure where it is."""
    return [
        name
        for name, device in session.model.devices.items()
        if device.command(Role.SURFACE_POSE) is not None and device.reading(Role.TRACKED_POSE) is not None
    ]


def serve(segment: SharedMemory, outbox: Outbox, config: dict[str, Any]) -> tuple[dict[str, Any], BaseException | None]:
    """Build and run the session in the servo process; return its report, and what ended it if it failed."""
    return ObservedSession(build(config), segment, outbox, config).run()


class RealRig:
    """A virtual rig in this process, and the session on it in a servo process.

    Both use addresses of their own, whatever the scene names: several may run at once, if the machine has room.
    """

    def __init__(self, scene: str, *, rig: str | None = None, seed: int = 0) -> None:
        from itouch.plugin.discovery import Catalog
        from itouch.session import choose_twins, load_scene

        self._stack = contextlib.ExitStack()
        folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="itouch-"))
        catalog = Catalog()
        self.scene = placed(load_scene(scene, rig=rig, twin="none", catalog=catalog), catalog, folder)
        self.world = Session.of(choose_twins(self.scene, "all"), catalog=catalog, seed=seed)
        self._stack.callback(self.world.close)
        self.truth = os.path.join(folder, "truth")
        states = {runner.model.name: runner.gate.twin_state for runner in self.world.runners}
        writer = TruthWriter(self.truth, states)
        self._stack.callback(writer.close)
        self.rig = VirtualRig(self.world, truth=writer)
        self._seed, self._stopped = seed, False
        self._report: dict[str, Any] = {}
        self._error: Exception | None = None

    def run(self, seconds: float | None = None) -> dict[str, Any]:
        """Run for a time [s], or until the simulated operator's motion has ended; return the report.

        Raises
        ------
        ItouchError
            If the session cannot begin, or its process has left no report.
        """
        from itouch.servo import realtime

        with self._stack:
            require_switch(self.world.model.devices.values())
            self.rig.open()
            self._stack.callback(self.rig.close)
            host = threading.Thread(target=self._host, args=(seconds,), name="itouch-host", daemon=True)
            realtime.be_punctual()  # in the main thread, whose priority the wires' threads inherit
            with WakeUps() as machine:
                host.start()
                self.rig.run(lambda: not host.is_alive())
        if self._error is not None:
            raise self._error
        told = {
            "rig": {"lateness_us": _micro(self.rig.lateness), "behind_s": self.rig.behind},
            "machine": {"lateness_us": machine.late, "held": machine.held},
        }
        return {**self._report, "wires": {**self._report.get("wires", {}), **told}}

    def _host(self, seconds: float | None) -> None:
        """Start the session and follow it to its end: its process would die with the thread that started it."""
        from itouch.loop import DeviceFaultError
        from itouch.servo.launching import configured, start

        try:
            config = configured(self.scene, seed=self._seed, seconds=seconds, enable=True)
            config |= {"serves": "itouch_tools.cli.real_rig:serve", "truth": self.truth}
            with contextlib.closing(start(f"virtual-rig-{os.getpid()}", config)) as handle:
                try:
                    while not handle.wait(_LOOK):
                        if self._stopped or (seconds is None and self.world.done):
                            handle.request_stop()
                except DeviceFaultError as fault:
                    print(f"fault: {fault}", file=sys.stderr)
                self._report = handle.report()
        except Exception as error:
            self._error = error

    def stop(self) -> None:
        """Ask the session to end safely; may be called from a signal handler."""
        self._stopped = True


def _micro(found: Histogram) -> dict[str, float | None]:
    """Return percentiles of times [us]."""
    named = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}
    values = {name: found.percentile(percent) for name, percent in named.items()}
    return {name: None if value is None else 1e6 * value for name, value in values.items()}


def main(options: argparse.Namespace) -> int:
    """Run a scene in real time, then show and write the report; return the exit code."""
    from itouch.schema.wait_notices import waiting
    from itouch_tools.cli.shutdown import write_report
    from itouch_tools.report.screen import Screen

    began = time.monotonic()
    with waiting(f"running {options.scene} on its wires in real time") as wait:
        both = RealRig(options.scene, rig=options.rig, seed=options.seed)
        wait.part(None, f"built in {time.monotonic() - began:.1f} s")
        report = both.run(options.duration)
    Screen(both.world, sys.stdout).finish(report)
    for line in told(report):
        print(line)
    write_report(options.report, lambda: report)
    return 1 if report["faults"] else 0


def told(report: dict[str, Any]) -> Sequence[str]:
    """Return lines on the wires: how late each process was woken, and how old a surface's readings were."""
    wires = report["wires"]
    woken = {"machine": wires["machine"]["lateness_us"], "session": report["servo"]["lateness_us"] or {},
             "simulated devices": wires["rig"]["lateness_us"]}  # fmt: skip
    late = "; ".join(
        f"{who} p99.9 {_ms(one.get('p99.9'))}, at most {_ms(one.get('max'))}" for who, one in woken.items()
    )
    held = "held" if wires["machine"]["held"] else "did NOT hold"
    lines = [f"the machine's wake-ups {held}: woken late, {late}; {wires['rig']['behind_s']:.1f} s behind in all"]
    for name, one in wires.get("surfaces", {}).items():
        far, age = one["speed_times_age_mm"]["p99"], one["age_ms"]
        if far is not None:
            lines.append(f"{name}: readings {age['p50']:.1f} ms old (p99 {age['p99']:.1f}); "
                         f"speed times age p99 {far:.3f} mm")  # fmt: skip
    return lines


def _ms(microseconds: float | None) -> str:
    return "-" if microseconds is None else f"{microseconds / 1e3:.2f} ms"
