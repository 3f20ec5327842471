"""The engine: everything that a scene asks for, put together, and one servo tick of it.

The order of a tick is fixed, and stands in ``itouch.loop.plan``: all reads, contact, events, modalities, safety, all
writes, then the twins move on.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from threading import get_ident
from types import TracebackType
from typing import Any

import numpy as np

from itouch.faults import FOREVER, Injection, Kind
from itouch.joining import runner as as_one_call
from itouch.loop import builtins_guard
from itouch.loop.clock import Clock, VirtualClock, now
from itouch.loop.compiled_listener import CompiledListener
from itouch.loop.device_runner import DeviceFaultError, Runner, Status
from itouch.loop.engine_view import Notifications, tell
from itouch.loop.events import Events
from itouch.loop.fault_attribution import before_touch_off, broken_off, changed_python, with_replaced, with_writer
from itouch.loop.fingers import join_fingers
from itouch.loop.moving_objects import Objects
from itouch.loop.operator_commands import LatchedError, OperatorCommands
from itouch.loop.pacing import Pacing, leave_out
from itouch.loop.plan import PYTHON, STOPPED, TOLD, Plan, advance, build
from itouch.loop.probe_rig import ProbeRig
from itouch.loop.release import in_turn, raise_unless_failing, released
from itouch.loop.run_statistics import RunStatistics
from itouch.loop.safe_shutdown import SafeShutdown
from itouch.loop.timing import Timing
from itouch.loop.warm_up import reset_modalities, warm_up
from itouch.loop.write_access import view_for
from itouch.plugin import Bound, Record
from itouch.safety import Outcome, Trip
from itouch.schema import ItouchError
from itouch.schema.plugin_errors import failing
from itouch.schema.quantities import checked_time
from itouch.schema.seeds import checked_seed
from itouch.world import Model, make_state
from itouch.world.bindings import blind
from itouch.world.limits import HOLD

#: On a virtual clock one tick in this many is timed step by step; in real time every tick is.
SAMPLED = 16
#: How often devices are told to be safe until that can be seen: a busy machine may not receive readings for a while.
PARKINGS = 4
_UNDER_WAY = (
    "this session is running already, in another thread or in the caller of this callback: "
    "run it from one thread, and end the run with stop()"
)


class EngineError(ItouchError):
    """A call that the engine's status does not allow."""


class Engine:
    """Runs a compiled scene.

    ``state`` is the one record of everything that changes; ``tick`` and ``run`` advance it.  If all devices are twins
    they enable these by themselves; with hardware in the rig they raise until ``enable`` has been called.
    """

    def __init__(self, model: Model, *, seed: int = 0, clock: Clock | None = None) -> None:
        seed = checked_seed(seed)
        self.model, self.clock, self._moving = model, clock or VirtualClock(), model.moving
        self.state: Record = make_state(model)
        self.statistics = RunStatistics()
        self._runners = {name: Runner(device, self.state, model.period) for name, device in model.devices.items()}
        self._rigs = [ProbeRig(model, probe, self.state, self._runners, self.statistics) for probe in model.probes]
        join_fingers(self._rigs)
        for name, why in blind(model.scene, model.devices).items():
            self._runners[name].lifecycle.blind = why
        self._all = list(self._runners.values())
        self._twins = [runner for runner in self._all if runner.gate.device is None]
        self._objects = Objects(model, self.state, self._runners, [rig.contact_step for rig in self._rigs])
        self._hands = [rig.coupling.hand for rig in self._rigs if rig.coupling.hand is not None]
        #: Length of the longest motion of an operator twin [s], 0: none; and whether anything follows a script.
        self._length = max((device.duration for device in model.devices.values()), default=0.0)
        self.scripted = (
            any(hand.path.duration > 0 for hand in self._hands) or self._objects.scripted or self._length > 0
        )
        self._tick, self._ready = self.state["tick"], self.state["ready"]
        views = {one.name: view_for(one, self.state) for one in model.modalities}
        self._events = Events(model, self.state, self._rigs, views, self.statistics)
        self._operator = OperatorCommands(model, self.state, self._runners, self._rigs, self.statistics)
        self._safe_shutdown = SafeShutdown(
            model, self.state, self._all, self._rigs, self.statistics, self._operator.injected
        )
        #: What a tick consists of, and how long each step has taken.
        self.plan: Plan = build(
            model,
            self.state,
            self._runners,
            self._rigs,
            self._objects,
            self._events,
            self._operator.hold,
            views,
            self.statistics.tracking.bins,
        )
        self.times = self.statistics.times = Timing(self.plan.names)
        self.fault: DeviceFaultError | None = None
        self._enabled = False
        #: Whether a State was adopted in the middle of a safe sequence, which must be carried out anew.
        self._unfinished = False
        self._pacing = Pacing(self)
        #: When somebody last said whether the dead-man's switch is held [host s].
        self._told = 0.0
        #: Whether a guardian is known to make hardware safe if this process dies (`itouch.launch`).
        self.guarded = False
        #: Host seconds at the start of the last tick, after its steps if they were timed, and at its end.
        self.stamps = np.zeros(1 + max(1, len(self.plan.steps)))
        #: The thread in which a run is under way, 0: none; and whether a tick is under way.
        self._runs_in, self._ticking = 0, False
        #: Event listeners; and tick listeners, kept apart because they are called most.
        self.on = Notifications()
        self.taps: list[Callable[[int], None]] = self.on.tick
        self._operator.waiting = partial(tell, self.on.waiting)
        #: What was done to a session otherwise than its scene says; beside what its model says of itself.
        self.notes: tuple[str, ...] = ()
        #: Where the plan has stopped in a tick that compiled code began, and how many ticks that may run: (1,) each.
        self._left, self._most = np.zeros(1, np.int64), np.ones(1, np.int64)
        #: The listener that such a tick calls, and where its chain stands; None, 0: Python calls all listeners.
        self._joined: CompiledListener | None = None
        self._listener = np.zeros(1, np.int64)
        self._advance = self._joined_tick()
        self.state["seed"] = seed
        self._reset(seed)
        warm_up(model, self.state, self._all)

    def _joined_tick(self) -> Callable[[], int] | None:
        """Return the call that runs whole ticks, None if the plan is no single chain.

        The call returns -1 if they are done, else PYTHON or STOPPED.
        """
        chain = self.plan.whole
        if chain is None:
            return None
        memory = (self.stamps, *self.times.views, self._left, self._listener)
        return as_one_call((Bound(advance, chain.place, self._most, self._tick, self._ready, SAMPLED, *memory),))

    def _reset(self, seed: int) -> None:
        self.state["objects.pose"] = self.model.poses
        self._objects.reset()
        for runner in self._all:
            name = runner.model.name
            with failing(f"device '{name}'", "the reset of its twin", self.model.place_of(name)):
                runner.start(seed)
        for rig in self._rigs:
            rig.reset()
        for runner in self._all:
            if runner.model.twin:
                runner.lifecycle.open()
        reset_modalities(self.model, self.state)

    @property
    def scene(self) -> Any:
        """The scene that runs."""
        return self.model.scene

    @property
    def seconds(self) -> float:
        """Simulated time [s]."""
        return int(self._tick) * self.model.period

    @property
    def ticks(self) -> int:
        """How many ticks have been run since the start of the session."""
        return int(self._tick.item())

    @property
    def wall(self) -> float:
        """Host time spent running [s]."""
        return self._pacing.wall

    @property
    def _paced(self) -> bool:
        return self.clock.pace == "real"

    @property
    def notices(self) -> tuple[str, ...]:
        """What is rendered otherwise than the scene says, and why, and what was done to restore it."""
        return (*self.model.notices, *self.notes)

    @property
    def done(self) -> bool:
        """Whether every scripted motion has ended; never true without one."""
        over = self._length <= 0.0 or self.seconds >= self._length
        return self.scripted and over and self._objects.done and all(hand.done for hand in self._hands)

    @property
    def left(self) -> int:
        """In how many ticks, at the earliest, every scripted motion has ended; at least 1."""
        return max((1, *(hand.left for hand in self._hands)))

    @property
    def runners(self) -> tuple[Runner, ...]:
        """The devices, in the order of the scene."""
        return tuple(self._all)

    @property
    def held(self) -> bool:
        """Whether somebody holds the dead-man's switch, or none is needed."""
        hold = self._operator.hold
        return not hold.required or hold.held(self.ticks)

    @property
    def since(self) -> float:
        """Host seconds since the last tick ended."""
        return now() - float(self.stamps[-1])

    def leave_out(self, seconds: float, *, running: bool = False) -> int:
        """Account for time that no tick stands for, see `pacing.leave_out`; return how many periods that is.

        Parameters
        ----------
        seconds
            For how long nobody has read the hardware [s].
        running
            Whether a loop that was late leaves it out: then the monitors of twins count it as well.

        Raises
        ------
        DeviceFaultError
            If a modality fails; all devices have been made safe.
        """
        try:
            periods = leave_out(self.model.period, self._all, self._rigs, self._events, seconds, self.ticks, running)
        except DeviceFaultError as fault:
            self.make_safe(fault)
            raise
        if periods:
            for listener in tuple(self.on.left_out):
                listener(seconds, running)
        return periods

    def status(self, device: str) -> Status:
        """Return what a device may do now."""
        return self._runners[device].latch.status

    def enable(self, *, opens: bool = True) -> None:
        """Open and enable every device; all that fail are reported together.

        Twins that are enabled already, as after a restore, are left alone: an extra reading would change the run.

        Parameters
        ----------
        opens
            Whether those that are CLOSED are opened, too; else they stay as they are.

        Raises
        ------
        LatchedError
            If a trip is latched, as in a session that was saved after it: ``rearm`` releases it, or says why not.
        DeviceError
            Naming each device that failed and why; nothing is left enabled.
        """
        if self._enabled and all(device.twin and not device.remote for device in self.model.devices.values()):
            return
        tell(self.on.act)
        try:
            self._operator.enable(opens=opens)
        except LatchedError:
            raise
        except BaseException:  # Ctrl-C, too: what was opened until then is not to stay open
            self.close()
            raise
        self._enabled = True
        self.settle()
        self._tell_outside("enable")

    def settle(self, *, always: bool = False) -> None:
        """Begin anew from where hardware is, which may have moved since the last tick; ``always``: also on twins."""
        if always or any(not device.twin for device in self.model.devices.values()):
            for rig in self._rigs:
                rig.contact_step.settle()

    def _tell_outside(self, reason: str) -> None:
        for listener in tuple(self.on.outside):
            listener(reason)

    def latched(self) -> DeviceFaultError | None:
        """Return the latched trip that keeps hardware from being enabled, as the fault that it was, or None."""
        return next(iter(self._operator.latched_faults()), None)

    def _require_enabled(self) -> None:
        if self._enabled:
            return
        hardware = [runner.model.name for runner in self._all if not runner.model.twin]
        if hardware:
            listed = ", ".join(f"'{name}'" for name in hardware)
            raise EngineError(f"call engine.enable() first: {listed} will move or heat for real")
        self.enable()

    def tick(self) -> None:
        """Advance by one servo period.

        Raises
        ------
        DeviceFaultError
            If a device failed; all devices have been made safe.
        EngineError
            If hardware is in the rig and ``enable`` was not called, or a tick is under way: one thread runs a session.
        """
        if self._ticking or self._runs_in not in (0, get_ident()):
            raise EngineError(_UNDER_WAY)
        try:
            self._ticking = True  # in here: Ctrl-C may come between any two lines
            self._run_tick()
        finally:
            self._ticking = False

    def advance(self, most: int) -> None:
        """Advance by at least one servo period, and by up to ``most`` where Python is told of no tick, as `tick`."""
        if not self.taps or (len(self.taps) == 1 and self._joined_listener is not None):
            self._most[0] = most
        try:
            self.tick()
        finally:
            self._most[0] = 1

    def _run_tick(self) -> None:
        if not self._enabled:
            self._require_enabled()
        if self._unfinished:
            self._finish_stop()
        paced = self.clock.pace == "real"  # then every part of every tick is timed
        found, failure, joined = PYTHON, None, self._joined_listener if self.taps else None
        if not paced and self._advance is not None:
            if joined is not self._joined:
                self._joined = joined
                self._listener[0] = 0 if joined is None else joined.place
            try:
                found = self._advance()
            except Exception as error:  # a plugin's compiled function has raised it
                found, failure = STOPPED, error
        if found < 0 or found == TOLD:  # none of these ticks is one that is timed step by step
            heard = joined
            if not self._ready:
                heard = None
                self._begin_when_ready()
            if self._events.making is not None:
                self._go_on_with_entry(self._tick.item() - 1)
            if self.taps and (found == TOLD or heard is None or len(self.taps) > 1):
                self._tell(self._tick.item() - 1, heard, self._left.item() if found == TOLD else -1)
            return
        tick, ready, stamps = self._tick.item(), bool(self._ready), self.stamps
        stopped = found == STOPPED
        timed = bool(self.plan.steps) and not stopped and (paced or not tick % SAMPLED)
        if not stopped:
            stamps[0] = now()
        try:
            if failure is not None:
                self.plan.go_on_after(failure, tick, ready)
            elif stopped:
                self.plan.go_on(self._left[0].item(), tick, ready)
            elif timed:
                self.plan.run_timed(tick, ready, stamps)
            else:
                self.plan.run(tick, ready)
            if not tick % SAMPLED and builtins_guard.changed():
                raise changed_python(self.model, tick, builtins_guard.put_back())
            if not ready or not tick % SAMPLED or self._events.making is not None:
                joined = None  # something is done before listeners hear of the tick
            found = self._end_tick(tick, ready, timed, joined)
        except DeviceFaultError as raised:
            replaced = builtins_guard.put_back()  # before anything else: what follows is Python
            fault = before_touch_off(self.model, self.state, with_writer(self.model, self.state, raised))
            fault = with_replaced(fault, replaced)
            self.make_safe(fault)
            raise fault from raised.__cause__
        except builtins_guard.ANY_ERROR as raised:  # Ctrl-C in the middle of it, or an error of the loop's own
            replaced = builtins_guard.put_back()
            if self._all:
                self.make_safe(fault := broken_off(self.model, tick, raised, replaced))
                if replaced and isinstance(raised, Exception):  # no mistake of the loop's own
                    raise fault from raised
            raise
        if self._events.making is not None:
            self._go_on_with_entry(tick)
        if not tick % SAMPLED:
            self._look_round(tick)
        if self.taps:
            self._tell(tick, joined if timed else None, found)

    def _look_round(self, tick: int) -> None:
        """Do what is not done in every tick: begin the entry of a contact that has ended, and check the twins.

        Stop if something has written over a twin's status; the status of hardware is checked before each command.

        Raises
        ------
        DeviceFaultError
            If so.
        """
        self._events.begin_entry(tick)  # its parts are made in the next ticks, which are not timed step by step
        for runner in self._twins:
            if forged := runner.latch.forged():
                cause = f"was stopped: {forged}"
                self.make_safe(fault := DeviceFaultError(runner.model.name, tick, Trip.MODALITY_ERROR, cause))
                raise fault

    def _go_on_with_entry(self, tick: int) -> None:
        """Make the next part of the report's entry of a contact that has ended."""
        try:
            self._events.go_on_with_entry()
        except builtins_guard.ANY_ERROR as raised:  # Ctrl-C while a modality is asked what it has measured
            replaced = builtins_guard.put_back()
            if self._all:
                self.make_safe(broken_off(self.model, tick, raised, replaced))
            raise

    def _end_tick(self, tick: int, ready: bool, timed: bool, joined: CompiledListener | None) -> int:
        """Count a tick whose steps are done, and the time that it took.

        Of a tick that is timed step by step a ``joined`` listener hears at once; return what it leaves, as `run_chain`.
        """
        stamps = self.stamps
        if not ready:
            self._begin_when_ready()
        self._tick[...] = tick + 1
        if timed:
            return self.times.add(stamps, 0 if joined is None else joined.place)
        stamps[-1] = now()
        self.times.add_whole(stamps[-1].item() - stamps[0].item())
        return -1

    def _begin_when_ready(self) -> None:
        """Let scripts begin with the next tick if every rig is calibrated."""
        if all(rig.ready for rig in self._rigs):
            self._ready[...] = 1

    @property
    def _joined_listener(self) -> CompiledListener | None:
        """The listener of ticks that compiled code tells of them, None: Python tells them all."""
        for tap in self.taps:
            if isinstance(tap, CompiledListener) and tap.place:
                return tap
        return None

    def _tell(self, tick: int, heard: CompiledListener | None = None, left: int = -1) -> None:
        """Call the taps; hardware is made safe if one raises, for the caller of ``tick`` may never call it again.

        ``heard``: the one that has heard of the tick in compiled code, and what it has ``left`` to Python, as of
        `run_chain`.
        """
        taps, at = self.taps, 0
        try:
            while at < len(taps):
                tap = taps[at]
                if tap is not heard:
                    tap(tick)
                elif left >= 0:
                    heard.go_on(left, tick)
                if at < len(taps) and taps[at] is tap:  # else it has left, as a recorder that fails
                    at += 1
        except BaseException:
            self._park_hardware()
            raise

    def _park_hardware(self) -> None:
        """Make everything safe if hardware is enabled and no fault has done so already."""
        if self.fault is None and any(runner.latch.enabled and not runner.model.twin for runner in self._all):
            self.park()

    def _finish_stop(self) -> None:
        """Carry out anew the safe sequence in whose middle State was stored: nothing has minded the surfaces since.

        Raises
        ------
        DeviceFaultError
            The fault for which all was stopped, if it was one.
        """
        self._unfinished = False
        stopped = sorted(
            (one for one in self._all if one.latch.status is Status.FAULT), key=lambda one: one.latch.tripped
        )
        if not stopped:
            self.park()
            return
        first = stopped[0]
        cause = f"was stopped by {first.latch.trip.label}"
        self.make_safe(fault := DeviceFaultError(first.model.name, first.latch.tripped, first.latch.trip, cause))
        raise fault

    def _move(self, tick: int, ready: bool) -> None:
        for rig in self._rigs:
            rig.couple(ready)
        if self._moving:
            self._objects.advance(ready)
        for runner in self._all:
            runner.step_twin(tick)

    def step_twins(self, moving: bool) -> None:
        """Advance only the simulated world by one period, under the commands that its devices were sent last."""
        self._move(self.ticks, moving)
        self._tick[...] = int(self._tick) + 1

    def make_safe(self, fault: DeviceFaultError) -> None:
        """Make every device safe because of a fault, and note it; before that, the listeners hear of it.

        What a listener raises, or Ctrl-C, is held back until all is safe: an ``Exception`` then becomes a note of the
        fault, anything else is raised.

        Raises
        ------
        BaseException
            What was raised meanwhile and is no ``Exception``.
        """
        failed = self.on.tell_fault(fault)
        self.fault = fault
        try:
            self._safe_shutdown.carry_out(fault, self.taps, self.clock if self._paced else None)
            self.stamps[-1] = now()
        finally:
            tell(self.on.safe)
        if isinstance(failed, Exception):
            fault.add_note(f"while it was reported: {type(failed).__name__}: {failed}")
        elif failed is not None:
            raise failed

    def rearm(self) -> None:
        """Release every latched trip, and enable the devices again from where they stand, with a ramp.

        Raises
        ------
        DeviceError
            With everything that still stands in the way; nothing is enabled then.
        """
        tell(self.on.act)
        restored = not self._enabled and bool(self._operator.latched)
        self._operator.rearm()
        self.fault, self._unfinished, self.state["stopping"][...] = None, False, 0
        if restored:  # nothing else has been enabled yet
            self.enable()
        self._tell_outside("rearm")

    def reconnect(self, device: str) -> None:
        """Close a device and open it anew; commands flow to it after ``rearm``.

        Raises
        ------
        DeviceError
            If it is missing or refuses.
        """
        try:
            self._operator.reconnect(device)
        finally:
            self._tell_outside("reconnect")

    def begin_reconnect(self, device: str) -> None:
        """Begin what `reconnect` does, for a loop that has to go on: `reconnected` then tells when it is done.

        The device is made safe at once, is closed and opened in a thread, and takes part in no tick meanwhile.

        Raises
        ------
        DeviceError
            If there is none of that name, it is being opened already, or ticks that enable other devices need it.
        """
        self._operator.spare(device)
        self._operator.begin_reconnect(device)
        self._tell_outside("reconnect")

    def reconnected(self, device: str) -> bool:
        """Take the result of `begin_reconnect` once there is one; tell whether there was.

        Raises
        ------
        DeviceError
            If the device is missing or refuses, or has taken too long.
        """
        if not self._operator.reconnected(device):
            return False
        try:
            self._operator.finish_reconnect(device)
        finally:
            self._tell_outside("reconnect")
        return True

    def hold(self, held: bool = True, *, shared: bool = False) -> None:
        """Report that somebody holds the dead-man's switch or, with ``held`` false, has let it go.

        That it is held counts for 80 ms, so report it again and again.  Letting go stops all that acts, even if
        somebody else still holds the switch, which ``shared`` says.
        """
        self._told = now()
        self._operator.hold.press(self.ticks, held, shared=shared)

    def inject(
        self, device: str, kind: str, *, at: float | None = None, duration: float | None = None, channel: str = "",
        amount: float = math.nan, slot: int = 0,
    ) -> None:  # fmt: skip
        """Inject a fault into a device's twin, in place of one that the scene has for this device.

        Parameters
        ----------
        device, kind, channel
            As in ``<fault>``.
        at, duration
            Simulated seconds; default: now, and to the end.
        amount
            Of a bias, drift or spike, in the channel's SI unit; default: as big as usual.
        slot
            Which of the device's faults is replaced.

        Raises
        ------
        ValueError
            If there is no such slot, kind or channel, the kind has no amount, or the time is none of this session's.
        """
        for what, value in (("at", at), ("duration", duration)):
            if value is not None:
                checked_time(what, value)
        rate = self.model.scene.rates.servo
        begin = self.ticks if at is None else round(at * rate)
        end = FOREVER if duration is None else begin + max(1, round(duration * rate))
        self._operator.inject(device, slot, Injection(Kind.of(kind), begin, end, channel, amount))

    @property
    def injected(self) -> list[dict[str, Any]]:
        """The injected faults that have begun, as they stand in the report."""
        return self._operator.injected()

    def run(
        self,
        seconds: float | None = None,
        *,
        until: Callable[[], bool] | None = None,
        each: Callable[[], None] | None = None,
        every: int = 1,
    ) -> None:
        """Run for a time, or until the scripted motion ends.

        Parameters
        ----------
        seconds
            Simulated seconds; None: until the scripted motion has ended.
        until
            Asked after every tick; true ends the run.
        each, every
            Called after every so many ticks, for progress; it must not change the State.

        Raises
        ------
        ValueError
            If there is neither a time nor a scripted motion.
        DeviceFaultError
            If a device failed; all devices have been made safe.
        EngineError
            If hardware is in the rig and ``enable`` was not called, or a run is under way in another thread.
        """
        self._pacing.check(seconds, until)
        if self._runs_in or self._ticking:
            raise EngineError(_UNDER_WAY)
        tell(self.on.begin)
        try:
            self._runs_in = get_ident()
            self._run(seconds, until, each, every)
        finally:
            self._runs_in = 0

    def _run(
        self, seconds: float | None, until: Callable[[], bool] | None, each: Callable[[], None] | None, every: int
    ) -> None:
        self._require_enabled()
        if self._paced and now() - self._told > HOLD and self._operator.hold.word(self.ticks):
            self._operator.hold.press(self.ticks, False)  # it was held before a pause, in which no ticks have run
        try:
            self._pacing.run(seconds, until, each, every)
        except builtins_guard.ANY_ERROR as raised:  # nothing paces the hardware any more
            replaced = builtins_guard.put_back()
            if replaced and self.fault is None and self._all and isinstance(raised, Exception):
                self.make_safe(fault := broken_off(self.model, self.ticks, raised, replaced))
                raise fault from raised
            self._park_hardware()
            raise

    @property
    def stopping(self) -> bool:
        """Whether the run that is under way has been asked to end."""
        return self._pacing.stopping

    def stop(self) -> None:
        """Ask the run that is under way to end after the current tick; may be called from a signal handler.

        On a virtual clock, ticks of which none but a recorder is told run up to 16 at once: it ends after these.
        """
        self._pacing.stop()

    @property
    def steerable(self) -> tuple[str, ...]:
        """The probes that an operator twin moves; behind a real arm a person does, whatever the scene's script says."""
        return tuple(rig.probe.name for rig in self._rigs if rig.coupling.hand is not None)

    def steer(self, probe: str, step: tuple[float, float, float] | None) -> None:
        """Move the hand of an operator twin by a step [m] while its script waits; None gives it back to its script.

        Raises
        ------
        EngineError
            If the probe is not moved by an operator twin.
        ValueError
            If the step is not finite.
        """
        for rig in self._rigs:
            if rig.probe.name == probe and rig.coupling.hand is not None:
                rig.coupling.hand.steer(step)
                return
        raise EngineError(f"probe '{probe}' is not moved by an operator twin: it can't be steered from here")

    def park(self) -> Outcome:
        """Make every device safe as after a fault, in the rig's order, because the session ends or pauses.

        Returns
        -------
        Outcome
            Whether all could be seen to be safe, and what was seen of each device.
        """
        self._tell_outside("park")  # what follows is not a tick
        try:
            outcome = self._safe_shutdown.wind_down(self.taps, self.clock if self._paced else None)
            self.stamps[-1] = now()
        finally:
            tell(self.on.safe)
        return outcome

    def shut_down(self) -> None:
        """Make every device safe as `park` does, because the session ends; it is a fault if that can't be seen.

        Raises
        ------
        DeviceFaultError
            Naming the first hardware that could not be seen to be safe; it is noted, and all were told again.
        """
        for _ in range(PARKINGS):
            outcome = self.park()
            unsafe = [one for one in self._all if one.model.name in self.unsafe(outcome) and not one.model.twin]
            if not unsafe or any(one.latch.trip is not Trip.NONE for one in unsafe):
                break
        if not unsafe:
            return
        first = next((one for one in unsafe if one.latch.trip is not Trip.NONE), unsafe[0])
        others = "".join(f", nor could '{one.model.name}'" for one in unsafe if one is not first)
        why = first.gate.trouble or outcome.devices[first.model.name]
        cause = f"{why}; as the session ended it could not be seen to be safe{others}"
        trip = first.latch.trip if first.latch.trip is not Trip.NONE else Trip.DEVICE_ERROR
        self.make_safe(fault := DeviceFaultError(first.model.name, self._tick.item(), trip, cause))
        raise fault

    def unsafe(self, outcome: Outcome) -> list[str]:
        """Return what could not be seen to be safe, without closed devices and optional ones that are lost."""
        return self._safe_shutdown.unsafe(outcome)

    def close(self) -> None:
        """Make every device safe and release it, then tell all that listen to the end; the state stays readable.

        Raises
        ------
        DeviceError
            As `release` says; whoever listens has been told all the same.
        """
        in_turn(self.release, *self.on.closed)

    def release(self) -> None:
        """Make every device safe and release it: the session may go on with them later, and is told nothing.

        While another error is under way, what a device raises here becomes a note of that error.

        Raises
        ------
        DeviceFaultError, DeviceError
            Naming the first hardware that could not be seen to be safe, or raised anything when released; by then,
            all have been released.
        """
        hardware = [
            one for one in self._all
            if not one.model.twin and (one.latch.status is not Status.CLOSED or one.lifecycle.busy)
        ]  # fmt: skip
        hardware.sort(key=lambda one: one.lifecycle.busy)  # what is open need not wait for what still opens
        steps = [partial(released, runner) for runner in hardware]
        self._enabled = False
        if any(runner.latch.enabled for runner in hardware):
            raise_unless_failing(partial(in_turn, self.shut_down, *steps))
        else:
            raise_unless_failing(partial(in_turn, *steps))

    def __enter__(self) -> Engine:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def adopt(self, state: bytes) -> None:
        """Go on from the bytes of a stored State; twins keep their status, hardware starts OPEN.

        Raises
        ------
        ValueError
            If the size is not that of this model's State.
        """
        if len(state) != self.state.nbytes:
            raise ValueError(f"a state of {len(state)} bytes does not fit this scene's {self.state.nbytes}")
        self.state.raw[:] = np.frombuffer(state, np.uint8)
        hardware = [runner for runner in self._all if not runner.model.twin]
        for runner in hardware:
            self.state[f"{runner.model.name}.status"] = Status.CLOSED
        for runner in self._all:
            runner.latch.recall()
        if hardware:  # whoever held the switch when it was stored does not now
            self.state["hold"] = min(self.state["hold"].item(), self.ticks)
        begun = int(self._tick) > 0  # a session that has run is not enabled a second time
        self._enabled = not hardware and (begun or any(r.latch.status is Status.ENABLED for r in self._all))
        stopping = self.state["stopping"]
        stopping[...] = bool(stopping.item()) and len(hardware) < len(self._all)  # hardware is closed: it starts anew
        self._unfinished = bool(stopping.item())
        for runner in self._all:
            runner.gate.restore()
        self._operator.hold.recall(self.ticks)
        self._objects.restore()
        for rig in self._rigs:
            rig.restore()

    def stand_at(self, stored: bytes) -> None:
        """Take over a State with every status as stored, also of hardware; only for a replay, which opens nothing."""
        self.adopt(stored)
        self.state.raw[:] = np.frombuffer(stored, np.uint8)
        for runner in self._all:
            runner.latch.recall()
        self._enabled = True

    def report(self) -> dict[str, Any]:
        """Return the report; see ``itouch_tools.report`` for its keys."""
        from itouch.loop.summary import summary

        self._events.settle()  # the entry of an open contact depends on the one before it
        entries = [rig.log.entry(None) for rig in self._rigs if rig.log.open]
        return summary(self, entries, self._pacing.wall, self._pacing.ticks)
