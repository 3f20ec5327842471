"""What each test reaches and costs: ``python -m pytest -n 2 -p reach --reach FOLDER``, then ``python tests/reach.py FOLDER``.

A line of the program that only one test reaches keeps that test in the short form.  The second command walks through
all tests, dearest first, and names those of which every line is reached by others that stay: they can be moved to the long
form, if what they compare is compared elsewhere, too; that is for a reader to judge and for mutants to prove
(``tests/mutation.py``).  Costs are processor time, children that have ended included.
"""

from __future__ import annotations

import json
import os
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

ROOTS = ("framework", "plugins")
TREE = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer the folder."""
    parser.addoption("--reach", metavar="FOLDER", type=Path, help="write what each test reaches and costs there")


def pytest_configure(config: pytest.Config) -> None:
    """Watch in the processes that run tests, not in the one that gives them out."""
    if config.option.reach and not (config.getoption("numprocesses", None) and not hasattr(config, "workerinput")):
        config.pluginmanager.register(_Watch(config.option.reach.resolve()))


class _Watch:
    """Tells coverage which test runs, and adds up what it costs."""

    def __init__(self, folder: Path) -> None:
        import coverage

        folder.mkdir(parents=True, exist_ok=True)
        self.out = folder / f"{os.getpid()}.json"
        roots = [str(TREE / root) for root in ROOTS]
        self.coverage = coverage.Coverage(data_file=str(folder / f"{os.getpid()}.cov"), source=roots)
        self.cost: dict[str, float] = {}
        self.begin = 0.0
        self.coverage.start()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.begin = sum(os.times()[:4])
        self.coverage.switch_context(nodeid)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self.cost[nodeid] = sum(os.times()[:4]) - self.begin

    def pytest_sessionfinish(self) -> None:
        self.coverage.stop()
        data, reached = self.coverage.get_data(), dict[str, list[str]]()
        for path in data.measured_files():
            for line, tests in data.contexts_by_lineno(path).items():
                for test in filter(None, tests):
                    reached.setdefault(test, []).append(f"{Path(path).relative_to(TREE)}:{line}")
        self.out.write_text(json.dumps({"cost": self.cost, "reached": reached}), encoding="utf-8")


def read(folder: Path) -> tuple[dict[str, float], dict[str, frozenset[str]]]:
    """Return what each test costs [s] and which lines it reaches."""
    cost, reached = dict[str, float](), dict[str, frozenset[str]]()
    for path in folder.glob("*.json"):
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        cost |= content["cost"]
        reached |= {test: frozenset(lines) for test, lines in content["reached"].items()}
    return cost, reached


def spare(cost: dict[str, float], reached: dict[str, frozenset[str]]) -> list[str]:
    """Return the tests, dearest first, without which the rest still reaches every line."""
    count = Counter(line for lines in reached.values() for line in lines)
    found = []
    for test in sorted(cost, key=lambda test: -cost[test]):
        lines = reached.get(test, frozenset())
        if all(count[line] > 1 for line in lines):
            found.append(test)
            count.subtract(lines)
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Print what the tests cost, by file, and which of them reach nothing of their own."""
    (folder,) = map(Path, sys.argv[1:] if argv is None else argv)
    cost, reached = read(folder)
    can_go = spare(cost, reached)
    print(
        f"{len(cost)} tests, {sum(cost.values()):.0f} s; {len(can_go)} of them, {sum(cost[t] for t in can_go):.0f} s, reach no line alone"
    )
    for test in can_go:
        print(f"{cost[test]:8.2f}  {test}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
