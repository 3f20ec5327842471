"""What happens at a fault: every device is made safe, this is verified, and the cause is noted."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from itouch.loop.clock import Clock
from itouch.loop.device_runner import Runner, Status
from itouch.loop.probe_rig import ProbeRig
from itouch.loop.run_statistics import RunStatistics
from itouch.plugin import Record, Role
from itouch.safety import LOSSES, DeviceFaultError, Outcome, SafeSequence, TrackedFinger, Trip
from itouch.schema.diagnostics import named
from itouch.world import Model


class SafeShutdown:
    """Carries out the safe sequence of one engine, and notes faults in its statistics."""

    def __init__(
        self, model: Model, state: Record, runners: Sequence[Runner], rigs: Sequence[ProbeRig],
        statistics: RunStatistics, injected: Callable[..., list[dict[str, Any]]],
    ) -> None:  # fmt: skip
        self._model, self._runners, self._rigs, self._statistics = model, runners, rigs, statistics
        self._tick, self._injected = state["tick"], injected
        self._sequence = SafeSequence(
            [one.gate for one in runners], state, model.period, self._move, _tracked_fingers(rigs)
        )
        needed = {rig.tracker.model.name for rig in rigs}
        for runner in runners:
            if runner.model.optional and runner.model.name not in needed:
                runner.gate.on_loss = self._lost

    def carry_out(
        self, fault: DeviceFaultError, taps: Sequence[Callable[[int], None]], clock: Clock | None = None
    ) -> None:
        """Make every device safe; ``taps`` are called after each tick that this takes, ``clock`` paces the ticks.

        What a tap raises, or Ctrl-C, is held back until all is safe: an ``Exception`` then becomes a note of the fault,
        anything else is raised.

        Raises
        ------
        BaseException
            What was raised meanwhile and is no ``Exception``.
        """
        entry = self._describe(fault)
        self._statistics.faults.append(entry)
        outcome = self._sequence.carry_out(fault, self._after_tick(taps, clock))
        if outcome.also:
            entry["also"] = outcome.also
        entry["safe"] = {"reached": outcome.safe, "after_s": outcome.seconds, "devices": outcome.devices}
        if unsafe := self.unsafe(outcome):
            entry["safe"]["unsafe"] = unsafe
        error = self._sequence.interrupted
        if isinstance(error, Exception):
            fault.add_note(f"while all was made safe: {named(error)}")
        elif error is not None:
            raise error

    def wind_down(self, taps: Sequence[Callable[[int], None]], clock: Clock | None = None) -> Outcome:
        """Make every device safe in the same order, without a fault: because a session ends or pauses.

        Raises
        ------
        BaseException
            What a tap, or Ctrl-C, has raised meanwhile; all has been made safe before.
        """
        nothing = DeviceFaultError("", self._tick.item(), Trip.NONE, "ends")
        outcome = self._sequence.carry_out(nothing, self._after_tick(taps, clock))
        if self._sequence.interrupted is not None:
            raise self._sequence.interrupted
        return outcome

    def unsafe(self, outcome: Outcome) -> list[str]:
        """Return what could not be seen to be safe, without closed devices and optional ones that are lost."""
        absent = [
            one.model.name for one in self._runners
            if one.latch.status is Status.CLOSED or (one.model.optional and one.latch.trip in LOSSES)
        ]  # fmt: skip
        return [name for name in outcome.unsafe if name not in absent]

    def _after_tick(self, taps: Sequence[Callable[[int], None]], clock: Clock | None) -> Callable[[], None]:
        if clock is not None:
            clock.start(self._model.period)  # lateness from before is not counted as time that the sequence takes

        def after_tick() -> None:
            with contextlib.ExitStack() as stack:  # every tap is called, and time goes on, whatever one of them raises
                if clock is not None:
                    stack.callback(self._pace, clock)
                for tap in reversed(taps):
                    stack.callback(tap, self._tick.item() - 1)

        return after_tick

    def _pace(self, clock: Clock) -> None:
        """Wait for the next tick; periods that were missed are left out.

        A burst of ticks that catches up would ask a surface for many steps at once, and judge it by what it did in
        almost no time.
        """
        period = self._model.period
        late = round(clock.wait() / period)
        if late:
            clock.start(period)
            self._sequence.leave_out(late)
            for runner in self._runners:
                runner.gate.device_monitors.leave_out(late)

    def _move(self) -> None:
        for rig in self._rigs:
            rig.couple(False)
        for runner in self._runners:
            with contextlib.suppress(DeviceFaultError):  # a twin that can't be simulated does not stop the others
                runner.step_twin(self._tick.item())

    def _lost(self, fault: DeviceFaultError) -> None:
        """Note the loss of an optional device; the session goes on without it."""
        self._statistics.faults.append({**self._describe(fault), "optional": True})

    def _describe(self, fault: DeviceFaultError) -> dict[str, Any]:
        scene = self._model.scene
        place = scene.places.of(scene.device(fault.device))
        entry: dict[str, Any] = {
            "device": fault.device,
            "tick": fault.tick,
            "time_s": fault.tick * self._model.period,
            "trip": fault.trip.label,
            "cause": fault.cause,
            "scene": str(place) if place else None,
        }
        injected = self._injected(lately=True)
        if injected:
            entry["injected"] = [{key: one[key] for key in ("device", "kind", "scene")} for one in injected]
        return entry


def _tracked_fingers(rigs: Sequence[ProbeRig]) -> dict[str, list[TrackedFinger]]:
    """Return the trackers of the fingers over each table, by the table's name.

    One that is the table itself, or is carried by a device, tells nothing of its own and is left out.
    """
    found: dict[str, list[TrackedFinger]] = {}
    for rig in rigs:
        if rig.table is not None and rig.tracker is not rig.table and not rig.tracker.model.carrier:
            found.setdefault(rig.table.model.name, []).append(
                TrackedFinger(rig.tracker.gate, partial(_finger_over, rig, rig.table))
            )
    return found


def _finger_over(rig: ProbeRig, table: Runner) -> float:
    """Return the height [m] of a tracked finger in the frame of a table, along the axis in which the table lifts."""
    tracked = rig.tracker.read_as(Role.TRACKED_POSE)[:3].tolist()
    return rig.frame_of(table).into(rig.frame_of(rig.tracker).point(tracked))[2]
