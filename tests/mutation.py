"""Mutants of the program, and whether the tests notice: ``python tests/mutation.py [--sample N] [--seed S] [ROOM ...]``.

``--module NAME`` draws them from the modules of this name alone.

cosmic-ray makes the mutants, drawn over all rooms alike.  First the tests of a room run as they are, under coverage, to
learn which test reaches which line.  Then each mutant meets only the tests that reach its line, quickest first, in a
process forked from one that has imported all else.  A mutant that none of them notices has survived.  Compiled kernels are not
seen by coverage: their mutants meet all tests of the room.  What is compiled is kept by its fingerprint in a folder that
goes with the campaign, so that of a changed kernel only it and its callers are compiled anew.

``--reach FOLDER`` lets each mutant meet the tests of the whole tree instead that reach its line, up to a budget of
processor time (``mutant_runner.py``); ``--results FILE.jsonl`` notes each outcome, to go on after a stop, and to meet what has
lived ``--again`` after tests were written.

Tests that a whole run of the short form leaves out (``long_form.txt``) meet what the others have let live: two scores, and
the test that alone notices is named, which is a reason to put it into ``short_form.txt``.

What has survived is told by the line as it was and as it was changed.  Changes that were read and found to change nothing
stand in ``equivalent_mutants.toml``; the score is printed raw, which is the one that counts, and without these.
"""

from __future__ import annotations

import argparse
import importlib
import itertools
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from forms import KEPT, LIST, read_list, stands_in
from mutant_runner import OPTIONS, Meeting, Outcome, Reached, Tests, collected, guarded, keep_kernels
from mutants import HERE, ROOMS, SAFETY, TREE, Changed, Mutant, draw, equivalents, find, is_compiled

__all__ = [
    "HERE",
    "ROOMS",
    "SAFETY",
    "TREE",
    "Meeting",
    "Mutant",
    "Outcome",
    "Reach",
    "equivalents",
    "notices",
    "prepare",
]

#: How long [s] the tests of a mutant may take beyond thrice what they take without it; one that hangs is noticed.
PATIENCE = 60.0


@dataclass(slots=True)
class Reach:
    """Which tests of a room reach a line, and how long each takes [s]; ``passed``: whether all pass as it is."""

    passed: bool = True
    lines: dict[str, dict[int, list[str]]] = field(default_factory=dict)
    took: dict[str, float] = field(default_factory=dict)

    def of(self, mutant: Mutant) -> list[str]:
        """Return the tests for a mutant, quickest first: those that reach its line, else all."""
        lines = self.lines.get(str(mutant.path), {})
        found = set(lines.get(mutant.line, ())) if not is_compiled(mutant.path) else set[str]()
        found = found or set(self.took)  # what runs at import is in nobody's reach, and in everybody's
        return sorted(found, key=lambda test: self.took.get(test, 0.0))


class _Watch:
    """Tells coverage which test runs, and notes how long each takes."""

    def __init__(self, coverage: Any) -> None:
        self.coverage, self.took = coverage, dict[str, float]()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.coverage.switch_context(nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        self.took[report.nodeid] = self.took.get(report.nodeid, 0.0) + report.duration


def learn(room: str, work: Path) -> Reach:
    """Run the tests of a room as they are, and return which of them reach which line."""
    out = work / f"{room}.json"
    child = os.fork()
    if child == 0:
        os._exit(guarded(lambda: _learn(room, work, out)))
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if not out.exists():
        return Reach(passed=False)
    content = json.loads(out.read_text(encoding="utf-8"))
    lines = {path: {int(line): tests for line, tests in found.items()} for path, found in content["lines"].items()}
    return Reach(code == 0, lines, content["took"])


def _learn(room: str, work: Path, out: Path) -> int:
    import coverage
    import pytest

    watched = coverage.Coverage(data_file=str(work / f"{room}.cov"), source=[str(TREE / ROOMS[room][0])])
    watch = _Watch(watched)
    watched.start()
    code = int(pytest.main([*OPTIONS, *_tests(room)], plugins=[watch]))
    watched.stop()
    data, lines = watched.get_data(), {}
    for path in data.measured_files():
        by_line = data.contexts_by_lineno(path)
        lines[path] = {line: [test for test in tests if test] for line, tests in by_line.items()}
    out.write_text(json.dumps({"lines": lines, "took": watch.took}), encoding="utf-8")
    return code


def _tests(room: str) -> list[str]:
    return [str(HERE / name) for name in ROOMS[room][1]]


def notices(mutant: Mutant, reach: Reach, tests: Sequence[str], work: Path) -> str:
    """Return the test that fails with a mutant in a process of its own, or what else ends it; "" if all pass."""
    if not tests:
        return ""
    patience = PATIENCE + 3.0 * sum(reach.took.get(test, 0.0) for test in tests)
    first = work / "first"
    first.unlink(missing_ok=True)
    child = os.fork()
    if child == 0:
        os.setsid()
        os._exit(guarded(lambda: _meet(mutant, tests, first)))
    deadline = time.monotonic() + patience
    while time.monotonic() < deadline:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            code = os.waitstatus_to_exitcode(status)
            return "" if code == 0 else first.read_text(encoding="utf-8") if first.exists() else f"exit code {code}"
        time.sleep(0.01)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "a test that hangs"


def _meet(mutant: Mutant, tests: Sequence[str], noticed: Path) -> int:
    import pytest

    sys.meta_path.insert(0, Changed(mutant))
    return int(pytest.main(["-x", *OPTIONS, *tests], plugins=[_First(noticed)]))


class _First:
    """Writes which test failed first."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self.path.write_text(report.nodeid, encoding="utf-8")


def prepare(work: Path) -> None:
    """Import all that is slow to import, but nothing that is mutated; keep no results of mutants, and no kernels of theirs."""
    for name in ("pytest", "hypothesis", "scipy.linalg", "scipy.optimize", "scipy.spatial"):
        importlib.import_module(name)
    os.environ |= {"ITOUCH_KEPT": "off", "ITOUCH_KERNELS": str(work / "kernels")}
    os.environ.pop("NUMBA_CACHE_DIR", None)
    os.chdir(TREE)
    assert not any(name.startswith("itouch") for name in sys.modules)


@dataclass(slots=True)
class Met:
    """What became of the mutants of a room: how many there were, which lived, and which only the long form noticed."""

    count: int = 0
    alive: list[tuple[str, str, str]] = field(default_factory=list)
    late: int = 0
    #: How many live that more tests would have met, had their budget been larger.
    cut: int = 0


#: What tells which of some tests notices a mutant, if any does, and whether all of them have met it.
Meet = Callable[[Mutant, Sequence[str]], Outcome]


def of_a_room(
    chosen: Sequence[Mutant],
    tests_of: Callable[[Mutant], list[str]],
    meet: Meet,
    note: Callable[..., None] | None = None,
) -> Met:
    """Let tests meet the mutants of a room: the short form first, then what only the long one has; note each outcome."""
    listed, kept, met, known = read_list(LIST), read_list(KEPT), Met(len(chosen)), equivalents()
    for mutant in chosen:
        tests = tests_of(mutant)
        later = {test for test in tests if stands_in(test, listed) and not stands_in(test, kept)}
        outcome, late, same = Outcome(), False, note is not None and mutant.change in known
        if not same:  # nobody could notice it
            outcome = meet(mutant, [test for test in tests if test not in later])
        if not outcome.by and later and not same:
            more = meet(mutant, [test for test in tests if test in later])
            late = bool(more.by)
            outcome = Outcome(more.by, more.how, outcome.spent + more.spent, outcome.cut or more.cut)
        change = f"{mutant.name}: {' -> '.join(mutant.change[1:])}"
        if not outcome.by:
            met.alive.append(mutant.change)
            met.cut += outcome.cut
            print(f"survived{' its budget' * outcome.cut}: {change}", flush=True)
        elif late:
            met.late += 1
            print(f"noticed by the long form alone, {outcome.by}: {change}", flush=True)
        if note:
            note(mutant, len(tests), outcome, late)
    return met


def told(room: str, met: Met) -> str:
    """Return what became of the mutants of a room, in a line."""
    text = f"{room}: {met.count - len(met.alive)} of {met.count} noticed, {met.late} by the long form alone"
    return text + (f"; {met.cut} lived until their budget was used up" if met.cut else "")


def campaign(rooms: Sequence[str], count: int, seed: int, work: Path, module: str = "") -> dict[str, Met]:
    """Draw mutants of some rooms, let the tests of the room meet them, and return what became of them, by room."""
    drawn, found = draw(rooms, count, seed, module), dict[str, Met]()
    for room in rooms:
        chosen = [mutant for mutant in drawn if mutant.room == room]
        reach = learn(room, work)
        if not reach.passed:
            print(f"{room}: its tests fail as it is: left out", flush=True)
            continue

        def meet(mutant: Mutant, tests: Sequence[str], reach: Reach = reach) -> Outcome:
            return Outcome(notices(mutant, reach, tests, work))

        found[room] = of_a_room(chosen, reach.of, meet)
        print(told(room, found[room]), flush=True)
    return found


@dataclass(frozen=True, slots=True)
class Results:
    """A file that holds what became of mutants, a line each; the last word on each counts."""

    path: Path

    def read(self) -> dict[tuple[object, ...], dict[str, Any]]:
        """Return what became of each mutant, by what it is."""
        found = dict[tuple[object, ...], dict[str, Any]]()
        for line in self.path.read_text(encoding="utf-8").splitlines() if self.path.exists() else ():
            entry = json.loads(line)
            file, change = TREE / entry["file"], (entry["before"], entry["after"])
            found.pop(_key(file, entry["was"], entry["operator"], *change), None)
            found[_key(file, entry["line"], entry["operator"], *change)] = entry
        return found

    def note(self, mutant: Mutant, tests: int, outcome: Outcome, late: bool, was: int = 0) -> None:
        """Write what became of a mutant that so many tests reach; ``was``: the line that it had when it was met before."""
        file, before, after = mutant.change
        entry = {
            "room": mutant.room, "file": file, "line": mutant.line, "was": was or mutant.line,
            "operator": mutant.operator, "before": before, "after": after, "tests": tests, "by": outcome.by,
            "how": outcome.how, "late": late, "spent": round(outcome.spent, 1), "cut": outcome.cut,
        }  # fmt: skip
        with self.path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(entry) + "\n")

    def survivors(self) -> dict[Mutant, int]:
        """Return the mutants that have lived and can still be made, with the line that each had."""
        alive = dict[Mutant, int]()
        for entry in self.read().values():
            if entry["by"] and not entry["late"]:
                continue
            change = entry["before"], entry["after"]
            mutant = find(entry["room"], entry["file"], entry["operator"], change, entry["line"])
            if mutant is None:
                print(f"not there any more, and still counted: {entry['file']}:{entry['line']}: {' -> '.join(change)}")
            else:
                alive[mutant] = entry["line"]
        return alive

    def met(self) -> dict[str, Met]:
        """Return what became of all, by room."""
        found = dict[str, Met]()
        for entry in self.read().values():
            met = found.setdefault(entry["room"], Met())
            met.count += 1
            met.late += entry["late"]
            if not entry["by"]:
                met.alive.append((entry["file"], entry["before"], entry["after"]))
                met.cut += entry["cut"]
        return found


def _key(path: Path, line: int, operator: str, before: str, after: str) -> tuple[object, ...]:
    return str(path.relative_to(TREE)), line, operator, before, after


def of_the_tree(mutants: dict[Mutant, int], rooms: Sequence[str], meeting: Meeting, results: Results) -> None:
    """Let the tests of the whole tree meet mutants, of which each had a line when it was met before, and note it."""

    def note(mutant: Mutant, tests: int, outcome: Outcome, late: bool) -> None:
        results.note(mutant, tests, outcome, late, mutants[mutant])

    by_room = {room: [mutant for mutant in mutants if mutant.room == room] for room in rooms}
    for row in itertools.zip_longest(*by_room.values()):  # a run that is stopped has met as many of each room
        for mutant in filter(None, row):
            of_a_room([mutant], meeting.tests.of, meeting.meet, note)
            if mutant is by_room[mutant.room][-1]:
                print(told(mutant.room, results.met()[mutant.room]), flush=True)


def score(found: dict[str, Met]) -> int:
    """Print the score; return the exit code."""
    count, alive = sum(met.count for met in found.values()), sum(len(met.alive) for met in found.values())
    late, cut = sum(met.late for met in found.values()), sum(met.cut for met in found.values())
    if not count:
        return 2
    part = 1.0 - (alive + late) / count
    print(f"{count} mutants, {count - alive} noticed, {alive} survived: {100 - 100 * alive / count:.1f} %")
    if cut:
        print(f"{cut} of them had not met all tests when their budget was used up: at least so many are noticed")
    print(f"by a whole run of the short form: {count - alive - late}: {100 * part:.1f} %")
    known = equivalents()
    same = sum(change in known for met in found.values() for change in met.alive)
    if same and count > same:
        print(
            f"without {same} that change nothing (equivalent_mutants.toml): {100 * (count - alive) / (count - same):.1f} %"
        )
    safety = found.get("safety", Met())
    return 0 if part >= 0.8 and len(safety.alive) + safety.late <= 0.1 * safety.count else 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaign; exit code 1 if less than 80 % are noticed, or 90 % in safety."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help=f"default: all of {', '.join(ROOMS)}")
    parser.add_argument("--sample", type=int, default=300, metavar="N", help="how many, over all rooms (default 300)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--module", default="", metavar="NAME", help="of the modules of this name alone")
    whole = parser.add_argument_group("with the tests of the whole tree, by what reach.py wrote")
    whole.add_argument(
        "--reach", action="append", metavar="FOLDER[@COMMIT]",
        help="the newest first; the commit it was made at, if it does not say",
    )  # fmt: skip
    whole.add_argument("--budget", type=float, metavar="S", help="processor time of a mutant's tests [s] (default 60)")
    whole.add_argument(
        "--results", type=Path, metavar="FILE.jsonl", help="note each outcome there; what stands there is not met again"
    )
    whole.add_argument(
        "--again", action="store_true", help="meet only those that have lived, by the results, once more"
    )
    options = parser.parse_args(argv)
    if not options.reach and (options.budget or options.results or options.again):
        parser.error("--budget, --results and --again go with --reach FOLDER: give it, or leave these out")
    if options.again and not (options.results and options.results.exists()):
        parser.error("--again meets what has lived by the results: give the file, --results FILE.jsonl")
    rooms = options.rooms or list(ROOMS)
    work = Path(tempfile.mkdtemp(prefix="itouch-mutation-"))
    try:
        prepare(work)
        if not options.reach:
            return score(campaign(rooms, options.sample, options.seed, work, options.module))
        keep_kernels(work)
        reached, results = Reached(), Results(options.results or work / "results.jsonl")
        for given in options.reach:
            folder, _, commit = given.partition("@")
            reached.add(Path(folder), commit)
        meeting = Meeting(Tests(reached, collected(work)), work, options.budget or 60.0)
        if options.again:
            mutants = results.survivors()
        else:
            drawn, known = draw(rooms, options.sample, options.seed, options.module), results.read()
            keys = {
                mutant: _key(TREE / mutant.change[0], mutant.line, mutant.operator, *mutant.change[1:])
                for mutant in drawn
            }
            mutants = {mutant: mutant.line for mutant in drawn if keys[mutant] not in known}
        try:
            of_the_tree(mutants, rooms, meeting, results)
        except KeyboardInterrupt:
            print("stopped: what follows is of those that were met", flush=True)
        return score(results.met())
    finally:
        shutil.rmtree(work, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
