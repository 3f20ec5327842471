"""``itouch-py bench deaths``: kill a process of a session at random instants, and measure at the twins what follows.

The servo process, a viewer that holds the dead-man's switch, or a recorder is killed (SIGKILL), suspended (SIGSTOP) or
starved of memory.  The twins run in processes of their own, and report at every step whether what acts on them is safe.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from itouch.loop import DeviceFaultError
from itouch.schema import ItouchError
from itouch.servo import Handle, launch, sessions, twin_protocol
from itouch.servo.shared_memory import monotonic
from itouch_evidence.deaths import kills_at_start
from itouch_evidence.deaths.memory_exhaustion import HUNGER
from itouch_evidence.deaths.observer import Observer
from itouch_tools.cli.doctor.touch_scene import scene

#: The time [s] that W2 allows.
LIMIT = 0.2
VICTIMS, MANNERS = ("servo", "viewer", "recorder"), ("kill", "stop", "memory")
#: After a recorder's death the session must go on for this long [s]; then it is ended.
_GOES_ON = 0.3
_END = 15.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What followed one death.

    ``safe_s`` is how long each device took until what acts on it was safe for good (None: never); ``left`` names what
    was still there afterwards; ``said`` is the message that the launcher got.
    """

    victim: str
    manner: str
    at_s: float
    safe_s: dict[str, float | None]
    left: tuple[str, ...]
    said: str

    @property
    def worst(self) -> float:
        """The longest that any device took [s]."""
        return max((float("inf") if t is None else t for t in self.safe_s.values()), default=float("inf"))


def strike(victim: str, manner: str, wait: float) -> Outcome:
    """Run a session, hit one of its processes after ``wait`` seconds, and measure what follows."""
    before = _processes()
    with tempfile.TemporaryDirectory() as folder, _hungry_children(folder):
        path = Path(folder, "deaths.xml")
        path.write_text(scene(hold=victim == "viewer"), encoding="utf-8")
        handle = launch(path, name=f"deaths-{os.getpid()}-{monotonic()}")
        try:
            return _strike(handle, victim, manner, wait, before)
        finally:
            handle.close()


def _strike(handle: Handle, victim: str, manner: str, wait: float, before: frozenset[int]) -> Outcome:
    observer = Observer(handle.name, handle.link.devices)
    try:
        with _stand_in(victim, handle) as stand:
            event, at, said = _end(handle, stand, manner, wait, victim)
            observer.wait(_END)
    finally:  # also if the session ended by itself
        handle.request_stop()
        observer.wait(_END)
    early = [name for name, after in observer.safe_after(event, twin_protocol.LATCHED).items() if after == 0.0]
    if early:
        raise ItouchError(f"the session ended before anything was done to it ({', '.join(early)} safe already): {said}")
    left = _left(handle.name, before)
    return Outcome(victim, manner, at, observer.safe_after(event), left, said)


def _end(
    handle: Handle, stand: subprocess.Popen[str] | None, manner: str, wait: float, victim: str
) -> tuple[int, float, str]:
    """Let the session run and hit the victim; return when [ns], the session's time then [s], and the message."""
    _await_motion(handle)
    time.sleep(wait)
    if not handle.running:
        raise ItouchError(f"the session ended before anything was done to it: {_ending(handle)}")
    at = handle.seconds
    pid = stand.pid if stand is not None else handle.pid
    tick, event = handle.link.tick, monotonic()
    _hit(pid, manner)
    if victim == "recorder":
        event = _go_on(handle)
    return event, at, _ending(handle, tick)


def _await_motion(handle: Handle) -> None:
    """Wait until the loop runs: before that there is nothing to make safe."""
    while handle.running and handle.link.tick == 0:
        time.sleep(0.005)


@contextmanager
def _stand_in(what: str, handle: Handle) -> Iterator[subprocess.Popen[str] | None]:
    """Attach a process that stands in for a viewer or a recorder; for the servo process there is none."""
    if what == "servo":
        yield None
        return
    stand = _attached(what, handle)
    try:
        yield stand
    finally:
        stand.kill()
        stand.communicate()


def _attached(what: str, handle: Handle) -> subprocess.Popen[str]:
    words = [sys.executable, "-P", "-m", "itouch_evidence.deaths.simulated_clients", what, handle.name]
    stand = subprocess.Popen(words, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True)
    if stand.stdout is None or stand.stdout.readline() != "attached\n":
        stand.kill()
        stand.communicate()
        raise ItouchError(f"the stand-in of a {what} did not attach; the session {_ending(handle)}")
    return stand


def _hit(pid: int, manner: str) -> None:
    os.kill(pid, {"memory": HUNGER, "kill": signal.SIGKILL, "stop": signal.SIGSTOP}[manner])


def _go_on(handle: Handle) -> int:
    """Check that the session goes on, then end it; return when it was told to end."""
    tick = handle.link.tick
    time.sleep(_GOES_ON)
    if handle.link.tick < tick + 0.5 * _GOES_ON / handle.link.period:
        raise ItouchError("the session did not go on without its recorder")
    event = monotonic()
    handle.request_stop()
    return event


def _ending(handle: Handle, after: int = 0) -> str:
    """Wait for the session's end, and return its message; a fault before the tick ``after`` has another cause."""
    try:
        return "ended" if handle.wait(_END) else "did not end"
    except ItouchError as error:
        fault = error if isinstance(error, DeviceFaultError) else error.__cause__
        if isinstance(fault, DeviceFaultError) and fault.tick < after:
            raise ItouchError(f"the session ended before anything was done to it: {error}") from error
        return str(error)


def _processes() -> frozenset[int]:
    """Return the ids of this user's processes that belong to a session."""
    found = set()
    for folder in Path("/proc").iterdir():
        try:
            if folder.name.isdigit() and b"itouch.servo" in (folder / "cmdline").read_bytes():
                found.add(int(folder.name))
        except OSError:
            continue
    return frozenset(found)


def _left(name: str, before: frozenset[int]) -> tuple[str, ...]:
    """Return what a session has left behind, after giving it up to 3 s to go."""
    deadline = time.monotonic() + 3.0
    while True:
        left = [f"process {pid}" for pid in _processes() - before if _belongs(pid, name)]
        left += [f"shared memory of '{info.name}'" for info in sessions() if info.name == name]
        if not left or time.monotonic() > deadline:
            return tuple(left)
        time.sleep(0.05)


def _belongs(pid: int, name: str) -> bool:
    try:
        return name.encode() in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


@contextmanager
def _hungry_children(folder: str) -> Iterator[None]:
    """Make every Python process that is started here starve itself of memory when it gets the signal."""
    line = "from itouch_evidence.deaths.memory_exhaustion import starve_on_signal\nstarve_on_signal()\n"
    Path(folder, "sitecustomize.py").write_text(line, encoding="utf-8")
    sys.path.insert(0, folder)
    path = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (folder, path)))
    try:
        yield
    finally:
        sys.path.remove(folder)
        if path is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = path


def cases(count: int, seed: int) -> Iterator[tuple[str, str, float]]:
    """Yield victim, manner and instant [s]: all pairs in turn, at random instants during two touches."""
    draw = random.Random(seed)
    pairs = [(victim, manner) for victim in VICTIMS for manner in MANNERS]
    for index in range(count):
        yield *pairs[index % len(pairs)], draw.uniform(0.05, 3.5)


def main(argv: Sequence[str]) -> int:
    """Kill, suspend and starve processes of sessions, and tell how soon the devices were safe."""
    parser = argparse.ArgumentParser(prog="itouch-py bench deaths", description=main.__doc__)
    parser.add_argument("--instants", type=int, default=200, metavar="N", help="how many deaths (default 200)")
    parser.add_argument("--kills", type=int, default=0, metavar="N",
                        help="then kill launcher, guardian, servo, recorder, viewer and twin N times, from the "
                        "first millisecond of the start on (default 0)")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="seed of the instants (default 1)")
    parser.add_argument("--keep", metavar="FILE", help="add each kill to this file, do only those that it has not, "
                        "and sum up all that it has: a campaign in parts")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print every outcome as JSON")
    options = parser.parse_args(argv)
    outcomes: list[Outcome] = []
    whole = True
    kills = kills_at_start.campaign(options.kills, options.seed, tell=not options.json, keep=options.keep)
    for victim, manner, wait in cases(options.instants, options.seed):
        try:
            outcome = strike_again(victim, manner, wait)
        except ItouchError as error:  # the machine is too busy for any session; earlier results are still printed
            print(f"given up: {error}", file=sys.stderr, flush=True)
            whole = False
            break
        outcomes.append(outcome)
        if not options.json:
            _tell(len(outcomes), outcome)
    if options.json:
        listed = [asdict(outcome) for outcome in outcomes] + [asdict(one) for one in kills]
        print(json.dumps(listed, indent=1))
    elif outcomes:
        _sum_up(outcomes)
    good = all(outcome.worst <= LIMIT and not outcome.left for outcome in outcomes)
    return 0 if whole and good and all(kill.good for kill in kills) else 1


def strike_again(victim: str, manner: str, wait: float, *, attempts: int = 8) -> Outcome:
    """Strike; if on a busy machine the session ended by itself before that, print so and try again."""
    for _ in range(attempts - 1):
        try:
            return strike(victim, manner, wait)
        except ItouchError as error:
            print(f"again: {error}", file=sys.stderr, flush=True)
    return strike(victim, manner, wait)


def _tell(number: int, outcome: Outcome) -> None:
    times = ", ".join(f"{name} {'never' if t is None else f'{t * 1e3:.0f} ms'}" for name, t in outcome.safe_s.items())
    mark = "ok  " if outcome.worst <= LIMIT and not outcome.left else "FAIL"
    left = f"; left: {', '.join(outcome.left)}" if outcome.left else ""
    who = f"{number:4d} {outcome.victim:<8} {outcome.manner:<6}"
    print(f"{mark} {who} at {outcome.at_s:5.2f} s: {times}{left}", flush=True)


def _sum_up(outcomes: Sequence[Outcome]) -> None:
    print(f"\n{'victim':<9} {'manner':<7} {'deaths':>6} {'median ms':>10} {'worst ms':>9} {'left behind':>12}")
    for victim in VICTIMS:
        for manner in MANNERS:
            found = [o for o in outcomes if (o.victim, o.manner) == (victim, manner)]
            if found:
                times = [o.worst * 1e3 for o in found]
                middle, left = statistics.median(times), sum(bool(o.left) for o in found)
                print(f"{victim:<9} {manner:<7} {len(found):>6} {middle:>10.0f} {max(times):>9.0f} {left:>12}")
    late = sum(outcome.worst > LIMIT for outcome in outcomes)
    left = sum(bool(outcome.left) for outcome in outcomes)
    print(f"{len(outcomes)} deaths, {late} later than {LIMIT * 1e3:.0f} ms, {left} left something behind")
