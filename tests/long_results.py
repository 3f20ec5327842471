"""What the long form has found so far, kept in a file, so that it can be run in parts: and the page made of it.

``python -m pytest -n 2 -m long --results=FILE.jsonl`` notes each test's outcome with date and commit when it ends, and
leaves out what has passed already: the same command goes on after a stop.  Who wants all of it anew deletes the file.
``python tests/long_results.py FILE.jsonl`` writes ``docs/explanation/long-form.md``.
"""

from __future__ import annotations

import contextlib
import datetime
import io
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "explanation" / "long-form.md"


@dataclass(frozen=True, slots=True)
class Result:
    """A test's outcome: ``passed``, ``failed`` or ``skipped``; how long it took [s], what its campaign told."""

    test: str
    outcome: str
    seconds: float
    date: str
    commit: str
    told: tuple[str, ...] = ()

    @property
    def room(self) -> str:
        """The folder of the test."""
        return Path(self.test.partition("::")[0]).parent.as_posix()


def read(path: Path) -> dict[str, Result]:
    """Return the newest outcome of each test; a last line that was cut off by a stop does not count."""
    found = dict[str, Result]()
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            content = json.loads(line)
        except json.JSONDecodeError:
            continue
        found[content["test"]] = Result(**content | {"told": tuple(content["told"])})
    return found


def passed(path: Path) -> frozenset[str]:
    """Return the tests that need not be run again."""
    return frozenset(test for test, result in read(path).items() if result.outcome == "passed")


class Keeper:
    """Appends the outcome of each test when it ends."""

    def __init__(self, path: Path) -> None:
        self.path, self.commit = path, _commit()
        if path.exists() and not path.read_bytes().endswith(b"\n"):  # a stop cut the last line off
            path.write_bytes(path.read_bytes() + b"\n")
        self.outcomes = dict[str, str]()

    def note(self, test: str, when: str, outcome: str, seconds: float, told: Sequence[str]) -> None:
        """Take one of the three reports of a test; with the last one, what it was is known."""
        worst = ("passed", "skipped", "failed")
        self.outcomes[test] = max(self.outcomes.get(test, "passed"), outcome, key=worst.index)
        # what a test took and told stands in the report of its call; one that was skipped in its set-up has none
        if when == "call" or (when == "setup" and outcome != "passed"):
            self._write(test, self.outcomes[test], seconds, told)
        elif when == "teardown" and outcome == "failed":
            self._write(test, "failed", seconds, told)

    def _write(self, test: str, outcome: str, seconds: float, told: Sequence[str]) -> None:
        date = str(datetime.datetime.now(datetime.UTC).date())
        result = Result(test, outcome, round(seconds, 1), date, self.commit, tuple(told))
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(result)) + "\n")


def _commit() -> str:
    words = ["git", "-C", str(HERE), "log", "-1", "--format=%h"]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


def listed() -> list[str]:
    """Return the tests of the long form that are there; their files are imported for that, in this process."""
    found = list[str]()

    class Collector:
        def pytest_collection_finish(self, session: Any) -> None:
            found.extend(item.nodeid for item in session.items)

    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main(["-m", "long", "--collect-only", str(HERE)], plugins=[Collector()])
    return found


def page(results: Iterable[Result], there: Collection[str] = ()) -> str:
    """Return the page: a line a room, what failed, what has not run, and what campaigns told.

    ``there``: the tests that the long form has, else those of the results; what has gone since does not count.
    """
    every = sorted((one for one in results if not there or one.test in there), key=lambda result: result.test)
    rooms = dict[str, list[Result]]()
    for result in every:
        rooms.setdefault(result.room, []).append(result)
    total = Counter(result.outcome for result in every)
    hours = datetime.timedelta(seconds=round(sum(result.seconds for result in every)))
    of = f" of {len(there)}" if there else ""
    lines = [
        "# What the long form of the tests found",
        "",
        "`python -m pytest -n 2 -m long --results=FILE.jsonl` runs what the short form leaves out, and goes on after a stop;",
        "`python tests/long_results.py FILE.jsonl` wrote this page. "
        f"{len(every)}{of} tests: {_numbers(total)}; they took {hours} in all.",
        "",
        "| room | tests | outcome | took, s | date | commits |",
        "|---|---|---|---|---|---|",
        *(_row(room, found) for room, found in rooms.items()),
        "",
    ]
    if wrong := [result for result in every if result.outcome == "failed"]:
        lines += ["Failed:", "", *(f"- `{result.test}` ({result.commit})" for result in wrong), ""]
    if waiting := Counter(test.partition("[")[0] for test in set(there) - {one.test for one in every}):
        lines += ["Not run yet:", "", *(f"- `{test}` ({many})" for test, many in sorted(waiting.items())), ""]
    told = dict.fromkeys((result.test.partition("[")[0], text) for result in every for text in result.told)
    if told:
        lines += ["| campaign | result |", "|---|---|", *_told(told), ""]
    return "\n".join(lines)


def _row(room: str, found: Sequence[Result]) -> str:
    dates, commits = sorted({one.date for one in found}), dict.fromkeys(one.commit for one in found)
    took = sum(one.seconds for one in found)
    outcomes = _numbers(Counter(one.outcome for one in found))
    when = dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}"
    return f"| `{room}` | {len(found)} | {outcomes} | {took:.0f} | {when} | {', '.join(commits)} |"


def _told(told: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Return the rows of what campaigns told: each names its campaign once, and is one line whatever was told."""
    before = ""
    for test, text in told:
        yield f"| {'' if test == before else f'`{test}`'} | {'; '.join(' '.join(line.split()) for line in text.splitlines())} |"
        before = test


def _numbers(counts: Counter[str]) -> str:
    return ", ".join(f"{counts[name]} {name}" for name in ("passed", "failed", "skipped") if counts[name])


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page of a file of results."""
    (path,) = map(Path, sys.argv[1:] if argv is None else argv)
    PAGE.write_text(page(read(path).values(), listed()), encoding="utf-8")
    print(f"written: {PAGE.relative_to(HERE.parent)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
