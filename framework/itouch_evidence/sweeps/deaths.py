"""``itouch-py bench sweep-deaths``: kill what a sweep works with, and see whether a row is lost or doubled.

Clients are killed while they begin, while rows come, and at each step of a write; a worker and the scheduler of a Dask
cluster are killed; a disk is full; a worker has no memory; a function kills its process on one run of a thousand.  The
same command then finishes each sweep, and all its rows must equal those of an undisturbed sweep.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from itouch_evidence.resumable import Kept
from itouch_evidence.sweeps import failures
from itouch_evidence.sweeps.failures import small
from itouch_tools.sweeps.sweep_store import INCOMING, paths_of, rows, table

#: Runs for each client that is killed, so that the sweep does not end before.
RUNS = 60
#: Seconds in which the processes of a killed client must be gone, and in which a client must have written rows.
GONE, BEGUN = 30.0, 900.0
STAGES = ("begin", "rows", "write", "rows", "write")
#: Where a client kills itself: before its Nth file is synced to the disk, before it is renamed, or afterwards.
PLACES = ("before fsync", "before rename", "after rename")
_ENDING = """
import os, signal, sys
place, left = sys.argv[1], [int(sys.argv[2])]
def end(): os.kill(os.getpid(), signal.SIGKILL)
fsync, replace = os.fsync, os.replace
def syncing(handle):
    if place == "before fsync":
        left[0] -= 1
        if left[0] < 0: end()
    fsync(handle)
def replacing(old, new):
    left[0] -= place != "before fsync"
    if left[0] < 0 and place == "before rename": end()
    replace(old, new)
    if left[0] < 0 and place == "after rename": end()
os.fsync, os.replace = syncing, replacing
from itouch_tools.cli import main
sys.exit(main(sys.argv[3:]))
"""
_MARK = "ITOUCH_SWEEP_DEATHS"


def begun(words: Sequence[str], mark: str, log: Path) -> subprocess.Popen[bytes]:
    """Start a program of this campaign, with a mark in its environment."""
    with open(log, "ab") as stream:
        return subprocess.Popen(
            words, stdout=stream, stderr=stream, start_new_session=True, env={**os.environ, _MARK: mark}
        )


def strike(path: Path, out: Path, number: int, rng: random.Random) -> dict[str, Any]:
    """Start a client, kill it, and return what became of the rows: one outcome of the campaign.

    ``good``: no row that was there is lost, none is doubled, and no process is left; a file that cannot be read raises.
    """
    stage, mark, before = STAGES[number % len(STAGES)], uuid.uuid4().hex, _digests(out)
    words = ["sweep", os.fspath(path), "-o", os.fspath(out), "--workers", "1"]
    place = PLACES[(number // 2) % len(PLACES)] if stage == "write" else stage
    if stage == "write":  # the first two files are the sweep's own
        command = [sys.executable, "-c", _ENDING, place, str(rng.choice((0, 1, 2, 2, 3, 3))), *words]
    else:
        command = [sys.executable, "-m", "itouch_tools.cli", *words]
    files, begin = len(paths_of(out)), time.monotonic()
    client = begun(command, mark, path.parent / "clients.log")
    _wait(client, stage, out, files, rng)
    died = time.monotonic() - begin
    ended = client.poll() is not None
    client.kill()
    code = client.wait()
    left, after = _left(mark), _digests(out)
    lost, doubled = set(before) - set(after), len(after) - len(set(after))
    return {"case": "client", "place": place, "at_s": round(died, 2), "code": code, "rows": len(after),
            "new": len(after) - len(before), "lost": len(lost), "doubled": doubled, "left": left,
            "killed": code == -signal.SIGKILL, "whole": ended and code == 0,
            "good": not lost and not doubled and not left}  # fmt: skip


def _wait(client: subprocess.Popen[bytes], stage: str, out: Path, files: int, rng: random.Random) -> None:
    """Wait until the client should be killed, or has ended by itself."""
    end = time.monotonic() + (rng.uniform(0.0, 12.0) if stage == "begin" else BEGUN)
    while time.monotonic() < end and client.poll() is None:
        if stage == "rows" and len(paths_of(out)) > files:
            time.sleep(rng.uniform(0.0, 2.5))
            return
        time.sleep(0.02)


def _digests(out: Path) -> list[str]:
    return [row["digest"] for row in rows(out, ["digest"])]


def _left(mark: str) -> int:
    """Return how many processes of a client are left; wait `GONE` at most for none."""
    deadline, wanted = time.monotonic() + GONE, f"{_MARK}={mark}".encode()
    while True:
        left = 0
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                left += wanted in (folder / "environ").read_bytes().split(b"\0")
        if not left or time.monotonic() > deadline:
            return left
        time.sleep(0.1)


def compared(path: Path, out: Path, alone: Path) -> dict[str, Any]:
    """Let the same command finish a sweep, run it undisturbed in another folder, and compare the rows."""
    words = [sys.executable, "-m", "itouch_tools.cli", "sweep", os.fspath(path), "--workers", "1", "-o"]
    codes = [subprocess.run([*words, os.fspath(each)], capture_output=True, check=False).returncode
             for each in (out, alone)]  # fmt: skip
    found = _digests(out)
    same = codes == [0, 0] and bool(table(out).equals(table(alone)))
    partial = list((out / INCOMING).iterdir())
    return {"rows": len(found), "doubled": len(found) - len(set(found)), "same": same, "partial": len(partial),
            "good": same and not partial}  # fmt: skip


def clients(count: int, seed: int, home: Path, kept: Kept, tell: Callable[[str], None]) -> None:
    """Kill ``count`` clients of sweeps in a folder, one after the other; then finish these sweeps and compare them."""
    path = small(home / "clients", RUNS * max(count, 5))
    turn = max((row["turn"] for row in kept.rows.values() if row["case"] == "client"), default=1)
    for number in range(count):
        if (seed, number) in kept:
            continue
        rng = random.Random(f"{seed} {number}")
        outcome = strike(path, home / f"rows-{turn}", number, rng)
        while not outcome["killed"] and outcome["whole"]:  # the sweep ended before the kill: take another one
            turn += 1
            outcome = strike(path, home / f"rows-{turn}", number, rng)
        kept.add(seed, number, {**outcome, "turn": turn})
        tell(f"{'ok  ' if outcome['good'] else 'FAIL'} {number + 1:3d} client killed {outcome['place']:<13} after "
             f"{outcome['at_s']:6.1f} s: {outcome['rows']} rows, {outcome['new']} new, {outcome['lost']} lost, "
             f"{outcome['doubled']} doubled, {outcome['left']} processes left")  # fmt: skip
    for one in range(1, turn + 1):
        key = (seed, 100_000 + one)
        if key not in kept and count:
            found = compared(path, home / f"rows-{one}", home / "alone")
            kept.add(*key, {"case": "clients, ended", **found})
            tell(told("clients, ended", found))


def told(case: str, found: dict[str, Any]) -> str:
    """Return the line of a case."""
    words = ", ".join(f"{name} {value}" for name, value in found.items() if name not in ("good", "case"))
    return f"{'ok  ' if found['good'] else 'FAIL'} {case}: {words}"


def main(argv: Sequence[str]) -> int:
    """Kill clients, workers and schedulers of sweeps, fill disks, starve workers: no row is lost or doubled."""
    parser = argparse.ArgumentParser(prog="itouch-py bench sweep-deaths", description=main.__doc__)
    parser.add_argument("--clients", type=int, default=50, metavar="N", help="how many are killed (default 50)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="seed of the instants (default 1)")
    parser.add_argument("--only", choices=sorted(failures.CASES), action="append", help="these cases besides clients")
    parser.add_argument("--keep", metavar="FOLDER", help="keep outcomes and rows there, and go on with what is there")
    options = parser.parse_args(argv)
    with contextlib.ExitStack() as stack:
        home = options.keep or stack.enter_context(tempfile.TemporaryDirectory(prefix="itouch-deaths-"))
        return _campaign(Path(home).resolve(), options)


def _campaign(home: Path, options: argparse.Namespace) -> int:
    home.mkdir(parents=True, exist_ok=True)
    kept = Kept(home / "outcomes.jsonl")

    def tell(line: str) -> None:
        print(line, flush=True)

    clients(options.clients, options.seed, home, kept, tell)
    for number, name in enumerate(failures.CASES):
        key = (options.seed, 200_000 + number)
        if key not in kept and (not options.only or name in options.only):
            found = failures.CASES[name](home / name)
            kept.add(*key, {"case": name, **found})
            tell(told(name, found))
    killed = [row for row in kept.rows.values() if row["case"] == "client"]
    places = {place: sum(row["place"] == place for row in killed) for place in ("begin", "rows", *PLACES)}
    lost, doubled = sum(row["lost"] for row in killed), sum(row["doubled"] for row in killed)
    bad = sum(not row["good"] for row in kept.rows.values())
    print(f"{len(killed)} clients killed ({json.dumps(places)[1:-1]}): {lost} rows lost, {doubled} doubled; "
          f"{bad} of {len(kept.rows)} outcomes are not good")  # fmt: skip
    return 1 if bad else 0
