"""``itouch-py bench soak``: hours on the virtual clock and a minute in real time, without growth and without a trip."""

from __future__ import annotations

import argparse
import json
import os
import resource
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from itouch.plugin.commands import exit_code
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, loads
from itouch.schema.quantities import QuantityError, parse_quantity
from itouch.servo import launch
from itouch.session import build
from itouch_tools.cli.doctor.touch_scene import scene

#: How often memory is measured in a run, and the fraction of the run before the first measurement that counts.
LOOKS, SETTLED = 20, 0.1
#: Growth of memory [%] that is allowed: in an hour, a report of two thousand contacts accumulates.
GROWTH = 1.0
_TOUCH = 1.8


@dataclass(frozen=True, slots=True)
class Soak:
    """Figures of a long run: memory [MiB] over time; open files and threads, early and at the end; contacts; faults."""

    pace: str
    simulated_s: float
    resident_mib: tuple[float, ...]
    files: tuple[int, int]
    threads: tuple[int, int]
    contacts: int
    faults: tuple[str, ...]

    @property
    def growth(self) -> float:
        """Growth of memory [%] from the first measurement that counts to the last."""
        first = self.resident_mib[int(SETTLED * len(self.resident_mib))]
        return (self.resident_mib[-1] - first) / first * 100.0

    @property
    def passed(self) -> bool:
        """Whether memory and open files did not grow, and nothing tripped; threads are only shown."""
        return self.growth <= GROWTH and self.files[0] >= self.files[1] and not self.faults


def _scene(length: float) -> Scene:
    touches = round(length / _TOUCH) + 1
    return loads(scene(touches=touches, remote=False, hold=False).encode(), Catalog(), shown="soak.xml")


def _resident(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / (1 << 20)


def _files_and_threads(pid: int) -> tuple[int, int]:
    return len(os.listdir(f"/proc/{pid}/fd")), len(os.listdir(f"/proc/{pid}/task"))


def simulated(length: float) -> Soak:
    """Run for ``length`` simulated seconds in this process, on the virtual clock."""
    engine, pid = build(_scene(length)), os.getpid()
    resident, before = [], (0, 0)
    for look in range(LOOKS):
        engine.run(length / LOOKS)
        resident.append(_resident(pid))
        if look == 0:
            before = _files_and_threads(pid)
    return _outcome("fast", engine.report(), resident, before, _files_and_threads(pid))


def real(length: float) -> Soak:
    """Run for ``length`` seconds of real time in a servo process."""
    resident, before, after = [], (0, 0), (0, 0)
    with launch(_scene(length), seconds=length) as handle:
        while not handle.wait(length / LOOKS):
            resident.append(_resident(handle.pid))
            after = _files_and_threads(handle.pid)
            before = before if before != (0, 0) else after
        report = handle.report()
    return _outcome("real", report, resident, before, after)


def _outcome(
    pace: str, report: dict[str, object], resident: Sequence[float], before: tuple[int, int], after: tuple[int, int]
) -> Soak:
    contacts, faults = report["contacts"], report["faults"]
    told = tuple(f"{fault['trip']}: {fault['cause']}" for fault in faults) if isinstance(faults, list) else ()
    length = report["simulated_s"]
    return Soak(
        pace, length if isinstance(length, float) else 0.0, tuple(round(value, 2) for value in resident),
        (before[0], after[0]), (before[1], after[1]), len(contacts) if isinstance(contacts, list) else 0, told,
    )  # fmt: skip


def _tell(soak: Soak) -> None:
    mark = "ok  " if soak.passed else "FAIL"
    memory = f"memory {soak.resident_mib[0]:.1f} to {soak.resident_mib[-1]:.1f} MiB ({soak.growth:+.2f} %)"
    counts = f"files {soak.files[0]} to {soak.files[1]}, threads {soak.threads[0]} to {soak.threads[1]}"
    print(f"{mark} {soak.pace}: {soak.simulated_s:.0f} s, {soak.contacts} contacts; {memory}; {counts}; "
          f"{len(soak.faults)} trips", flush=True)  # fmt: skip
    for fault in soak.faults:
        print(f"     {fault}")


def _seconds(text: str) -> float:
    try:
        (value,) = parse_quantity(text, "s")
    except QuantityError as error:
        raise argparse.ArgumentTypeError(f"{error}; write for example 60s") from None
    return max(0.0, value)


def main(argv: Sequence[str]) -> int:
    """Run for long, on the virtual clock and in real time, and look for growth and false trips."""
    parser = argparse.ArgumentParser(prog="itouch-py bench soak", description=main.__doc__)
    parser.add_argument("--simulated", type=_seconds, default=3600.0, metavar="1h", help="on the virtual clock")
    parser.add_argument("--real", type=_seconds, default=60.0, metavar="60s", help="in a servo process")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(argv)
    soaks = [run(length) for run, length in ((simulated, options.simulated), (real, options.real)) if length > 0.0]
    if options.json:
        print(json.dumps([asdict(soak) for soak in soaks], indent=1))
    else:
        for soak in soaks:
            _tell(soak)
    return exit_code(soak.passed for soak in soaks)
