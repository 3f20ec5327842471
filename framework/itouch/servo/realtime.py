"""Real-time policy and priority, locked memory, timer slack: best effort, and each attempt reports how it ended.

``itouch-py bench loop`` prints the figures behind this; ``docs/how-to/real-time-kernel.md`` says how to give a user
the rights.
"""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from dataclasses import dataclass
from pathlib import Path

from itouch.platforms import limit

#: Real-time priorities of the servo process, of the guardian above it, and of remote twins between them.
SERVO_PRIORITY, GUARDIAN_PRIORITY, REMOTE_PRIORITY = 50, 60, 55
#: How long [s] the kernel may delay a wake-up to join it with others, and how often [s] threads of Python take turns.
TIMER_SLACK, SWITCH_INTERVAL = 1e-6, 1e-4
_PR_SET_TIMERSLACK = 29
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


@dataclass(frozen=True, slots=True)
class RealtimeSetting:
    """One attempt: what was tried, whether it worked, and what was found or what to do."""

    what: str
    done: bool
    said: str

    def __str__(self) -> str:
        return f"{self.what}: {self.said}"


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _reason() -> str:
    return os.strerror(ctypes.get_errno())


def take_priority(priority: int) -> RealtimeSetting:
    """Ask for the real-time scheduling class SCHED_FIFO; child processes start without it."""
    try:
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except (OSError, AttributeError) as error:
        allowed = limit("RLIMIT_RTPRIO")
        advice = f"this user may use real-time priority up to {allowed}; `itouch-py doctor` says how to change that"
        return RealtimeSetting(
            "real-time priority", False, f"not given ({getattr(error, 'strerror', error)}): {advice}"
        )
    return RealtimeSetting("real-time priority", True, f"SCHED_FIFO {priority}")


def lock_memory(*, as_touched: bool = False) -> RealtimeSetting:
    """Keep the whole process in memory, now and later; ``as_touched``: each page only from its first use on."""
    if _libc().mlockall(_MCL_CURRENT | _MCL_FUTURE | (_MCL_ONFAULT if as_touched else 0)) == 0:
        return RealtimeSetting("memory lock", True, "all pages stay in memory")
    allowed = limit("RLIMIT_MEMLOCK")
    return RealtimeSetting("memory lock", False, f"not given ({_reason()}): this user may lock {allowed >> 20} MiB")


def sharpen_timer() -> RealtimeSetting:
    """Let sleeps end on time: set the kernel's timer slack."""
    nanoseconds = ctypes.c_ulong(round(TIMER_SLACK * 1e9))
    nothing = ctypes.c_ulong(0)
    if not sys.platform.startswith("linux"):
        return RealtimeSetting("timer slack", False, "stays as this system has it")
    if _libc().prctl(_PR_SET_TIMERSLACK, nanoseconds, nothing, nothing, nothing) == 0:
        return RealtimeSetting("timer slack", True, f"{TIMER_SLACK * 1e6:g} us")
    return RealtimeSetting("timer slack", False, f"stays as it is ({_reason()})")


def isolated_cpus(folder: str = "/sys/devices/system/cpu") -> set[int]:
    """Return the processors that the kernel keeps free of other work."""
    try:
        text = Path(folder, "isolated").read_text(encoding="ascii").strip()
    except OSError:
        return set()
    found: set[int] = set()
    for piece in filter(None, text.split(",")):
        first, _, last = piece.partition("-")
        found.update(range(int(first), int(last or first) + 1))
    return found


def choose_cpu() -> RealtimeSetting:
    """Pin the process to an isolated processor; without one, the scheduler chooses better than we could."""
    free = sorted(isolated_cpus() & set(range(os.cpu_count() or 1)))
    if not free:
        return RealtimeSetting(
            "processor", False, "not pinned: no processor is isolated from other work (kernel parameter isolcpus)"
        )
    try:
        os.sched_setaffinity(0, {free[-1]})
    except OSError as error:
        return RealtimeSetting("processor", False, f"not pinned ({error.strerror})")
    return RealtimeSetting("processor", True, f"pinned to {free[-1]}, which is isolated")


def freeze_garbage() -> RealtimeSetting:
    """Collect garbage once, then exempt all present objects from collections, and switch these off."""
    gc.collect()
    gc.freeze()
    gc.disable()
    return RealtimeSetting(
        "garbage collector", True, f"{gc.get_freeze_count()} objects frozen, off while the loop runs"
    )


def be_punctual(priority: int = SERVO_PRIORITY) -> tuple[RealtimeSetting, ...]:
    """Make all these attempts, for a servo process that is about to run."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return take_priority(priority), lock_memory(), sharpen_timer(), choose_cpu(), freeze_garbage()
