"""Mutants meet the tests of the whole tree that reach their line: ``python tests/mutation.py --reach FOLDER``.

Which test reaches which line comes from ``tests/reach.py``, moved to where the line stands by now.  What a test reaches in
a fixture that it shares with others, and that is made for the first of them, each of the others reaches, too.  For what
no test is seen to reach itself, as it is compiled or runs when a module is imported, the lines count that use it by its
name, with the tests of the room after them.

The order: the page of all attributes, for what a module binds, whose bounds and defaults may stand there, and for what a
decorator says of a class the law of the house that reads it; tests in which the changed function, class or constant is named, as they ask the most of it; then those of files that import the changed
module or its package, then others; of each one case of a test function before further cases, the tests of the room before
others, and the cheapest first; costly ones after these.  A mutant that all of them let live until
they have used up its budget of processor time counts as one that lives; how many did so is told, as the score is a lower
bound by these.

Processes that a test starts find the mutant, too, unless they are started without the environment; so do tests that read
the program as text.

A test that fails counts if it fails alone, too, and passes alone without the mutant, in the same kind of process: one
that can't run like that notices nothing.  One that hangs is not asked to do so twice.
"""

from __future__ import annotations

import ast
import contextlib
import difflib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from mutants import COMPILING, HERE, PAGE, ROOMS, TREE, Changed, Mutant, is_compiled

#: How pytest is asked; a whole run of the short form leaves out more.
OPTIONS = ("-q", "-p", "no:cacheprovider", "--no-header", "--tb=no", "-o", "filterwarnings=ignore", "-m", "not long")
ROOTS = ("framework", "plugins")
#: Whether dataclasses have slots and are frozen, which is read in their text.
DATACLASSES = "house/test_dataclasses.py::test_dataclasses_have_slots_and_are_frozen_unless_they_change"
#: How much processor time [s] a test may take, beyond ten times what it costs; thrice that where kernels are compiled anew.
PATIENCE = 20.0
#: How many tests a process is given, of each mutant the first, the second ...; then all that are left.
PARTS = (12, 60, 300)
#: What a test may cost [s] of which nobody knows it; what costs more comes later.
UNKNOWN, COSTLY = 0.3, 1.0
#: A mutant's line is that of a kernel, or of a name: how many names that are made of it are looked for.
NAMES = 40


# --- which tests reach a line --------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Place:
    """Where a line stands: the lines of its statement, those of its function, and the names that it makes at import."""

    statement: range
    function: range
    names: frozenset[str]
    compiled: bool


@cache
def _parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _own_lines(node: ast.stmt) -> range:
    """Return the lines of a statement, without those of the statements in it."""
    body = getattr(node, "body", None)
    first = min([node.lineno, *(one.lineno for one in getattr(node, "decorator_list", ()))])
    return range(first, max(body[0].lineno, node.lineno + 1) if body else (node.end_lineno or node.lineno) + 1)


def _bound(node: ast.stmt) -> set[str]:
    """Return the names that a statement binds."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    return {
        one.id if isinstance(one, ast.Name) else one.attr
        for one in ast.walk(node)
        if isinstance(one, ast.Name | ast.Attribute) and isinstance(one.ctx, ast.Store)
    }


def _own(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what a statement is made of, but not the statements in it."""
    for one in ast.iter_child_nodes(node):
        if not isinstance(one, ast.stmt):
            yield one
            yield from _own(one)


@cache
def _statements(path: Path) -> list[tuple[ast.stmt, Place]]:
    """Return the statements of a module, each with where it stands, outer ones first."""
    found = list[tuple[ast.stmt, Place]]()

    def visit(node: ast.AST, functions: tuple[ast.FunctionDef, ...], classes: frozenset[str]) -> None:
        for one in ast.iter_child_nodes(node):
            if not isinstance(one, ast.stmt):
                visit(one, functions, classes)
                continue
            lines, compiled = _own_lines(one), any(is_kernel(function) for function in functions)
            if compiled:
                stands = Place(lines, range(0), frozenset({functions[0].name}), True)
            elif functions:
                last = functions[-1]
                whole = range(last.lineno, (last.end_lineno or last.lineno) + 1)
                stands = Place(lines, whole, frozenset(), False)
            else:
                stands = Place(lines, range(0), frozenset(_bound(one)) | classes, False)
            found.append((one, stands))
            inner = (*functions, one) if isinstance(one, ast.FunctionDef) else functions
            visit(one, inner, classes | {one.name} if isinstance(one, ast.ClassDef) else classes)

    visit(_parsed(path), (), frozenset())
    return found


def place(path: Path, line: int) -> Place:
    """Return where a line of a module stands."""
    stands = Place(range(line, line + 1), range(0), frozenset(), False)
    for node, found in _statements(path):
        if line in found.statement or node.lineno <= line <= (node.end_lineno or node.lineno):
            stands = found
    if line not in stands.statement:  # an ``else``, or the like
        return Place(range(line, line + 1), stands.function, stands.names, stands.compiled)
    return stands


def is_kernel(node: ast.stmt) -> bool:
    """Tell whether a function is compiled."""
    if not isinstance(node, ast.FunctionDef):
        return False
    names = (ast.unparse(one).partition("(")[0].rpartition(".")[2] for one in node.decorator_list)
    return not COMPILING.isdisjoint(names)


@cache
def _uses() -> dict[str, dict[Path, list[Place]]]:
    """Return where each name is used, in all modules."""
    found = defaultdict[str, dict[Path, list[Place]]](dict)
    for path in (path for root in ROOTS for path in sorted((TREE / root).rglob("*.py"))):
        for node, stands in _statements(path):
            names = {one.id for one in _own(node) if isinstance(one, ast.Name)}
            names |= {one.attr for one in _own(node) if isinstance(one, ast.Attribute)}
            for name in names:
                found[name].setdefault(path, []).append(stands)
    return found


@cache
def _words(path: Path) -> frozenset[str]:
    return frozenset(re.findall(r"\w+", path.read_text(encoding="utf-8")))


def users(path: Path, names: Iterable[str]) -> Iterator[tuple[Path, int]]:
    """Yield the lines of Python functions that use a name of a module, or one that is made of it, also in others.

    A module is looked at if it says the name of the module, or of its package, as one does that imports from it.
    """
    waiting = [(path, name) for name in sorted(names)]
    seen = set(waiting)
    while waiting:
        origin, name = waiting.pop(0)
        if len(name) < 3 or name.startswith("__"):
            continue
        for module, places in _uses().get(name, {}).items():
            if module != origin and _words(module).isdisjoint((origin.stem, origin.parent.name)):
                continue
            for stands in places:
                if stands.function:
                    yield from ((module, line) for line in stands.statement)
                elif len(seen) < NAMES:
                    more = {(module, made) for made in stands.names} - seen
                    seen |= more
                    waiting += sorted(more)


@dataclass(slots=True)
class Reached:
    """Which tests of the tree reach which line, what each costs [s], and from whom it has a fixture."""

    tests: list[str] = field(default_factory=list)
    cost: dict[str, float] = field(default_factory=dict)
    lines: dict[tuple[str, int], array[int]] = field(default_factory=dict)

    def add(self, folder: Path, commit: str = "") -> None:
        """Read what ``reach.py`` wrote at a commit; "": the one that stands in it, or all is as it was.

        Of a test that is known the newer one, which is added first, counts.
        """
        content = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))]
        at = commit or next((part["commit"] for part in content if part.get("commit")), "")
        moved = _moved(at) if at else {}
        known = set(self.cost)
        for part in content:
            for test, cost in part["cost"].items():
                self.cost.setdefault(test, cost)
            for test, lines in part["reached"].items():
                if test in known:
                    continue
                number = len(self.tests)
                self.tests.append(test)
                now = set[tuple[str, int]]()
                for entry in lines:
                    path, _, line = entry.rpartition(":")
                    if path in moved:
                        now.update((path, one) for one in moved[path].get(int(line), ()))
                    else:
                        now.add((path, int(line)))
                for one in now:
                    self.lines.setdefault(one, array("i")).append(number)

    def of_lines(self, lines: Iterable[tuple[Path, int]]) -> set[str]:
        """Return the tests that reach any of some lines."""
        keys = {(str(path.relative_to(TREE)), line) for path, line in lines}
        return {self.tests[number] for key in keys for number in self.lines.get(key, ())}

    def of(self, mutant: Mutant) -> tuple[set[str], bool]:
        """Return the tests that reach a mutant's line, and whether those of the room are to meet it, too."""
        stands = place(mutant.path, mutant.line)
        seen = self.of_lines((mutant.path, line) for line in stands.statement) if stands.function else set[str]()
        if stands.function and not seen:
            seen = self.of_lines((mutant.path, line) for line in stands.function)
        if not stands.function:
            seen = self.of_lines(users(mutant.path, stands.names))
        return seen, not stands.function or not seen


def _moved(commit: str) -> dict[str, dict[int, list[int]]]:
    """Return, of each file that has changed since a commit, where its lines stand now; a changed line is all new ones."""
    git = ["git", "-C", str(TREE)]
    names = subprocess.run(
        [*git, "diff", "--name-only", commit, "--", *ROOTS], capture_output=True, text=True, check=True
    )
    found = dict[str, dict[int, list[int]]]()
    for name in names.stdout.splitlines():
        was = subprocess.run([*git, "show", f"{commit}:{name}"], capture_output=True, text=True, check=False).stdout
        now = (TREE / name).read_text(encoding="utf-8") if (TREE / name).is_file() else ""
        found[name] = moved(was, now)
    return found


def moved(was: str, now: str) -> dict[int, list[int]]:
    """Return where the lines of a text stand in a newer one."""
    found = defaultdict[int, list[int]](list)
    codes = difflib.SequenceMatcher(None, was.splitlines(), now.splitlines(), autojunk=False).get_opcodes()
    for kind, a, b, c, d in codes:
        for line in range(a, b):
            found[line + 1] = [line - a + c + 1] if kind == "equal" else list(range(c + 1, d + 1))
    return dict(found)


# --- the tests that are there --------------------------------------------------------------------------------------------


class _Collector:
    """Notes each test that is there, and the fixtures that it shares with others."""

    def __init__(self, out: Path) -> None:
        self.out = out

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        found = {item.nodeid: sorted(_shared(item)) for item in items}
        self.out.write_text(json.dumps(found), encoding="utf-8")


def _shared(item: Any) -> Iterator[str]:
    known = item._fixtureinfo.name2fixturedefs
    for name in item.fixturenames:
        definition = known.get(name, (None,))[-1]
        if definition is not None and definition.scope != "function" and definition.baseid.startswith("tests/"):
            yield f"{definition.baseid}:{name}"


def collected(work: Path) -> dict[str, list[str]]:
    """Return the tests of the short form that are there, each with the fixtures that it shares."""
    out = work / "collected.json"
    words = ["--collect-only", *OPTIONS, str(HERE)]
    _in_a_process_of_its_own(lambda: int(pytest.main(words, plugins=[_Collector(out)])))
    found: dict[str, list[str]] = json.loads(out.read_text(encoding="utf-8"))
    return found


def keep_kernels(work: Path) -> None:
    """Begin with the kernels that this user has compiled already, in the folder of the campaign (``mutation.prepare``)."""
    ask = "import os; os.environ.pop('ITOUCH_KERNELS'); from itouch import compiling; print(compiling.folder())"
    done = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True)
    folder = Path(done.stdout.strip())
    if folder.is_dir():
        shutil.copytree(folder, work / "kernels", dirs_exist_ok=True)


def _in_a_process_of_its_own(work: Callable[[], int]) -> None:
    child = os.fork()
    if child == 0:
        os._exit(guarded(work))
    os.waitpid(child, 0)


def guarded(work: Callable[[], int]) -> int:
    """Return what some work returns, silently; 99 if it raises."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    try:
        return int(work())
    except BaseException:
        return 99


@dataclass(slots=True)
class Tests:
    """All tests that are there, and the order in which mutants meet them.

    One of which is not known what it reaches is met if its file imports what is changed, before the others, or if it is
    of the room, after them.
    """

    reached: Reached
    #: Each test's fixtures that it shares.
    there: dict[str, list[str]]
    #: Of each test those whose fixtures it has, too: what they reach, it reaches.
    heirs: dict[str, set[str]] = field(default_factory=dict)
    cost: dict[str, float] = field(default_factory=dict)
    #: Those that are newer than what is known, or waited for the long form then: nobody knows what they reach.
    new: Set[str] = frozenset()

    def __post_init__(self) -> None:
        first = dict[str, str]()
        self.cost = {test: self.reached.cost[test] for test in self.reached.cost if test in self.there}
        for test in self.cost:  # as they ran
            for name in self.there[test]:
                maker = first.setdefault(name, test)
                if maker != test:
                    self.heirs.setdefault(maker, set()).add(test)
        for maker, heirs in self.heirs.items():
            for test in heirs:
                self.cost[test] = max(self.cost[test], self.reached.cost[maker])

        cases = defaultdict[str, list[str]](list)
        for test in self.cost:
            cases[test.partition("[")[0]].append(test)
        self.new = self.there.keys() - self.cost.keys()
        for test in self.new:  # a new case reaches what any other of its function does
            for case in cases.get(test.partition("[")[0], ()):
                self.heirs.setdefault(case, set()).add(test)
        self.cost |= dict.fromkeys(self.new, UNKNOWN)

    def of_room(self, room: str) -> set[str]:
        """Return the tests of a room, also those in its folder that start processes."""
        names = (f"tests/{room}", *(f"tests/{name}" for name in ROOMS[room][1]))
        return {test for test in self.cost if any(_below(test, name) for name in names)}

    def of(self, mutant: Mutant) -> list[str]:
        """Return the tests that a mutant meets, in order."""
        seen, with_room = self.reached.of(mutant)
        seen |= {heir for test in seen for heir in self.heirs.get(test, ())}
        seen &= self.there.keys()
        own, name = self.of_room(mutant.room), Changed(mutant).name
        files = {test.partition("::")[0] for test in self.cost}
        near = {file for file in files if (TREE / file).is_file() and names(TREE / file, name)}
        first = {test for test in self.new if test.partition("::")[0] in near}
        last = (own - seen if with_room else own & self.new) - first
        words = said(mutant.path, mutant.line)
        direct = {test for test in first | seen | last if self.cost[test] <= COSTLY and words & spoken(test)}
        page = {test for test in own if with_room and test.startswith(f"tests/{PAGE}")}  # made again in a moment
        if _text(mutant.path).splitlines()[mutant.line - 1].lstrip().startswith("@dataclass"):
            page |= {test for test in self.cost if test.startswith(f"tests/{DATACLASSES}")}
        direct -= page
        parts = (page, direct, first - direct - page, seen - direct - page, last - direct - page)
        return [test for part in parts for test in in_order(part, own, self.cost, near)]


def _below(test: str, name: str) -> bool:
    return test == name or test.startswith((f"{name}/", f"{name}::", f"{name}["))


@cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def names(path: Path, module: str) -> bool:
    """Tell whether a file imports from a module by its name, or from its package, which may hand on what is in it."""
    package, _, last = module.rpartition(".")
    parts = rf"\b{re.escape(module)}\b|from {re.escape(package)} import "
    return re.search(parts if package else rf"\bimport {last}\b", _text(path)) is not None


def said(path: Path, line: int) -> frozenset[str]:
    """Return the names by which a line's function and classes, or what it makes at import, are called."""
    found = set(place(path, line).names)
    for node in ast.walk(_parsed(path)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.lineno <= line <= (node.end_lineno or node.lineno):
            found.add(node.name)
    return frozenset(name for name in found if len(name) > 3 and not name.startswith("__"))


@cache
def _bodies(path: Path) -> dict[str, frozenset[str]]:
    """Return the words of each function of a file of tests."""
    text = _text(path)
    return {
        node.name: frozenset(re.findall(r"\w+", ast.get_source_segment(text, node) or ""))
        for node in ast.walk(_parsed(path)) if isinstance(node, ast.FunctionDef)
    }  # fmt: skip


def spoken(test: str) -> frozenset[str]:
    """Return the words of a test's function."""
    file, _, function = test.partition("[")[0].rpartition("::")
    path = TREE / file.partition("::")[0]
    return _bodies(path).get(function, frozenset()) if path.is_file() else frozenset()


def in_order(
    tests: Iterable[str], own: set[str], cost: dict[str, float], near: frozenset[str] | set[str] = frozenset()
) -> list[str]:
    """Return tests in order: those of files that import what is changed first, of these and then of others by cases.

    That is a case of each before further ones, then those of the room, then about what they cost, by file; what is
    costly comes after all of these: one such test may use up what a mutant has.
    """
    cases, keyed = defaultdict[str, int](int), list[tuple[Any, str]]()
    for test in sorted(tests, key=lambda test: (cost[test], test)):
        function, file = test.partition("[")[0], test.partition("::")[0]
        step = sum(cost[test] > bound for bound in (0.03, 0.1, 0.3, 1.0, 3.0, 10.0))
        further, far = cases[function] > 0, file not in near
        keyed.append(((far, cost[test] > COSTLY, further, test not in own, step, file, cost[test], test), test))
        cases[function] += 1
    return [test for _, test in sorted(keyed)]


# --- meeting them --------------------------------------------------------------------------------------------------------


class _Chosen:
    """Runs some tests of some files, in a given order, until they have used up their time; tells a file how it goes."""

    def __init__(self, tests: Sequence[str], log: Path, budget: float) -> None:
        self.order, self.budget = {test: place for place, test in enumerate(tests)}, budget
        self.log = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self.session: Any = None

    def _tell(self, what: str, name: str) -> None:
        spent = sum(os.times()[:4])
        os.write(self.log, (json.dumps([what, name, spent]) + "\n").encode())

    def pytest_sessionstart(self, session: Any) -> None:
        self.session = session

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = sorted(
            (item for item in items if item.nodeid in self.order), key=lambda item: self.order[item.nodeid]
        )

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed:
            self._tell("collect", report.nodeid)

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._tell("start", nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self._tell("failed", report.nodeid)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self._tell("end", nodeid)
        if sum(os.times()[:4]) > self.budget:
            self.session.shouldstop = "the budget is used up"


@dataclass(slots=True)
class Ran:
    """How some tests went: those that ended, the one that failed, or in which the process ended or hung; what it took [s]."""

    done: set[str] = field(default_factory=set)
    suspect: str = ""
    how: str = ""
    spent: float = 0.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """The test that notices a mutant, and how; processor time of the tests [s]; whether more tests than that were there."""

    by: str = ""
    how: str = ""
    spent: float = 0.0
    cut: bool = False


@dataclass(slots=True)
class Meeting:
    """Lets tests meet mutants, in processes forked from this one; remembers which of them pass like that at all."""

    tests: Tests
    work: Path
    #: Processor time [s] that a mutant's tests may take.
    budget: float = 60.0
    passes: dict[str, bool] = field(default_factory=dict)

    def run(self, mutant: Mutant | None, tests: Sequence[str], budget: float) -> Ran:
        """Run tests with a mutant, or with none, until one fails, one says nothing for long, or the time is used up."""
        log = self.work / "log"
        log.write_text("", encoding="utf-8")
        patience = PATIENCE if mutant is None or not is_compiled(mutant.path) else 3.0 * PATIENCE
        child = os.fork()
        if child == 0:
            os.setsid()
            os._exit(guarded(lambda: _run(mutant, tests, log, budget)))
        code: int | None = None
        size, silent, used, allowed = -1, time.monotonic(), _used(child), patience
        while True:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                code = os.waitstatus_to_exitcode(status)
                break
            if log.stat().st_size != size:
                size, silent, used = log.stat().st_size, time.monotonic(), _used(child)
                told = _told(log)
                allowed = patience + 10.0 * self.tests.cost.get(told[-1][1] if told else "", 0.0)
            if hangs(time.monotonic() - silent, _used(child) - used, allowed):
                break
            time.sleep(0.005)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # also what it has started and not ended
        if code is None:
            os.waitpid(child, 0)
        return _ran(_told(log), tests, code)

    def stands(self, test: str) -> bool:
        """Tell whether a test passes alone as the program is, in the same kind of process."""
        if test not in self.passes:
            ran = self.run(None, [test], 1e9)
            self.passes[test] = not ran.suspect and test in ran.done
        return self.passes[test]

    def meet(self, mutant: Mutant, tests: Sequence[str]) -> Outcome:
        """Let tests meet a mutant, in parts, until one notices it or the budget is used up."""
        left, spent, parts = [test for test in tests if self.passes.get(test, True)], 0.0, iter(PARTS)
        while left and spent < self.budget:
            size = next(parts, len(left))
            part, left = left[:size], left[size:]
            while part and spent < self.budget:
                ran = self.run(mutant, part, self.budget - spent)
                spent += ran.spent
                if ran.suspect and self.stands(ran.suspect):
                    # a file may not be collected for what it stands beside
                    enough = ran.how == "hangs" or part == [ran.suspect] or (not ran.done and ran.how == "fails")
                    alone = ran if enough else self.run(mutant, [ran.suspect], 1e9)
                    if alone.suspect:
                        return Outcome(ran.suspect, alone.how, spent)
                gone = ran.done | {ran.suspect}
                if ran.how == "is not collected":
                    file = ran.suspect.partition("::")[0]
                    gone |= {test for test in part if test.partition("::")[0] == file}
                if not ran.suspect and spent < self.budget:
                    gone = set(part)  # what is not there with the mutant does not notice it
                part = [test for test in part if test not in gone]
            left = part + left
        return Outcome(spent=spent, cut=bool(left))


def hangs(silent: float, used: float, allowed: float) -> bool:
    """Tell whether a process that was silent for a time [s] hangs, by what it has used of a processor [s] meanwhile.

    One that waits may wait for others that have to share the processors with yet others.
    """
    busy = os.getloadavg()[0] / (os.cpu_count() or 1)
    waits = used < 0.02 * silent
    return used > allowed or (waits and silent > allowed * max(1.0, 2.0 * busy))


def _used(process: int) -> float:
    """Return the processor time [s] of a process and of its children that have ended; where nobody tells, any time."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except OSError:
        return time.monotonic()
    return sum(map(int, stat.rpartition(")")[2].split()[11:15])) / os.sysconf("SC_CLK_TCK")


#: What a Python that a test starts does first: it finds the mutant, too.
ELSEWHERE = """
import importlib.abc, importlib.util, sys

class Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(self, name, path, target=None):
        if name != {name!r}:
            return None
        places = [{folder!r}] if {path!r}.endswith("__init__.py") else None
        return importlib.util.spec_from_file_location(name, {path!r}, loader=self, submodule_search_locations=places)

    def exec_module(self, module):
        with open({source!r}, encoding="utf-8") as file:
            exec(compile(file.read(), {path!r}, "exec"), module.__dict__)

sys.meta_path.insert(0, Changed())
"""


def _elsewhere(mutant: Mutant | None, folder: Path) -> None:
    """Let processes that start from here find a mutant, or none: they look at ``sitecustomize`` in a folder of its own."""
    shutil.rmtree(folder, ignore_errors=True)  # with what was compiled of the last one
    folder.mkdir()
    text = ""
    if mutant is not None:
        (folder / "changed.txt").write_text(mutant.source, encoding="utf-8")
        text = ELSEWHERE.format(
            name=Changed(mutant).name, folder=str(mutant.path.parent), path=str(mutant.path),
            source=str(folder / "changed.txt"),
        )  # fmt: skip
    (folder / "sitecustomize.py").write_text(text, encoding="utf-8")
    before = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = f"{folder}{os.pathsep}{before}" if before else str(folder)


def _as_text(mutant: Mutant) -> None:
    """Let who reads the file of a mutant read the mutant."""
    reads = Path.read_text

    def read_text(path: Path, *args: Any, **options: Any) -> str:
        return mutant.source if path == mutant.path else reads(path, *args, **options)

    Path.read_text = read_text  # type: ignore[method-assign, assignment]


def _run(mutant: Mutant | None, tests: Sequence[str], log: Path, budget: float) -> int:
    _elsewhere(mutant, log.parent / "start")
    if mutant is not None:
        sys.meta_path.insert(0, Changed(mutant))
        _as_text(mutant)
    files = list(dict.fromkeys(test.partition("::")[0] for test in tests))
    return int(pytest.main(["-x", *OPTIONS, *files], plugins=[_Chosen(tests, log, budget)]))


def _told(log: Path) -> list[tuple[str, str, float]]:
    lines = log.read_text(encoding="utf-8").split("\n")[:-1]
    return [(what, name, spent) for what, name, spent in map(json.loads, lines)]


def _ran(told: Sequence[tuple[str, str, float]], tests: Sequence[str], code: int | None) -> Ran:
    """Return how tests went, by what they told, and the exit code of their process; None: they were ended, as they hung."""
    ran = Ran(spent=told[-1][2] if told else 0.0)
    running = ""
    for what, name, _ in told:
        if what == "failed":
            ran.suspect, ran.how = name, "fails"
            return ran
        if what == "collect":
            ran.suspect = next((test for test in tests if test.partition("::")[0] == name), tests[0])
            ran.how = "is not collected"
            return ran
        running = name if what == "start" else ""
        if what == "end":
            ran.done.add(name)
    stopped = code in (0, 2, 5) and not running  # all passed, the time was used up, or none was there
    if not stopped:
        ran.suspect = running or next((test for test in tests if test not in ran.done), tests[0])
        ran.how = "hangs" if code is None else f"ends with exit code {code}"
    return ran
