"""What the shipped scenes command, in few numbers: ``python tests/session/commanded.py [SCENE ...]`` writes them anew.

Of each command of each device there is a number for each half second: what was sent in each of its ticks, weighted by
what looks like chance and is always the same, and added up.  A command that changes anywhere changes its number.  They
hold within a millionth on any processor, those of a current, in which the last bits grow (it follows what an estimator
learns of the display), within a ten-thousandth; ``exact`` is a digest of all bytes that were sent, for processors like
the one that they were made on.
"""

from __future__ import annotations

import hashlib
import json
import platform
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np

sys.path.append(str(Path(__file__).parents[1]))  # where a command does not look, and the tests do

from running import RUNNABLE
from shipped import SCENES

import itouch
from itouch.shipped import fits, processor_flags

FILE = Path(__file__).parent / "golden" / "commands.json"
#: By how much numbers may differ on another processor [1].  Of a current 2e-5 were seen, with the program of the very
#: commit that had written the numbers elsewhere.
OF_ANY, OF_CURRENT = 1e-6, 1e-4
#: Longest part of a scene [s], and what a number is of [s].
LONGEST, PART = 14.0, 0.5


def commanded(scene: str | Path, seconds: float = LONGEST) -> dict[str, Any]:
    """Run a shipped scene, or that of a file, and return its numbers by command, and the digest."""
    session = itouch.build(scene if isinstance(scene, Path) else SCENES / f"{scene}.xml", seed=1)
    session.records = False
    views = {f"{d.name}.{c.name}": session.state[f"{d.name}.sent.{c.name}"].reshape(-1)
             for d in session.model.devices.values() for c in d.commands}  # fmt: skip
    every = np.concatenate(list(views.values()))
    rows: list[bytes] = []
    session.taps.append(lambda tick: rows.append(b"".join(view.tobytes() for view in views.values())))
    fault = ""
    try:
        session.run(until=lambda: session.done or len(rows) * session.model.period >= seconds)
    except itouch.DeviceFaultError as error:
        fault = f"{error.device}: {error.trip.name} at tick {error.tick}"
    period = session.model.period
    session.close()
    sent = np.frombuffer(b"".join(rows)).reshape(-1, every.size)
    found: dict[str, Any] = {"ticks": len(sent), "fault": fault, "exact": hashlib.sha256(sent.tobytes()).hexdigest()}
    part, begin = round(PART / period), 0
    for name, view in views.items():
        mine = sent[:, begin : begin + view.size]
        blocks = [mine[i : i + part] for i in range(0, len(mine), part)]
        found[name] = [f"{float((block * _weights(block.shape)).sum()):.12g}" for block in blocks]
        begin += view.size
    return found


def _weights(shape: tuple[int, ...]) -> np.ndarray:
    """Return numbers between -1 and 1 that look like chance."""
    index = np.arange(int(np.prod(shape)), dtype=np.uint64)
    mixed = index * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    return ((mixed >> np.uint64(11)).astype(np.float64) / 2.0**52 - 1.0).reshape(shape)


def machine() -> str:
    """Return what decides the last bits of a number here."""
    flags = " ".join(sorted(processor_flags()))
    made = f"{platform.machine()} {flags} numpy {np.__version__} numba {numba.__version__} {fits()}"
    return hashlib.sha256(made.encode()).hexdigest()


def kept() -> dict[str, Any]:
    """Return the numbers that are kept, and the machine that they are of."""
    found: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    return found


def same(now: dict[str, Any], before: dict[str, Any], advice: str) -> None:
    """Hold the numbers of a scene against those that are kept."""
    assert (now["ticks"], now["fault"], set(now)) == (before["ticks"], before["fault"], set(before)), advice
    for command in set(now) - {"ticks", "fault", "exact"}:
        one, other = (np.array(numbers[command], float) for numbers in (now, before))
        most = OF_CURRENT if command.endswith(".current") else OF_ANY
        apart = np.abs(one - other) > most * max(1e-3, np.abs(other).max())
        assert not apart.any(), f"{command} differs from {0.5 * int(np.argmax(apart)):g} s on; {advice}"
    if machine() == kept()["machine"]:
        assert now["exact"] == before["exact"], f"the last bits differ; {advice}"


def main(scenes: list[str]) -> None:
    """Write the numbers of some scenes, or of all, anew."""
    found = kept()
    if found.get("machine") != machine():
        scenes = []  # digests of two machines do not go together
    for scene in scenes or RUNNABLE:
        found[scene] = commanded(scene)
        print(scene, found[scene]["ticks"], found[scene]["fault"], flush=True)
    FILE.write_text(json.dumps(found | {"machine": machine()}, indent=0) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
