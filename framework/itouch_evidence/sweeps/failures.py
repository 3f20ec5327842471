"""Failures of a sweep besides the death of its client: a cluster that dies, a full disk, no memory, a bad function."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from itouch.scene import bundled_scenes
from itouch.schema import ItouchError
from itouch_evidence.sweeps.backends import dask_cluster
from itouch_tools.sweeps.sweep_store import rows, table

#: Runs of the sweep with a crashing function, on the cluster, and without memory (a full disk: four times as many); the
#: seed that crashes.
MANY, CLUSTER, SOME, HIT = 1000, 1500, 200, 503
#: Longest time of each sweep [s].
PATIENCE = 3000.0
_CRASHES = f"""import os, signal
def count(session):
    if int(session.state["seed"]) == {HIT}:
        os.kill(os.getpid(), signal.SIGSEGV)
    return {{"seed": int(session.state["seed"])}}
"""
_HUNGRY = """import os, signal
def count(session):
    seed = int(session.state["seed"])
    if os.path.exists(FLAG) and seed % 100 == 3:
        import resource
        resource.setrlimit(resource.RLIMIT_AS, (1 << 20, resource.getrlimit(resource.RLIMIT_AS)[1]))
        bytearray(1 << 30)
    if os.path.exists(FLAG) and seed % 100 == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"seed": seed}
"""
_OWN = '<call name="own" function="own.py:count" results="seed"/>'


def small(folder: Path, seeds: int, *, run: str = "0.2 s", more: str = "", own: str = "") -> Path:
    """Write a sweep of the smallest scene over ``seeds`` seeds into a folder, and return its path."""
    home = bundled_scenes.folder()
    if home is None:
        raise ItouchError("the shipped scenes are not there")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "first_touch.xml").write_bytes((home / "first_touch.xml").read_bytes())
    if own:
        (folder / "own.py").write_text(own, encoding="utf-8")
    path = folder / "sweep.xml"
    collect = f'<collect><field name="push" of="finger.force" index="2" reduce="max"/>{more}</collect>'
    path.write_text(
        f'<sweep version="1.0" name="deaths" scene="first_touch.xml"><run for="{run}"/><seeds count="{seeds}"/>'
        f"{collect}</sweep>\n", encoding="utf-8",
    )  # fmt: skip
    return path


def _sweep(path: Path, out: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "itouch_tools.cli", "sweep", os.fspath(path), "-o", os.fspath(out), *more]


def _ran(words: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, check=False, timeout=PATIENCE)


def _digests(out: Path) -> list[str]:
    return [row["digest"] for row in rows(out, ["digest"])]


def _count(out: Path) -> int:
    return len(_digests(out))


def _wait(what: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not what() and time.monotonic() < end:
        time.sleep(0.1)


def cluster(home: Path) -> dict[str, Any]:
    """Kill a worker of a Dask cluster, then its scheduler and all workers; start a new one at the same address."""
    path, out = small(home, CLUSTER, run="1 s"), home / "rows"
    with dask_cluster(3) as one:
        client = subprocess.Popen(
            _sweep(path, out, "--engine", "dask", "--scheduler", one.address), stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        _wait(lambda: _count(out) >= 5 or client.poll() is not None)
        one.workers[2].kill()
        first = _count(out)
        _wait(lambda: _count(out) >= first + 20 or client.poll() is not None)
        for each in (one.scheduler, *one.workers):
            each.kill()
            each.wait()
        second = _count(out)
    with dask_cluster(3, one.address):
        with contextlib.suppress(subprocess.TimeoutExpired):
            client.communicate(timeout=PATIENCE)
        client.kill()
    alone = _ran(_sweep(path, home / "alone", "--workers", "1"))
    same = client.returncode == 0 and alone.returncode == 0 and bool(table(out).equals(table(home / "alone")))
    return {"rows": _count(out), "at_worker": first, "at_scheduler": second, "code": client.returncode, "same": same,
            "good": same and second < CLUSTER}  # fmt: skip


def disk(home: Path) -> dict[str, Any]:
    """Let a disk, a file system of 1 MB in memory, be full after the first rows, then have room again."""
    path, out = small(home, 4 * SOME, run="1 s"), home / "small"
    out.mkdir(exist_ok=True)
    command = " ".join(f"'{word}'" for word in _sweep(path, out / "rows", "--workers", "1"))
    script = f"""mount -t tmpfs -o size=1m tmpfs '{out}' || exit 77
{command} >'{home}/first' 2>&1 & client=$!
until ls '{out}'/rows/runs/*/*.parquet >/dev/null 2>&1 || ! kill -0 $client 2>/dev/null; do sleep 0.1; done
dd if=/dev/zero of='{out}/filler' bs=1k 2>/dev/null
wait $client; echo $? >'{home}/code'
rm '{out}/filler'; mount -o remount,size=64m tmpfs '{out}'
cp -r '{out}/rows' '{home}/then'
{command} >'{home}/second' 2>&1; code=$?
cp -r '{out}/rows' '{home}/rows'; exit $code
"""
    done = _ran(["unshare", "-rm", "sh", "-c", script]) if shutil.which("unshare") else None
    if done is None or done.returncode == 77:
        return {"tried": False, "why": "no file system can be mounted here", "good": True}
    alone = _ran(_sweep(path, home / "alone", "--workers", "1"))
    said = (home / "first").read_text(encoding="utf-8").strip().splitlines()[-1:]
    code, then = int((home / "code").read_text(encoding="utf-8")), _count(home / "then")
    same = done.returncode == 0 and alone.returncode == 0 and bool(table(home / "rows").equals(table(home / "alone")))
    return {"tried": True, "code": code, "said": " ".join(said), "rows_then": then, "same": same,
            "good": same and code == 2 and 0 < then < 4 * SOME}  # fmt: skip


def memory(home: Path) -> dict[str, Any]:
    """Let runs get no memory, or be killed as if for lack of it; then let the same command run them again."""
    home.mkdir(parents=True, exist_ok=True)
    flag = home / "hungry"
    path = small(home, SOME, more=_OWN, own=f"FLAG = {os.fspath(flag)!r}\n{_HUNGRY}")
    flag.write_text("", encoding="utf-8")
    first = _ran(_sweep(path, home / "rows", "--workers", "1"))
    kinds: dict[str, int] = {}
    for row in rows(home / "rows", ["status", "reason"]):
        told = "done" if row["status"] == "done" else f"{row['status']}: {row['reason'][:60]}"
        kinds[told] = kinds.get(told, 0) + 1
    flag.unlink()
    second = _ran(_sweep(path, home / "rows", "--workers", "1"))
    alone = _ran(_sweep(path, home / "alone", "--workers", "1"))
    codes = [one.returncode for one in (first, second, alone)]
    same = codes == [0, 0, 0] and bool(table(home / "rows").equals(table(home / "alone")))
    return {"then": kinds, "same": same, "good": same and len(kinds) >= 3 and sum(kinds.values()) == SOME}


def crash(home: Path) -> dict[str, Any]:
    """Let a function crash its process on one run of a thousand."""
    path = small(home, MANY, run="0.01 s", more=_OWN, own=_CRASHES)
    done = _ran(_sweep(path, home / "rows"))
    others = {row["seed"]: row for row in rows(home / "rows", ["seed", "status", "reason", "own_seed"])}
    bad = {seed: (row["status"], row["reason"]) for seed, row in others.items() if row["status"] != "done"}
    right = all(row["own_seed"] == seed for seed, row in others.items() if row["status"] == "done")
    good = done.returncode == 0 and set(bad) == {HIT} and bad[HIT][0] == "crashed" and right
    digests = _digests(home / "rows")
    told = {str(seed): why for seed, why in bad.items()}
    return {"rows": len(digests), "bad": told, "good": good and len(set(digests)) == MANY}


CASES: dict[str, Callable[[Path], dict[str, Any]]] = {
    "cluster": cluster, "crash": crash, "disk": disk, "memory": memory,
}  # fmt: skip
