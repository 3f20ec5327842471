"""Which tests reach every branch of the supervisor: ``python tests/branches.py`` writes ``tests/safety/branches.txt``.

With the compiler off, so that coverage sees the branches of compiled functions as Python runs them.  Of all tests that
need no scene, those are chosen that reach most by what each second buys; ``tests/safety/test_single_hardware_path.py``
runs these alone, as with the compiler off all of them would take minutes.  With the compiler all of them run, as other
tests do.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pytest
from forms import read_list
from mutants import HERE, SAFETY, TREE

#: The tests that reach every branch, one a line.
LIST = HERE / "safety" / "branches.txt"
SOURCES = ("itouch.safety", "itouch.monitors")

Arc = tuple[str, int, int]


class _Watch:
    """Notes which branches each test takes, and how long it took."""

    def __init__(self, data: str) -> None:
        import coverage

        self.coverage = coverage.Coverage(data_file=data, source=list(SOURCES), branch=True)
        self.cost: dict[str, float] = {}
        self.coverage.start()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.cost[nodeid] = -sum(os.times()[:4])
        self.coverage.switch_context(nodeid)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self.cost[nodeid] += sum(os.times()[:4])

    def arcs(self) -> Iterator[tuple[str, Arc]]:
        """Yield each test with each branch that it takes; an import is that of no test."""
        self.coverage.stop()
        data = self.coverage.get_data()
        for test in data.measured_contexts():
            data.set_query_context(test)
            for path in data.measured_files():
                yield from ((test, (path, *arc)) for arc in data.arcs(path) or ())


def choose(cost: Mapping[str, float], taken: Mapping[str, frozenset[Arc]]) -> list[str]:
    """Return tests that take, together, every branch that any takes, by what each second [s] of ``cost`` buys."""
    chosen, left = list[str](), set[Arc]().union(*taken.values())
    while left:
        chosen.append(max(taken, key=lambda test: (len(taken[test] & left) / max(cost[test], 1e-3), test)))
        left -= taken[chosen[-1]]
    for test in sorted(chosen, key=cost.__getitem__, reverse=True):  # those chosen later may have made up for it
        others = set[Arc]().union(*(taken[other] for other in chosen if other != test))
        if taken[test] <= others:
            chosen.remove(test)
    return sorted(chosen)


def run(*words: str, data: Path) -> subprocess.CompletedProcess[str]:
    """Run Python with the compiler off, in the folder of this tree; what coverage finds goes to the file ``data``."""
    env = {**os.environ, "COVERAGE_FILE": str(data), "NUMBA_DISABLE_JIT": "1"}
    return subprocess.run([sys.executable, *words], env=env, cwd=TREE, capture_output=True, text=True, check=False)


def uncovered(tests: Sequence[str], data: Path) -> str:
    """Run tests; return what they have printed if they fail, else which branches they do not take, or nothing."""
    quiet = ("-q", "-p", "no:cacheprovider")
    watched = ("-m", "coverage", "run", "--branch", f"--source={','.join(SOURCES)}", "-m", "pytest")
    done = run(*watched, *quiet, *tests, data=data)
    if done.returncode == 0:
        report = ("-m", "coverage", "report", "--fail-under=100", "--show-missing", "--skip-covered")
        done = run(*report, data=data)
    return "" if done.returncode == 0 else done.stdout[-3000:] + done.stderr[-3000:]


def listed() -> list[str]:
    """Return the tests of the list."""
    return sorted(read_list(LIST))


def main() -> int:
    """Choose, write the list, and look whether its tests, without all others, reach every branch."""
    without = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    if os.environ != without:
        return subprocess.run([sys.executable, __file__], env=without, check=False).returncode
    with tempfile.TemporaryDirectory() as folder:
        watch = _Watch(str(Path(folder, "every")))
        every = [str(HERE / name) for name in SAFETY]
        if code := pytest.main(["-q", "-p", "no:cacheprovider", *every], plugins=[watch]):
            return int(code)
        taken = dict[str, set[Arc]]()
        for test, arc in watch.arcs():
            if test:
                taken.setdefault(test, set()).add(arc)
        chosen = choose(watch.cost, {test: frozenset(arcs) for test, arcs in taken.items()})
        head = "# With the compiler off these reach every branch of the supervisor: python tests/branches.py\n"
        LIST.write_text(head + "".join(f"{test}\n" for test in chosen), encoding="utf-8")
        took = sum(watch.cost[test] for test in chosen)
        print(f"{len(chosen)} of {len(watch.cost)} tests, {took:.0f} of {sum(watch.cost.values()):.0f} s")
        missing = uncovered(chosen, Path(folder, "chosen"))
    print(missing, end="")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
