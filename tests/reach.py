"""What each test reaches and costs: ``PYTHONPATH=tests python -m pytest -n 2 -p reach --reach=FOLDER``, then this file
on FOLDER.

The same with ``--bare``, between the two, measures what each costs where nobody watches which lines it reaches: these
costs count then, as coverage makes what runs in Python dearer than what is compiled.  The last command chooses what a whole run of the short form leaves out, and writes ``tests/long_form.txt``.  It stays:

* every test that costs next to nothing, or stands in ``tests/short_form.txt`` with the reason: it alone notices a mutant
  (``tests/mutation.py``), or nothing else looks at what it promises;
* of each test function the cheapest case, where that costs less than its room allows: most in safety;
* of the rest, by what each second buys, what reaches lines of the program that nothing else there reaches.

Everything else waits for the long form, with what waited there when the run was made: empty the list before that run to
choose anew among all.  Costs are processor time, children that have ended included; lines that are
reached in another process are not seen, so that a test of processes stays by its cost or by that list, or not at all.
Measured with kernels at hand, they leave out what a test compiles for itself alone in a new clone: set that in the
``.costs`` of FOLDER by hand.
"""

from __future__ import annotations

import heapq
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from forms import KEPT, LIST, read_list, stands_in

ROOTS = ("framework", "plugins")
#: How the files end that tell what each test costs where nobody watches.
COSTS = ".costs"
TREE = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer the folder."""
    parser.addoption("--reach", metavar="FOLDER", type=Path, help="write what each test reaches and costs there")
    parser.addoption("--bare", action="store_true", help="write to the same folder what each costs without coverage")


def pytest_configure(config: pytest.Config) -> None:
    """Watch in the processes that run tests, not in the one that gives them out."""
    if config.option.reach and not (config.getoption("numprocesses", None) and not hasattr(config, "workerinput")):
        folder = config.option.reach.resolve()
        folder.mkdir(parents=True, exist_ok=True)
        config.pluginmanager.register((_Costs if config.option.bare else _Watch)(folder))


class _Costs:
    """Adds up what each test costs."""

    def __init__(self, folder: Path) -> None:
        self.out = folder / f"{os.getpid()}{COSTS}"
        self.cost: dict[str, float] = {}
        self.begin = 0.0

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.begin = sum(os.times()[:4])

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self.cost[nodeid] = sum(os.times()[:4]) - self.begin

    def pytest_sessionfinish(self) -> None:
        self.out.write_text(json.dumps(self.cost), encoding="utf-8")


class _Watch(_Costs):
    """Tells coverage which test runs, too."""

    def __init__(self, folder: Path) -> None:
        import coverage

        super().__init__(folder)
        self.out = folder / f"{os.getpid()}.json"
        roots = [str(TREE / root) for root in ROOTS]
        self.coverage = coverage.Coverage(data_file=str(folder / f"{os.getpid()}.cov"), source=roots)
        self.coverage.start()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        super().pytest_runtest_logstart(nodeid)
        self.coverage.switch_context(nodeid)

    def pytest_sessionfinish(self) -> None:
        self.coverage.stop()
        data, reached = self.coverage.get_data(), dict[str, list[str]]()
        for path in data.measured_files():
            for line, tests in data.contexts_by_lineno(path).items():
                for test in filter(None, tests):
                    reached.setdefault(test, []).append(f"{Path(path).relative_to(TREE)}:{line}")
        words = ["git", "-C", str(TREE), "rev-parse", "HEAD"]  # where lines have moved since, mutation.py follows them
        commit = subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
        content = {"commit": commit, "cost": self.cost, "reached": reached}
        self.out.write_text(json.dumps(content), encoding="utf-8")


def read(folder: Path) -> tuple[dict[str, float], dict[str, frozenset[str]]]:
    """Return what each test costs [s] and which lines it reaches."""
    cost, reached = dict[str, float](), dict[str, frozenset[str]]()
    for path in folder.glob("*.json"):
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        cost |= content["cost"]
        reached |= {test: frozenset(lines) for test, lines in content["reached"].items()}
    for path in folder.glob(f"*{COSTS}"):
        cost |= json.loads(path.read_text(encoding="utf-8"))
    return cost, reached


#: What the cheapest case of a test function may cost [s] to stay, by the folder of the test; else the last.
ALLOWED = {
    "safety": 0.6, "monitors": 0.6, "faults": 0.6, "servo": 0.3, "loop": 0.15, "integration": 0.15, "itouch_evidence": 0.15,
    "twin": 0.15, "": 0.12,
}  # fmt: skip
#: What costs less [s] stays, whatever it is; how many lines that nothing else reaches a second has to buy.
NOTHING, GAIN = 0.02, 80.0


def allowed(test: str) -> float:
    """Return what the cheapest case of a test's function may cost [s]."""
    return next(cost for room, cost in ALLOWED.items() if test.removeprefix("tests/").startswith(room))


def choose(cost: Mapping[str, float], reached: Mapping[str, frozenset[str]], always: Iterable[str] = ()) -> set[str]:
    """Return the tests that stay in the short form, of all that have a cost [s], by the lines that each reaches."""
    cheapest = dict[str, str]()
    for test in sorted(cost, key=lambda test: (cost[test], test)):
        cheapest.setdefault(test.partition("[")[0], test)
    stay = {test for test, took in cost.items() if took < NOTHING}
    stay |= {test for test in cheapest.values() if cost[test] < allowed(test)} | set(always)
    lines = set[str]().union(*(reached.get(test, frozenset()) for test in stay))

    def gain(test: str) -> float:
        return len(reached[test] - lines) / max(cost[test], 0.01)

    # what a test would add only shrinks while others are added: the best of before, if it is still as good, is the best
    heap = [(-gain(test), test) for test in reached if test in cost and test not in stay]
    heapq.heapify(heap)
    while heap:
        _, test = heapq.heappop(heap)
        now = gain(test)
        if now < GAIN:
            continue
        if heap and -now > heap[0][0]:
            heapq.heappush(heap, (-now, test))
        else:
            stay.add(test)
            lines |= reached[test]
    return stay


def shortest(gone: Iterable[str], every: Iterable[str]) -> list[str]:
    """Return a list of tests in the fewest lines: a file or a function of which all go is one line."""
    going, found = set(gone), set[str]()
    of = dict[str, set[str]]()
    for test in every:
        for name in (test.partition("::")[0], test.partition("[")[0]):
            of.setdefault(name, set()).add(test)
    for test in going:
        names = (test.partition("::")[0], test.partition("[")[0])
        found.add(next((name for name in names if of[name] <= going), test))
    return sorted(found)


def with_those_left_out(names: Iterable[str], listed: Iterable[str]) -> list[str]:
    """Add what the list named before, and the run therefore left out, but for what a name of a whole function covers."""
    found = frozenset(names)
    return sorted({*found, *(test for test in listed if not stands_in(test, found))})


def main(argv: Sequence[str] | None = None) -> int:
    """Choose, write the list, and print what the two forms cost and reach."""
    (folder,) = map(Path, sys.argv[1:] if argv is None else argv)
    cost, reached = read(folder)
    kept = read_list(KEPT)
    stay = choose(cost, reached, {test for test in cost if stands_in(test, kept)})
    names = with_those_left_out(shortest(set(cost) - stay, cost), read_list(LIST))
    head = "# What a whole run of the short form leaves out: python tests/reach.py FOLDER\n"
    LIST.write_text(head + "".join(f"{name}\n" for name in names), encoding="utf-8")
    every, left = (set[str]().union(*(reached.get(test, frozenset()) for test in tests)) for tests in (cost, stay))
    print(f"all   {len(cost):5d} tests {sum(cost.values()):6.0f} s {len(every)} lines")
    print(f"short {len(stay):5d} tests {sum(map(cost.__getitem__, stay)):6.0f} s {len(left)} lines")
    return 0


if __name__ == "__main__":
    sys.exit(main())
