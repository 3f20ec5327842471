"""Pacing of the loop: when the next tick begins, when the run is over, what follows an overrun or left-out time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from itouch.loop.clock import asleep, now, processor_time
from itouch.loop.device_runner import DeviceFaultError, Runner
from itouch.loop.engine_view import Running
from itouch.loop.events import Events
from itouch.loop.probe_rig import ProbeRig
from itouch.platforms import waits
from itouch.safety import Trip
from itouch.schema.quantities import checked_time

#: From how many periods on the loop is too late to catch up: with servo-overrun="stop" the run ends, else it goes on
#: from now.
HOPELESS = 20
#: For how long [s] the machine must have been suspended for that to count: two clocks tell it, not read at once.
SLEPT = 0.2
#: For how long [s] hardware may be left unattended by a loop before it is stopped whatever servo-overrun says: W2.
UNATTENDED = 0.2
#: How many ticks may be run at once where nothing is paced: so many that calling them costs little, and so few that a
#: run which is asked to stop ends at once.
TOGETHER = 16

#: Left-out time [s] from which on a finger's velocity is taken to be unknown; for less it is taken to go on.
MOVES_ON = 0.05


class Pacing:
    """Runs one engine on its clock."""

    def __init__(self, engine: Running) -> None:
        self._engine = engine
        #: Whether the run that is under way has been asked to end.
        self.stopping = False
        #: For how long [s] the machine had been suspended by the last check.
        self._slept = asleep()
        #: Host time spent running [s].
        self.wall = 0.0
        #: Ticks of these runs; a session that was restored has had others before.
        self.ticks = 0

    def stop(self) -> None:
        """End the current run after its tick, or after those that run at once; may be called from a signal handler."""
        self.stopping = True

    def run(
        self,
        seconds: float | None,
        until: Callable[[], bool] | None,
        each: Callable[[], None] | None,
        every: int,
    ) -> None:
        """Run as ``Engine.run`` says."""
        engine = self._engine
        last = engine.ticks + round(seconds / engine.model.period) if seconds is not None else None
        if engine.clock.pace == "real" and engine.stamps[-1] > 0.0:  # hardware has gone on since another run, or a stop
            engine.leave_out(engine.since)
        for runner in engine.runners:
            runner.gate.acquisition.timed = engine.clock.pace == "real" and not runner.model.twin
        engine.clock.start(engine.model.period)
        begin, first = now(), engine.ticks
        try:
            self._loop(last, until, each, every)
        finally:
            self.wall += now() - begin
            self.ticks += engine.ticks - first
            self.stopping = False

    def check(self, seconds: float | None, until: Callable[[], bool] | None) -> None:
        """Check the arguments of a run.

        Raises
        ------
        ValueError
            If the time is not a number from 0 to `LONGEST`, or there is neither a time nor a scripted motion.
        """
        if seconds is not None:
            checked_time("seconds", seconds)
        if seconds is None and until is None and not self._engine.scripted:
            raise ValueError("the scene has no scripted motion: say for how many seconds to run")

    def _loop(
        self, last: int | None, until: Callable[[], bool] | None, each: Callable[[], None] | None, every: int
    ) -> None:
        engine = self._engine
        real, scripted = engine.clock.pace == "real", last is None and until is None
        tick, count, begin, waited = engine.ticks, 0, 0.0, 0
        while not self.stopping and (last is None or tick < last):
            if scripted and engine.done:
                return
            late = engine.times.late = engine.clock.wait() if real else 0.0
            if late > HOPELESS * engine.model.period:  # more than a period has passed since the last reading
                engine.leave_out(late, running=True)
            if real:
                self._mind_absence(late)
                begin, waited = processor_time(), waits()
            if real or until is not None:
                engine.tick()
                passed = 1
            else:
                most = TOGETHER if last is None else min(TOGETHER, last - tick)
                most = min(most, engine.left) if scripted else most
                before = engine.ticks  # not ``tick``: what is called between ticks may make all safe, which takes some
                engine.advance(most if each is None else max(1, min(most, every - count)))
                passed = engine.ticks - before
            tick += passed
            if each is not None:
                count += passed
                if count >= every:
                    count = 0
                    each()
            over = until is not None and until()
            if real:
                self._watch_pace(late, begin, waited)
            if over:
                return

    def _mind_absence(self, late: float) -> None:
        """Stop hardware if it was left to itself for too long, because the machine or this process was suspended.

        The guardian sees that a process is suspended, but not if it has been, too (a frozen container, a virtual
        machine that pauses).  That the machine slept shows neither in how late a tick is nor in the age of a reading.

        Parameters
        ----------
        late
            How late the tick that comes next begins [s].

        Raises
        ------
        DeviceFaultError
            If hardware is enabled and was left to itself.
        """
        engine, before = self._engine, self._slept
        self._slept = asleep()
        slept = self._slept - before
        hardware = [runner for runner in engine.runners if not runner.model.twin]
        if slept > SLEPT:
            cause = f"was stopped: this machine has slept for {slept:.0f} s while devices were enabled"
            for runner in hardware:
                runner.gate.device_monitors.leave_out(round(slept / engine.model.period))
        elif late > UNATTENDED:
            cause = f"was stopped: the loop stood still for {late:.1f} s while devices were enabled"
        else:
            return
        acting = [runner.model.name for runner in hardware if runner.latch.enabled]
        if acting:
            fault = DeviceFaultError(acting[0], engine.ticks, Trip.OVERRUN, cause)
            engine.make_safe(fault)
            raise fault

    def _watch_pace(self, late: float, begin: float, waited: int) -> None:
        """Record a tick's timing, and what an overrun asks for.

        ``late``: how late it began [s]; ``begin`` [s] and ``waited``: processor time of the thread, and how often it
        had waited by itself, when it began.

        Raises
        ------
        DeviceFaultError
            If the loop cannot keep up while devices are enabled, and servo-overrun="stop".
        """
        engine = self._engine
        culprit = engine.times.pace(
            late, engine.model.period, engine.stamps, engine.ticks - 1, end=now(), busy=processor_time() - begin,
            waited=waits() > waited,
        )  # fmt: skip
        if culprit is None:
            return
        stops = engine.model.scene.safety.servo_overrun == "stop"
        if stops and late > HOPELESS * engine.model.period and any(runner.latch.enabled for runner in engine.runners):
            cause = f"was {late * 1e3:.1f} ms late: the servo loop cannot keep up ({culprit})"
            fault = DeviceFaultError(next(iter(engine.model.devices)), engine.ticks, Trip.OVERRUN, cause)
            engine.make_safe(fault)
            raise fault
        if late > HOPELESS * engine.model.period:  # a burst of ticks would not make up for what was missed
            engine.times.skip(round(late / engine.model.period))
            engine.clock.start(engine.model.period)


def leave_out(
    period: float, runners: Sequence[Runner], rigs: Sequence[ProbeRig], events: Events, seconds: float, tick: int,
    running: bool,
) -> int:  # fmt: skip
    """Count left-out time in the monitors of devices, and tell contact_steps and modalities of it.

    Touchers and modalities are told only with hardware in the rig: no finger's velocity is taken across the gap then.

    Parameters
    ----------
    period
        Of a tick [s].
    runners, rigs, events
        The devices and probes of the engine, and what calls its modalities.
    seconds, tick
        How long it was [s], and the tick that comes next.
    running
        Whether a loop that was late has left it out: then the monitors of twins count it as well.

    Returns
    -------
    int
        How many periods were left out; 0: it was at most one, and nothing has changed.

    Raises
    ------
    DeviceFaultError
        If a modality fails.
    """
    periods = round(seconds / period)
    if periods <= 1:
        return 0
    for runner in runners:
        if running or not runner.model.twin:
            runner.gate.device_monitors.leave_out(periods)
    if any(not runner.model.twin for runner in runners):
        for rig in rigs:
            rig.contact_step.settle(moves=periods * period < MOVES_ON)
        events.left_out(periods * period, tick)
    return periods
