"""What a fault does: every device is made safe, the cause is noted, and the loop goes on until they are."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import Any

from itouch.loop.ledger import Ledger
from itouch.loop.rig import ProbeRig
from itouch.loop.runner import DeviceFaultError, Runner
from itouch.plugin import Record
from itouch.world import Model

#: How long [s] the devices get to reach their safe state after a fault.
SAFE_TIME = 0.3


class SafeStop:
    """Carries out the safe sequence of one engine."""

    def __init__(
        self, model: Model, state: Record, runners: Sequence[Runner], rigs: Sequence[ProbeRig], ledger: Ledger
    ) -> None:
        self._model, self._runners, self._rigs, self._ledger = model, runners, rigs, ledger
        self._tick = state["tick"]

    def carry_out(self, fault: DeviceFaultError, taps: Sequence[Callable[[int], None]]) -> None:
        """Make every device safe, then note the cause; ``taps`` hear of each tick that this takes."""
        for runner in self._runners:
            if runner.model.name == fault.device:
                runner.fault(fault.trip)
            else:
                runner.disable()
        self._ledger.faults.append(self._describe(fault))
        for _ in range(round(SAFE_TIME / self._model.period)):
            self._step(fault)
            for tap in taps:
                tap(int(self._tick) - 1)

    def _step(self, fault: DeviceFaultError) -> None:
        for runner in self._runners:
            if runner.model.name != fault.device or runner.model.twin:
                runner.write(int(self._tick))
        for rig in self._rigs:
            rig.couple(False)
        for runner in self._runners:
            runner.step_twin()
        self._tick += 1
        for runner in self._runners:
            if runner.twin is not None and runner.model.name != fault.device:
                with contextlib.suppress(Exception):  # one fault is told; a second one must not stop the rest
                    runner.twin.read(runner.twin_state, runner.reading)

    def _describe(self, fault: DeviceFaultError) -> dict[str, Any]:
        element = self._model.scene.device(fault.device)
        place = self._model.scene.places.of(element)
        return {
            "device": fault.device,
            "tick": fault.tick,
            "time_s": fault.tick * self._model.period,
            "trip": fault.trip.name.lower().replace("_", "-"),
            "cause": fault.cause,
            "scene": str(place) if place else None,
        }
