"""Checks of a device inside an engine: it can be restored, runs, is stopped when it falls silent, ends on SIGTERM."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from itouch.loop import Engine, Status
from itouch.schema import ItouchError
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.harness import DeviceHarness
from itouch.testing.reproducibility import script
from itouch.world import Model


def _engine(harness: DeviceHarness, seed: int = 4) -> Engine:
    return Engine(Model.of(harness.scene(), harness.catalog), seed=seed)


@check("restores", "a restored session goes on to the same bytes")
def restores(harness: DeviceHarness) -> None:
    """Adopt the State of a running engine in a second one."""
    straight, again = _engine(harness), _engine(harness, seed=9)
    straight.run(0.137)
    again.adopt(straight.state.tobytes())
    straight.run(0.2)
    again.run(0.2)
    if straight.state.tobytes() != again.state.tobytes():
        names = [name for name in straight.state if straight.state[name].tobytes() != again.state[name].tobytes()]
        raise CheckError(
            f"after a restore these fields continue differently: {', '.join(names[:4])}",
            cause="the twin keeps something outside of State, or looks at the clock",
            advice="declare it in fields() and keep it in state",
        )


@check("runs", "it runs without a fault, and ends safely")
def runs(harness: DeviceHarness) -> str:
    """Run for half a second with nothing else in the scene."""
    engine = _engine(harness)
    engine.run(0.5)
    if engine.status("unit") is not Status.ENABLED:
        raise CheckError(
            f"after half a second it is {engine.status('unit').name}", cause="a trip", advice="see the report's faults"
        )
    own = {f"unit.{channel.name}" for channel in engine.model.devices["unit"].reads}
    for name, view in engine.state.items():
        mine = name in own or name.startswith(("unit.twin.", "unit.command.", "unit.sent."))
        if mine and view.dtype.kind == "f" and not np.isfinite(view).all():
            raise CheckError(
                f"the field {name} is {view}",
                cause="not filled, or not stable",
                advice="write every field in reset() and step()",
            )
    engine.close()
    times = engine.report()["servo"]["tick_us"]
    return f"tick p50 {times['p50']:.0f} us"


@check("stale-is-seen", "a device that falls silent is stopped")
def stale(harness: DeviceHarness) -> None:
    """Let the twin say for ever that there is no new reading."""
    engine = _engine(harness)
    engine.run(0.05)
    runner = next(r for r in engine.runners if r.model.name == "unit")
    twin = runner.gate.twin
    if twin is None:
        raise NotApplicableError("it has no twin")

    class Silent(type(twin)):  # type: ignore[misc]
        def __init__(self) -> None:
            self.__dict__.update(twin.__dict__)

        def read(self, state: object, reading: object) -> bool:
            return False

    runner.gate.twin = Silent()
    try:
        engine.run(12.0)
    except ItouchError as error:
        if "unit" not in str(error):
            raise CheckError(
                f"the fault does not name the device: {error}", cause="framework", advice="report it"
            ) from error
        return
    if not int(engine.state["unit.age"]) > 100:
        raise CheckError(
            "a silent device's age does not grow",
            cause="read returns True though nothing is new",
            advice="return False from read when nothing is new",
        )
    raise CheckError(
        "a device that was silent for 12 s was not stopped",
        cause="its watchdog is longer",
        advice="state a shorter period or watchdog",
    )


def serve(harness: DeviceHarness, out: str) -> None:
    """Run until SIGTERM comes; write to the file ``out`` once the engine is closed."""
    engine = _engine(harness)
    signal.signal(signal.SIGTERM, lambda *_: engine.stop())
    with engine:
        engine.enable()
        print("running", flush=True)
        engine.run(3600.0, each=None)
    Path(out).write_text("closed")


def last_error(told: str) -> str:
    """Return the error with which a process has ended, whole, from what it wrote to its error stream."""
    lines = [line for line in told.splitlines() if line.strip()]
    begun = [number for number, line in enumerate(lines) if line.startswith("Traceback ")]
    ends = (line for line in lines[begun[-1] + 1 :] if not line.startswith(" ")) if begun else reversed(lines)
    return next(ends, "it says nothing")


@check("sigterm", "SIGTERM ends a session safely")
def sigterm(harness: DeviceHarness) -> None:
    """Run it in a process of its own, and end that by SIGTERM."""
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "end")
        command = script(harness, f"{__name__}:serve", out)
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert process.stdout is not None  # noqa: S101  (a pipe was asked for)
        if "running" not in process.stdout.readline():
            _, told = process.communicate(timeout=60)
            raise CheckError(
                f"it does not run in another process: {last_error(told)}",
                cause="an import that fails",
                advice="install the plugin, or make its module importable",
            )
        process.send_signal(signal.SIGTERM)
        try:
            process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise CheckError(
                "it does not end on SIGTERM",
                cause="a call that never returns, or a handler of its own",
                advice="leave signals to the framework; give every wait a timeout",
            ) from None
        if not os.path.exists(out):
            raise CheckError("it was not closed", cause="an exception on the way out", advice="close must succeed")
