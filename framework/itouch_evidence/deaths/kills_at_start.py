"""Kills from the first millisecond of a start on: launcher, guardian, servo, recorder, viewer and twin.

A launcher in its own process starts a session with remote twins and a recording; all processes that descend from it
carry a mark in their environment.  One is killed some time after it appeared; then all others must end by themselves.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from itouch.servo import twin_protocol
from itouch.servo.shared_memory import monotonic
from itouch_evidence.deaths.observer import Observer
from itouch_evidence.resumable import Kept
from itouch_tools.cli.doctor.touch_scene import scene

#: Longest time [s] until devices are safe, and until all processes have ended.
SAFE, GONE = 0.2, 5.0
VICTIMS = ("launcher", "guardian", "servo", "recorder", "viewer", "twin")
DEVICES = ("arm", "table", "peltier")
_MARK = "ITOUCH_DEATHS"
#: The role of a process, by a word in its command line.
_ROLES = {
    "itouch_evidence.deaths.recording_launcher": "launcher", "itouch.servo.process": "servo",
    "itouch.servo.guardian": "guardian",
    "itouch.servo.twin_process": "twin", "itouch.recording.writing_process": "recorder",
    "itouch.servo.compile_ahead": "companion",
    "itouch_evidence.deaths.simulated_clients": "viewer",
}  # fmt: skip
#: How long [s] a victim may take to appear, and for how long after a kill processes are looked for.
_COMES, _LOOKS = 60.0, 90.0
#: For how long [s] nothing must be seen before everything counts as gone.
_CALM = 0.3


@dataclass(frozen=True, slots=True)
class Kill:
    """What followed one kill.

    ``after_s``: how old the victim was; ``gone_s``: how long until no process was alive; ``safe_s``: how long until
    each device that had obeyed was safe for good (None: never); ``left``: what was still there then, or at a timeout.
    """

    victim: str
    after_s: float
    gone_s: float
    safe_s: dict[str, float | None]
    left: tuple[str, ...]

    @property
    def worst(self) -> float:
        """The longest that any device took [s]; 0 if none had obeyed."""
        return max((float("inf") if t is None else t for t in self.safe_s.values()), default=0.0)

    @property
    def good(self) -> bool:
        """Whether everything was safe and gone in time, and nothing is left."""
        return self.worst <= SAFE and self.gone_s <= GONE and not self.left


def kill(victim: str, after: float, *, running: bool = False) -> Kill:
    """Start a session, kill one of its processes ``after`` seconds after that appeared, and measure what follows.

    With ``running`` the time counts from when devices began to obey.
    """
    mark = f"{os.getpid()}-{monotonic()}"
    with tempfile.TemporaryDirectory() as folder:
        path, recording = Path(folder, "deaths.xml"), Path(folder, "r.mcap")
        path.write_text(scene(hold=victim == "viewer"), encoding="utf-8")
        environment = {**os.environ, _MARK: mark}
        words = [
            sys.executable,
            "-P",
            "-m",
            "itouch_evidence.deaths.recording_launcher",
            str(path),
            mark,
            str(recording),
        ]
        words.append(str(os.getpid()))
        started = [_quiet(words, environment)]
        watched = _Watched(mark)
        try:
            if victim == "viewer":
                words = [sys.executable, "-P", "-m", "itouch_evidence.deaths.simulated_clients", "viewer", mark, "60"]
                started.append(_quiet(words, environment))
            found = _come(victim, mark)
            if running:
                watched.await_begun()
            time.sleep(after)
            event = monotonic()
            with contextlib.suppress(ProcessLookupError):
                os.kill(found, signal.SIGKILL)
            if victim in ("recorder", "viewer"):  # the session may go on, or wait for another viewer: it is told to end
                time.sleep(0.5)
                event = monotonic() if victim == "recorder" else event
                with contextlib.suppress(ProcessLookupError):
                    started[0].terminate()
            gone = _await_nothing(mark, started)
            left = (*_left(mark), *_files(Path(folder), {path.name, recording.name}))
            return Kill(victim, after, gone, watched.safe_after(event, victim), left)
        finally:
            watched.over = True
            for process in _marked(mark):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            for one in started:
                one.wait()


def _quiet(words: Sequence[str], environment: dict[str, str]) -> subprocess.Popen[bytes]:
    nothing = subprocess.DEVNULL
    return subprocess.Popen(
        words, env=environment, start_new_session=True, stdin=nothing, stdout=nothing, stderr=nothing
    )  # fmt: skip


class _Watched:
    """Observes each twin from the time at which it can be connected to."""

    def __init__(self, name: str) -> None:
        self._name, self.over = name, False
        self._observers: dict[str, Observer] = {}
        self._threads = [threading.Thread(target=self._join, args=(d,), daemon=True) for d in DEVICES]
        for thread in self._threads:
            thread.start()

    def _join(self, device: str) -> None:
        while not self.over:
            try:
                self._observers[device] = Observer(self._name, (device,))
                return
            except OSError:
                time.sleep(0.01)

    def await_begun(self) -> None:
        """Wait until some device has obeyed, or nothing is left that could command one."""
        end = time.monotonic() + _COMES
        while time.monotonic() < end and "launcher" in _marked(self._name).values():
            if any(o.seen[n] and o.seen[n][-1][1] & twin_protocol.BEGUN for n, o in list(self._observers.items())):
                return
            time.sleep(0.02)

    def safe_after(self, event: int, victim: str) -> dict[str, float | None]:
        """Return how long [s] each device that obeyed took to be safe, without a twin that was killed itself."""
        self.over = True
        found: dict[str, float | None] = {}
        for name, observer in self._observers.items():
            observer.wait(10.0)
            told = observer.seen[name]
            if any(flags & twin_protocol.BEGUN for _, flags in told) and not (
                victim == "twin" and told[-1][0] <= event
            ):
                found |= observer.safe_after(event)
        return found


def _marked(mark: str) -> dict[int, str]:
    """Return the roles of the living processes that carry a mark, by process id."""
    found = {}
    wanted = f"{_MARK}={mark}".encode()
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        with contextlib.suppress(OSError):
            if wanted in (folder / "environ").read_bytes().split(b"\0"):
                line = (folder / "cmdline").read_bytes().decode(errors="replace")
                found[int(folder.name)] = next((role for word, role in _ROLES.items() if word in line), "other")
    return found


def _come(victim: str, mark: str) -> int:
    """Wait until the victim has appeared; return its process id."""
    end = time.monotonic() + _COMES
    while time.monotonic() < end:
        for process, role in _marked(mark).items():
            if role == victim:
                return process
        time.sleep(0.002)
    raise TimeoutError(f"no {victim} came to be within {_COMES:g} s")


def _await_nothing(mark: str, started: Sequence[subprocess.Popen[bytes]]) -> float:
    """Wait until no process lives, and the kernel lists no socket of one that it is still cleaning up.

    Returns
    -------
    float
        After how long [s] something was last seen.  A process that was just being started by one that was killed has no
        environment for a moment, and can't be seen then: so nothing must be seen for a while.
    """
    begin = seen = time.monotonic()
    while time.monotonic() < min(seen + _CALM, begin + _LOOKS):
        if any(_left(mark)):
            seen = time.monotonic()
        for process in started:
            process.poll()  # so that an ended process does not stay a zombie
        time.sleep(0.02)
    return seen - begin


def _left(mark: str) -> Iterator[str]:
    """Yield what is still there: processes, and local sockets in the kernel's list."""
    yield from (f"{role} {process}" for process, role in _marked(mark).items())
    sockets = Path("/proc/net/unix").read_text(encoding="utf-8", errors="replace")
    if f"@itouch/{mark}" in sockets:
        yield "a local socket"


def _files(folder: Path, known: set[str]) -> Iterator[str]:
    yield from (f"file {path.name}" for path in folder.iterdir() if path.name not in known)


def cases(count: int, seed: int) -> Iterator[tuple[str, float, bool]]:
    """Yield victim, instant [s], and whether that counts from when devices obey instead of from the victim's start.

    A third are killed in their first second, a third in their first four, a third while devices obey.
    """
    draw = random.Random(seed)
    for index in range(count):
        turn = index // len(VICTIMS) % 3
        yield VICTIMS[index % len(VICTIMS)], draw.uniform(0.001, (1.0, 4.0, 3.0)[turn]), turn == 2


def campaign(count: int, seed: int, *, tell: bool, keep: str | None = None) -> list[Kill]:
    """Kill ``count`` times, except where the result is kept already; print the results, and return all kept ones."""
    kept, new = Kept(keep), 0
    for number, (victim, after, running) in enumerate(cases(count, seed)):
        if (seed, number) in kept:
            continue
        one = kill(victim, after, running=running)
        new += 1
        kept.add(seed, number, asdict(one))
        if tell:
            _tell(new, one)
    kills = [_kept(row) for row in kept.rows.values()] if count else []
    if tell and kills:
        _sum_up(kills)
    return kills


def _kept(row: Mapping[str, Any]) -> Kill:
    return Kill(row["victim"], row["after_s"], row["gone_s"], row["safe_s"], tuple(row["left"]))


def _tell(number: int, one: Kill) -> None:
    times = ", ".join(f"{name} {'never' if t is None else f'{t * 1e3:.0f} ms'}" for name, t in one.safe_s.items())
    left = f"; left: {', '.join(one.left)}" if one.left else ""
    mark = "ok  " if one.good else "FAIL"
    told = f"safe: {times or 'nothing had moved'}; all gone after {one.gone_s:.1f} s{left}"
    print(f"{mark} {number:4d} {one.victim:<8} killed at {one.after_s:5.3f} s: {told}", flush=True)


def _sum_up(kills: Sequence[Kill]) -> None:
    columns = ("kills", "obeyed", "safe, worst ms", "gone, median s", "worst s", "left")
    print(
        "\nvictim    " + " ".join(f"{name:>{width}}" for name, width in zip(columns, (6, 7, 15, 15, 8, 5), strict=True))
    )
    for victim in VICTIMS:
        found = [one for one in kills if one.victim == victim]
        if found:
            gone = [one.gone_s for one in found]
            obeyed, left = sum(bool(one.safe_s) for one in found), sum(bool(one.left) for one in found)
            safe, middle = max(one.worst for one in found) * 1e3, statistics.median(gone)
            print(f"{victim:<9} {len(found):>6} {obeyed:>7} {safe:>15.0f} {middle:>15.1f} {max(gone):>8.1f} {left:>5}")
    late, alive = sum(one.worst > SAFE for one in kills), sum(one.gone_s > GONE for one in kills)
    left = sum(bool(one.left) for one in kills)
    print(f"{len(kills)} kills: {late} safe later than {SAFE * 1e3:.0f} ms, {alive} not gone after {GONE:g} s, "
          f"{left} left something behind")  # fmt: skip
