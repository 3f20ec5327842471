"""What an operator does to a session besides running it: enable, re-arm, reconnect, hold the switch, inject faults."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from itouch.faults import FOREVER, FaultyTwin, Injection, Kind
from itouch.loop.device_runner import DeviceFaultError, Runner, Status
from itouch.loop.probe_rig import ProbeRig
from itouch.loop.run_statistics import RunStatistics
from itouch.plugin import DeviceError, Record, Role
from itouch.safety import LOSSES, HoldToRun, Trip, connect, first_reading
from itouch.world import Model

#: How long [s] re-arming waits for devices that have nothing new: not as long as a guardian waits for the loop.
ANSWER_TIME = 0.05


class LatchedError(DeviceError):
    """A device that a trip has stopped was to be enabled; it must be re-armed first."""


class OperatorCommands:
    """The operator's commands to the devices of one engine."""

    def __init__(
        self,
        model: Model,
        state: Record,
        runners: Mapping[str, Runner],
        rigs: Sequence[ProbeRig],
        statistics: RunStatistics,
    ) -> None:
        self._model, self._runners, self._rigs, self._statistics = model, runners, rigs, statistics
        self._tick = state["tick"]
        #: Called again and again while devices are opened before anything is enabled or re-armed.
        self.waiting: Callable[[], None] = lambda: None
        self.hold = HoldToRun(
            state, [one.gate for one in runners.values()], model.period, asked=model.scene.safety.hold_to_run
        )

    def enable(self, *, opens: bool = True) -> None:
        """Connect all devices at once, and let commands through; ``opens``: also open those that are CLOSED.

        Raises
        ------
        LatchedError
            If a trip is latched: it outlives saving, restoring and closing.  No device was opened.
        DeviceError
            With everything that failed; optional devices may be missing.
        """
        tick = self._tick.item()
        latched = self.latched_faults()
        if latched:
            told = [str(fault) for fault in latched]
            raise LatchedError("\n".join([*told, "it is still stopped: re-arm first, when what stopped it is over"]))
        wanted = [one for one in self._runners.values() if opens or one.latch.status is not Status.CLOSED]
        self._require_sight(wanted)
        failures = connect([one.lifecycle for one in wanted], tick, meanwhile=self.waiting)
        for name, why in failures.items():
            if self._runners[name].model.optional:
                self._runners[name].lifecycle.abandon()
                self._statistics.faults.append(self._absent(name, why))
        needed = [f"device '{name}': {why}" for name, why in failures.items() if not self._runners[name].model.optional]
        if needed:
            raise DeviceError("\n".join(needed))
        self._require_hold(tick)
        self.hold.recall(tick)
        for runner in self._runners.values():
            if runner.latch.status is Status.OPEN:
                runner.lifecycle.enable()

    @property
    def latched(self) -> list[Runner]:
        """The devices stopped by a trip that only re-arming releases; no twins, and no optional device that is lost."""
        stopped = [one for one in self._runners.values() if one.latch.trip is not Trip.NONE and not one.model.twin]
        return [one for one in stopped if not _lost(one)]

    def latched_faults(self) -> list[DeviceFaultError]:
        """Return the latched trips as the faults that caused them."""
        return [
            DeviceFaultError(
                one.model.name, one.latch.tripped, one.latch.trip, f"was stopped by {one.latch.trip.label}"
            )
            for one in self.latched
        ]

    def _absent(self, name: str, why: str) -> dict[str, Any]:
        scene, tick = self._model.scene, self._tick.item()
        place = scene.places.of(scene.device(name))
        return {
            "device": name, "tick": tick, "time_s": tick * self._model.period, "trip": Trip.DEVICE_ERROR.label,
            "cause": f"is absent: {why}", "scene": str(place) if place else None, "optional": True,
        }  # fmt: skip

    def _require_sight(self, wanted: Iterable[Runner]) -> None:
        """Refuse to enable devices that act on a finger whose place no device can tell.

        Raises
        ------
        DeviceError
            If there are any.
        """
        if told := [
            f"device '{one.model.name}' can't be enabled: {one.lifecycle.blind}"
            for one in wanted
            if one.lifecycle.blind
        ]:
            raise DeviceError("\n".join(told))

    def _require_hold(self, tick: int) -> None:
        if self.hold.required and not self.hold.held(tick):
            sentence = "nobody holds the dead-man's switch: hold it (Space in the window, or the device's own) to go on"
            raise DeviceError(sentence)

    def rearm(self) -> None:
        """Release every latched trip, and enable again from the measured state, with a ramp.

        Raises
        ------
        DeviceError
            With everything that still stands in the way; nothing is enabled then, and every trip stays latched.
        """
        self.require_opened()
        tick = self._tick.item()
        stopped = any(runner.latch.status is Status.FAULT for runner in self._runners.values())
        self._require_sight(self._runners.values())
        failures = self._open_latched(tick)
        self.hold.ask(tick)
        self._require_hold(tick)
        # Where others act already, no tick may be missed for the sake of one that is silent.
        rearmed, until = [], 0.0 if self._acting else time.monotonic() + ANSWER_TIME
        for runner in self._runners.values():
            try:
                runner.lifecycle.may_rearm(tick, until)
                rearmed.append(runner)
            except DeviceError as error:
                if not _lost(runner):  # the session goes on without it
                    failures.append(str(error))
        if failures:
            raise DeviceError("\n".join(failures))
        for runner in rearmed:
            runner.lifecycle.release(tick)
        for rig in self._rigs:
            if stopped or not rig.tracker.model.twin:  # a twin moves unfollowed in a stop only
                rig.rearm()
        for runner in self._runners.values():
            if runner.latch.status is Status.OPEN:
                runner.lifecycle.enable()
                runner.gate.actuation.ramp_in()
        if self._statistics.faults:
            self._statistics.faults[-1]["rearmed_s"] = tick * self._model.period

    @property
    def _acting(self) -> bool:
        """Whether any hardware is ENABLED."""
        return any(one.latch.enabled and not one.model.twin for one in self._runners.values())

    def _open_latched(self, tick: int) -> list[str]:
        """Open what a trip has stopped and a restored session found closed, so that its readings can be checked.

        Open also what has a dead-man's switch, so that it can tell whether somebody holds it.  Return what failed.
        """
        latched = self.latched
        asked = [one for one in self._runners.values() if one in latched or one.model.reading(Role.DEADMAN) is not None]
        closed = (
            [one for one in asked if one.latch.status is Status.CLOSED and not one.model.optional] if latched else []
        )
        if closed and self._acting:
            return [
                f"device '{one.model.name}' is CLOSED while others are ENABLED: reconnect it first" for one in closed
            ]
        failures = connect([one.lifecycle for one in closed], tick, meanwhile=self.waiting)
        return [f"device '{name}': {why}" for name, why in failures.items()]

    def reconnect(self, device: str) -> None:
        """Close a device and open it anew; it is then OPEN, and re-arming enables it.

        Raises
        ------
        DeviceError
            If it is missing or refuses.
        """
        self.begin_reconnect(device)
        self.finish_reconnect(device)

    def spare(self, device: str) -> None:
        """Refuse to do without a device while it is ENABLED, unless the session goes on without it anyway.

        Raises
        ------
        DeviceError
            If others rely on it: nobody would know where the finger is that they act on.
        """
        runner = self._runner(device)
        if runner.latch.enabled and not runner.model.twin and runner.gate.on_loss is None:
            raise DeviceError(f"device '{device}' is ENABLED and needed: stop the session before it is reconnected")

    def begin_reconnect(self, device: str) -> None:
        """Make a device safe, and close and open it anew in a thread; it is CLOSED until ``finish_reconnect``.

        Raises
        ------
        DeviceError
            If there is none of that name, a budget of it is used up, or it is being opened already.
        """
        lifecycle = self._runner(device).lifecycle
        try:
            lifecycle.require_free()
        except DeviceError as error:
            raise DeviceError(f"device '{device}' {error}") from error
        lifecycle.begin_reconnect()

    def finish_reconnect(self, device: str) -> None:
        """Wait for the device to be open, and read it once.

        Raises
        ------
        DeviceError
            If it is missing or refuses, or took too long; it stays CLOSED.
        """
        runner, failures = self._runner(device), dict[str, str]()
        if failed := runner.lifecycle.finish_reconnect():
            raise DeviceError(f"device '{device}': {failed}")
        first_reading(runner.lifecycle, self._tick.item(), failures)
        if failures:
            runner.lifecycle.put_down()
            raise DeviceError(f"device '{device}': {failures[device]}")

    def reconnected(self, device: str) -> bool:
        """Tell whether ``finish_reconnect`` would not have to wait."""
        return self._runner(device).lifecycle.settled

    def require_opened(self) -> None:
        """Refuse to enable anything while a device is being opened anew.

        Raises
        ------
        DeviceError
            If there is one.
        """
        if awaited := [f"'{name}'" for name, runner in self._runners.items() if runner.lifecycle.awaited]:
            listed = ", ".join(awaited)
            raise DeviceError(f"device {listed} is being reconnected: re-arm when that is done, or has failed")

    def _runner(self, device: str) -> Runner:
        if device not in self._runners:
            raise DeviceError(f"there is no device named '{device}'; there are {', '.join(self._runners) or 'none'}")
        return self._runners[device]

    def inject(self, device: str, slot: int, injection: Injection) -> None:
        """Put another fault into a slot of a device's plan.

        Raises
        ------
        ValueError
            If the device's twin has no such slot, or no such channel.
        """
        runner = self._runner(device)
        if not isinstance(runner.gate.twin, FaultyTwin) or not 0 <= slot < len(runner.gate.twin.plan):
            raise ValueError(f"device '{device}' has no slot {slot} for a fault: give the scene a <fault> of it")
        runner.gate.twin.write_plan(runner.gate.twin_state, slot, injection)

    def injected(self, *, lately: bool = False) -> list[dict[str, Any]]:
        """Return the injected faults that have begun; ``lately``: only those that last or ended within a second."""
        now, rate = self._tick.item(), self._model.scene.rates.servo
        earliest = now - rate if lately else -1.0
        found = []
        for name, runner in self._runners.items():
            if not isinstance(runner.gate.twin, FaultyTwin):
                continue
            elements = [fault for fault in self._model.scene.faults if fault.device == name]
            for slot, element in enumerate(elements):
                kind, begin, end = runner.gate.twin.planned(runner.gate.twin_state, slot)
                if kind is not Kind.NONE and begin <= now and end > earliest:
                    found.append(self._entry(name, element, kind, begin, end))
        return found

    def _entry(self, device: str, element: Any, kind: Kind, begin: int, end: int) -> dict[str, Any]:
        place, period = self._model.scene.places.of(element), self._model.period
        return {
            "device": device, "tick": begin, "time_s": begin * period, "trip": None, "kind": kind.label,
            "until_s": None if end == FOREVER else end * period,
            "cause": f"was given an injected fault: {kind.label}", "scene": str(place) if place else None,
        }  # fmt: skip


def _lost(runner: Runner) -> bool:
    """Tell whether a device is an optional one that was lost."""
    return runner.model.optional and runner.latch.trip in LOSSES
