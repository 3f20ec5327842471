"""``python -m itouch.servo.guardian``: makes the devices safe when the servo process can't, and tells what it did.

It watches the servo process's heartbeat.  If that stops for some periods, it asks the kernel whether the process is
dying or suspended (freeing the memory of a killed process alone can take 100 ms), and otherwise gives it 120 ms.  It
then sends the safe command over every connection that a second opener may have, and ends a servo process that hangs or
is suspended, so that it can't wake up and go on.  Where every device stays safe whatever the servo process sends, that
process first gets time to recover and tell the cause.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from itouch.gc_policy import keep_collections_rare
from itouch.servo import control_block as at
from itouch.servo import realtime, twin_protocol
from itouch.servo.guardian_link import OWN
from itouch.servo.shared_memory import SharedMemory, monotonic

#: How often [s] the guardian looks; how long [s] the servo process may be silent with devices that obey, and without.
LOOK, SILENCE, SILENCE_ALONE = 0.005, 0.12, 5.0
#: How long [s] it may be silent at its end, when all is safe: files are finished, and twins' processes end.
SILENCE_ENDING = 90.0
#: Silence [s] after which the kernel is asked.
DOUBT = 0.01
#: How long [s] the servo process may take to give a sign of life when the guardian itself did not run for longer than
#: ``SILENCE``: whatever held that up (a frozen container, a virtual machine that paused) held up both.
COMES_TO = 0.02
#: How long [s] the servo process may take until all is safe when its launcher is gone (files that it then still writes
#: are waited for as otherwise), and to be dead once it is killed.
ORPHAN_TIME, _DEAD = 3.0, 1.0

#: Makes one device safe.
Act = Callable[[], None]

#: How much processor time a silent process whose devices stay safe may use, how long it may idle, and how long it may
#: take in all [s].
SILENT_WORK, SILENT_WAIT, SILENT_MOST = 1.0, 0.5, 10.0
#: Positions of flags and processor times in a process's ``stat``, counted from its state letter.
_FLAGS, _USER, _SYSTEM = 6, 11, 12
#: The state letters of a process that no longer runs, and the flag of one that is ending.
_GONE, _EXITING = frozenset("TtZXx"), 0x4
_TICK: Final = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class Process:
    """What the kernel tells of a process: its state letter, whether it is ending, its processor time [s]."""

    letter: str
    ending: bool
    used: float

    @classmethod
    def of(cls, stat: str) -> Process:
        """Parse a line of ``/proc/PID/stat``."""
        words = stat.rpartition(")")[2].split()
        used = (int(words[_USER]) + int(words[_SYSTEM])) / _TICK
        return cls(words[0], bool(int(words[_FLAGS]) & _EXITING), used)

    @property
    def gone(self) -> bool:
        """Whether it is suspended or ending, so that it will do and tell nothing more."""
        return self.letter in _GONE or self.ending


class GracePeriod:
    """The grace period of a silent process: measures how long it has had, from now on, to tell the cause.

    A process that runs out of memory, or that others crowd out on a busy machine, is silent long before it knows the
    cause; killed at once, it would never tell.  Its processor time is what counts, so that it gets longer on a busy
    machine, and little if it waits for something that does not come.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began = self._worked = clock()
        self._first: float | None = None
        self._used = 0.0

    def over(self, process: Process) -> bool:
        """Tell whether the process has had its time, given its present state."""
        now = self._clock()
        if self._first is None:
            self._first = self._used = process.used
        if process.used > self._used or process.letter == "R":  # it works, or would if it had a processor
            self._used, self._worked = process.used, now
        spent = process.used - self._first > SILENT_WORK or now - self._worked > SILENT_WAIT
        return process.gone or spent or now - self._began > SILENT_MOST


class Guardian:
    """Watches one session."""

    #: When [ns] it looked again after it had not run for longer than ``SILENCE``.
    _back = 0

    def __init__(self, segment: SharedMemory, servo: int, owner: int) -> None:
        self._segment, self._words = segment, segment.words
        self._servo, self._owner = servo, owner
        self._acts: dict[str, Act] | None = None
        self._orphaned: float | None = None
        self._was_armed = False
        self._stat = -1  # it stays -1 if the servo process is gone already, which its file descriptor then tells
        with contextlib.suppress(OSError):
            self._stat = os.open(f"/proc/{servo_pid(servo)}/stat", os.O_RDONLY)
        self._why, self._said, self._stays_safe = "hung", "", False
        #: For how long [s] there was no heartbeat when that was noticed.
        self._silent = 0.0
        self._grace_period: GracePeriod | None = None
        self._looked = monotonic()
        #: Devices that the loop could not reach and the guardian has made safe, as in ``UNSENT``.
        self._helped = 0

    def watch(self) -> str:
        """Watch until the servo process has ended; return what had to be done, in words."""
        poller = select.poll()
        poller.register(self._servo, select.POLLIN)
        poller.register(self._owner, select.POLLIN)
        while True:
            ready = {handle for handle, _ in poller.poll(LOOK * 1e3)}
            self._note_absence()
            if self._servo in ready:
                return self._died()
            if self._owner in ready and self._orphaned is None:
                poller.unregister(self._owner)
                self._orphaned = time.monotonic()
                self._words[at.STOP] = 1
            self._prepare()
            self._was_armed = bool(self._words[at.ARMED])
            if self._grace_period is not None:
                if self._silent_for_good(self._grace_period):
                    return self._end_it()
            elif self._hangs() and not self._may_speak():
                return self._end_it()

    def _note_absence(self) -> None:
        """Note that it looks now, and whether it could not look for a while before."""
        before, self._looked = self._looked, monotonic()
        if self._looked - before > SILENCE * 1e9:
            self._back = self._looked

    def _prepare(self) -> None:
        """Open in advance what can be opened, so that only sending is left to do; from then on send heartbeats."""
        if self._acts is None and int(self._words[at.SIZE]):
            self._segment.map()
            self._acts = _acts(self._segment)
            # remote twins stay safe once made so; a driver's thread may still send while the loop hangs
            self._stays_safe = not self._segment.meta()["hardware"]
        if self._acts is not None:
            self._words[at.GUARDIAN_BEAT] = monotonic()
            self._help()

    def _help(self) -> None:
        """Make safe, once, each device that the loop could not write to; the loop may go on with the others."""
        unsent = int(self._words[at.UNSENT])
        new, self._helped = unsent & ~self._helped, unsent
        if not new:
            return
        acts = self._acts or {}
        for index, name in enumerate(self._segment.meta()["devices"]):
            if new >> index & 1 and name in acts:
                threading.Thread(target=_try, args=(acts[name],), daemon=True).start()

    def _hangs(self) -> bool:
        beat = int(self._words[at.BEAT])
        silent = (monotonic() - beat) * 1e-9
        self._silent = silent if beat else 0.0
        ends_in_order = self._segment.phase >= at.ENDING and not self._was_armed
        if self._orphaned is not None and time.monotonic() - self._orphaned > ORPHAN_TIME and not ends_in_order:
            return True
        if self._segment.phase < at.RUNNING and not self._was_armed:
            return False
        watched = (monotonic() - self._back) * 1e-9
        if watched <= COMES_TO:
            return False
        if self._was_armed and silent > DOUBT and self._gone():
            return True
        longest = SILENCE if self._was_armed else SILENCE_ENDING if ends_in_order else SILENCE_ALONE
        if silent <= longest or (not self._was_armed and watched <= longest):
            return False
        # between these two reads this process, too, may have waited for a processor: meanwhile the other one may have
        # sent a heartbeat, or disarmed because its devices are at rest, and only then have fallen silent
        return bool(self._words[at.ARMED]) == self._was_armed and int(self._words[at.BEAT]) == beat

    def _process(self) -> Process | None:
        """Ask the kernel about the servo process; None if it is gone."""
        try:
            return Process.of(os.pread(self._stat, 1024, 0).decode(errors="replace"))
        except OSError:
            return None

    def _gone(self) -> bool:
        """Ask the kernel whether the servo process is suspended or ending."""
        process = self._process()
        if process is not None and not process.gone:
            return False
        self._why = "was suspended" if process is not None and process.letter in "Tt" else "died"
        return True

    def _may_speak(self) -> bool:
        """Make the devices safe; then tell whether a hanging servo process may have time to recover without harm."""
        if not self._was_armed:
            return False
        self._said = self._make_safe(f"the servo process {self._why}{self._how_long()}")
        process = self._process()
        if not self._stays_safe or self._orphaned is not None or process is None or process.gone:
            return False
        self._words[at.STOP] = 1
        self._grace_period = GracePeriod()
        return True

    def _silent_for_good(self, grace_period: GracePeriod) -> bool:
        process = self._process()
        if process is None:
            return False  # its file descriptor is about to tell its end
        if self._segment.phase >= at.ENDING and not self._was_armed and not process.gone:
            return self._hangs()  # it has recovered, and ends in order: files are finished
        return self._orphaned is not None or grace_period.over(process)

    def _died(self) -> str:
        if self._said:
            return self._said
        if not self._was_armed or not self._words[at.ARMED]:
            return ""
        ended = self._segment.phase == at.ENDED
        return self._make_safe(f"the servo process {'ended with devices that were not safe' if ended else 'died'}")

    def _end_it(self) -> str:
        if not self._said:
            self._gone()  # a process that was suspended does not hang, and nobody need look for a loop without an end
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._servo, signal.SIGKILL)
        if self._said and not self._stays_safe:  # it may have sent something since the devices were made safe
            select.select([self._servo], [], [], _DEAD)
            self._make_safe("")
        return self._said or f"the servo process {self._why}{self._how_long()} and was ended"

    def _how_long(self) -> str:
        """Return for how long the servo process gave no sign of life, in words; empty if it died or hardly paused."""
        return f" (no beat for {self._silent * 1e3:.0f} ms)" if self._why != "died" and self._silent > DOUBT else ""

    def _make_safe(self, why: str) -> str:
        """Send every safe command, all at once: one device that blocks must not delay the others."""
        begin, acts = time.monotonic(), self._acts or {}
        threads = [threading.Thread(target=_try, args=(act,), daemon=True) for act in acts.values()]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(1.0)
        if not acts:
            return f"{why}; the devices' own watchdogs make them safe"
        return f"{why}; {', '.join(acts)} made safe by the guardian within {(time.monotonic() - begin) * 1e3:.0f} ms"


class OwnProcessGuardian(Guardian):
    """Watches a session in its caller's own process, which it never ends, because that process has work of its own.

    While the session is silent it makes the devices safe again and again, because a process that hangs may send one
    more command when it goes on; the session's next tick finds that it has been stopped.
    """

    def watch(self) -> str:
        """Watch until the session, or its process, has ended; return what had to be done at the end, in words."""
        poller = select.poll()
        poller.register(self._servo, select.POLLIN)
        acted = 0.0
        while True:
            if poller.poll(LOOK * 1e3):
                return self._died()
            self._note_absence()
            if self._segment.phase >= at.ENDED:
                return self._died()
            self._prepare()
            self._was_armed = bool(self._words[at.ARMED])
            if not self._was_armed or not self._hangs():
                acted = 0.0
            elif time.monotonic() - acted > SILENCE:
                acted = time.monotonic()
                self._words[at.STOP] = 1
                self._make_safe("")


def servo_pid(handle: int) -> int:
    """Return the id of the process that a file descriptor (pidfd) stands for; -1 if it is gone."""
    with open(f"/proc/self/fdinfo/{handle}", encoding="ascii") as stream:
        return next(int(line.split()[1]) for line in stream if line.startswith("Pid:"))


def _try(act: Act) -> None:
    with contextlib.suppress(Exception):  # nobody is left to be told of it; the other devices go on
        act()


def _acts(segment: SharedMemory) -> dict[str, Act]:
    """Return, for each remote twin and each device with a second opener, the function that makes it safe."""
    meta = segment.meta()
    acts: dict[str, Act] = {name: _safe_packet(where) for name, where in meta["remotes"].items()}
    if meta["second_openers"]:
        from itouch.servo.opener import openers

        acts.update(openers(segment, meta))
    return acts


def _safe_packet(where: str) -> Act:
    line = twin_protocol.connect(where, 10.0)
    line.settimeout(0.1)

    def act() -> None:
        line.send(twin_protocol.SAFE + b"the guardian")

    return act


def main(argv: Sequence[str]) -> int:
    """Guard the session whose memory, servo process and launcher are given as file descriptors.

    The fourth is a pipe for what had to be done; then come the session's name and, for a caller's own process, ``OWN``.
    """
    memory, servo, owner, answer = (int(word) for word in argv[:4])
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    realtime.take_priority(realtime.GUARDIAN_PRIORITY)
    realtime.lock_memory(as_touched=True)
    realtime.sharpen_timer()
    with contextlib.suppress(OSError), open("/proc/self/oom_score_adj", "w", encoding="ascii") as stream:
        stream.write("-1000")
    segment = SharedMemory(memory, argv[4])
    segment.words[at.GUARDIAN] = os.getpid()
    kind = OwnProcessGuardian if argv[5:] == [OWN] else Guardian
    said = kind(segment, servo, owner).watch()
    with contextlib.suppress(OSError):
        os.write(answer, said.encode())
    return 0


if __name__ == "__main__":
    keep_collections_rare()
    sys.exit(main(sys.argv[1:]))
