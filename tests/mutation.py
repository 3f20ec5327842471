"""Mutants of the program, and whether the tests notice: ``python tests/mutation.py [--sample N] [--seed S] [ROOM ...]``.

``--module NAME`` draws them from the modules of this name alone.

cosmic-ray makes the mutants, drawn over all rooms alike.  First the tests of a room run as they are, under coverage, to
learn which test reaches which line.  Then each mutant meets only the tests that reach its line, quickest first, in a
process forked from one that has imported all else.  A mutant that none of them notices has survived.  Compiled kernels are not
seen by coverage: their mutants meet all tests of the room.  What is compiled is kept by its fingerprint in a folder that
goes with the campaign, so that of a changed kernel only it and its callers are compiled anew.

Tests that a whole run of the short form leaves out (``long_form.txt``) meet what the others have let live: two scores, and
the test that alone notices is named, which is a reason to put it into ``short_form.txt``.

What has survived is told by the line as it was and as it was changed.  Changes that were read and found to change nothing
stand in ``equivalent_mutants.toml``; the score is printed raw, which is the one that counts, and without these.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import importlib
import importlib.abc
import importlib.util
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from forms import KEPT, LIST, read_list, stands_in

HERE = Path(__file__).resolve().parent
TREE = HERE.parent
#: Tests of the supervisor that need no scene and no compiler; those that do.
SAFETY = (
    "guard", "readings", "heat", "carrier", "finger", "monitors", "supervisor", "hold_connect", "sequence", "blind_retreat",
    "joined_steps", "edges", "check_warm_up", "at_the_limits", "blind_legs",
)  # fmt: skip
SCENES = (
    "two_on_one_finger", "laws", "phases", "unknown_devices", "attack_findings", "exchanged", "late_in_a_stop",
    "several_of_a_kind", "torque",
)  # fmt: skip
#: Tests of what goes between processes, in one; those that start and kill some are left out, but for the launch.
SERVO = ("memory", "watchdogs", "launch", "both_ends", "deadman_holders")
#: The page of all attributes, which says the bounds and the default of each.
PAGE = "docs/test_reference_pages.py"
#: Room -> the folder of its modules and the tests that answer for it, if they are not those in the folder of its name.
ROOMS: dict[str, tuple[str, tuple[str, ...]]] = {
    "safety": ("framework/itouch/safety", tuple(f"safety/test_{name}.py" for name in (*SAFETY, *SCENES))),
    "monitors": ("framework/itouch/monitors", tuple(f"safety/test_{name}.py" for name in (*SAFETY, *SCENES))),
    **{name: (f"framework/itouch/{name}", (name,)) for name in (
        "exchange", "loop", "recording", "session", "arms", "dynamics", "world",
    )},
    **{name: (f"framework/itouch_tools/{name}", (name,)) for name in ("report", "sound", "study")},
    "export": ("framework/itouch_tools/export", ("recording", "cli/test_session_commands.py")),
    "authoring": ("framework/itouch_tools/authoring", ("scene",)),
    "scene": ("framework/itouch/scene", ("scene", "meaning", "loop/test_waits.py", PAGE)),
    "schema": ("framework/itouch/schema", ("schema", "scene", PAGE)),
    "faults": ("framework/itouch/faults", ("safety/test_faults.py",)),
    "servo": ("framework/itouch/servo", (
        *(f"servo/test_{name}.py" for name in SERVO),
        "servo/test_hanging_process.py::test_a_silent_process_has_its_time_by_what_it_gets_of_a_processor",
    )),
    "cli": ("framework/itouch_tools/cli", (
        "cli", "scene/test_problems.py", "docs/test_codes.py", "session/test_triggers.py",
        "study/test_power_and_exports.py", "study/test_report_intervals.py",
    )),
    "plugin": ("framework/itouch/plugin", (
        "plugins/test_result_cache.py", "plugins/test_poses_and_fits.py", "world", "loop/test_engine.py",
        "loop/test_one_writer_of_commands.py", "compiling/test_plugin_noise.py",
    )),
    "twin": ("framework/itouch/twin", ("loop/test_engine.py", "world/test_coupling.py")),
    "viewer": ("framework/itouch_tools/viewer", ("viewer/test_picture_content.py", "viewer/test_recording_seek.py")),
    "contact": ("framework/itouch/contact", ("contact",)),
    "thermal": ("plugins/thermal/contact_heat", ("plugins/thermal",)),
    "thermal-display": ("plugins/thermal/itouch_thermal/display", ("plugins/thermal_display", PAGE)),
    "thermal-flux": ("plugins/thermal/itouch_thermal/flux", ("plugins/thermal_display", PAGE)),
    "thermal-drivers": ("plugins/thermal/itouch_thermal/drivers", ("plugins/thermal_drivers", PAGE)),
    "xyz-table": ("plugins/xyz_table/itouch_xyz_table", ("plugins/xyz_table", PAGE)),
    "encountered": (
        "plugins/xyz_table/itouch_encountered", ("integration/test_encountered_surface.py", "loop/test_missing_plate.py"),
    ),
    "usb-arm": ("plugins/usb_arm/itouch_usb_arm", ("plugins/usb_arm", PAGE)),
}  # fmt: skip
#: How long [s] the tests of a mutant may take beyond thrice what they take without it; one that hangs is noticed.
PATIENCE = 60.0
_OPTIONS = ("-q", "-p", "no:cacheprovider", "--no-header", "--tb=no", "-o", "filterwarnings=ignore", "-m", "not long")
_FAMILIES = ("ReplaceBinaryOperator_Add_Sub", "ReplaceBinaryOperator_Sub_Add", "ReplaceBinaryOperator_Mul_Div",
             "ReplaceBinaryOperator_Div_Mul", "ReplaceBinaryOperator_FloorDiv_Mul", "ReplaceBinaryOperator_Mod_Mul",
             "ReplaceBinaryOperator_Pow_Mul", "ReplaceBinaryOperator_BitAnd_BitOr",
             "ReplaceBinaryOperator_BitOr_BitAnd", "ReplaceComparisonOperator_Lt_LtE",
             "ReplaceComparisonOperator_LtE_Lt", "ReplaceComparisonOperator_Gt_GtE", "ReplaceComparisonOperator_GtE_Gt",
             "ReplaceComparisonOperator_Lt_Gt", "ReplaceComparisonOperator_LtE_GtE", "ReplaceComparisonOperator_Gt_Lt",
             "ReplaceComparisonOperator_GtE_LtE", "ReplaceComparisonOperator_Eq_NotEq",
             "ReplaceComparisonOperator_NotEq_Eq", "ReplaceComparisonOperator_Is_IsNot",
             "ReplaceComparisonOperator_IsNot_Is", "ReplaceUnaryOperator_Delete_USub",
             "ReplaceUnaryOperator_Delete_Not", "AddNot", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue",
             "ReplaceAndWithOr", "ReplaceOrWithAnd", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak",
             "ExceptionReplacer", "NumberReplacer", "ZeroIterationForLoop")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of one module: the file, the line, the operator that made it, and the changed source."""

    room: str
    path: Path
    line: int
    operator: str
    source: str

    @property
    def name(self) -> str:
        """File, line and operator."""
        return f"{self.path.relative_to(TREE)}:{self.line}: {self.operator}"

    @property
    def change(self) -> tuple[str, str, str]:
        """The file, the lines that are changed as they stand, and as they are changed; blanks do not count."""
        before, after = self.path.read_text(encoding="utf-8").splitlines(), self.source.splitlines()
        codes = difflib.SequenceMatcher(None, before, after, autojunk=False).get_opcodes()
        spans = [span for span in codes if span[0] != "equal"]
        old = [line for _, first, last, _, _ in spans for line in before[first:last]]
        new = [line for _, _, _, first, last in spans for line in after[first:last]]
        return str(self.path.relative_to(TREE)), bare("\n".join(old)), bare("\n".join(new))


def bare(text: str) -> str:
    """Return a text without blanks."""
    return "".join(text.split())


def equivalents() -> dict[tuple[str, str, str], str]:
    """Return the changes that change nothing, with the reason: file, line as it stands, line as it is changed."""
    content = tomllib.loads((HERE / "equivalent_mutants.toml").read_text(encoding="utf-8"))
    return {
        (entry["file"], bare(entry["line"]), bare(changed)): entry["reason"]
        for entry in content["mutant"]
        for changed in entry["changed"]
    }


@dataclass(slots=True)
class Reach:
    """Which tests of a room reach a line, and how long each takes [s]; ``passed``: whether all pass as it is."""

    passed: bool = True
    lines: dict[str, dict[int, list[str]]] = field(default_factory=dict)
    took: dict[str, float] = field(default_factory=dict)

    def of(self, mutant: Mutant) -> list[str]:
        """Return the tests for a mutant, quickest first: those that reach its line, else all."""
        lines = self.lines.get(str(mutant.path), {})
        found = set(lines.get(mutant.line, ())) if not _compiled(mutant.path) else set[str]()
        found = found or set(self.took)  # what runs at import is in nobody's reach, and in everybody's
        return sorted(found, key=lambda test: self.took.get(test, 0.0))


def modules(room: str, name: str = "") -> list[Path]:
    """Return the modules of a room, or those of this name."""
    found = sorted(path for path in (TREE / ROOMS[room][0]).rglob("*.py") if path.stat().st_size > 200)
    return [path for path in found if name in ("", path.stem)]


def _compiled(path: Path) -> bool:
    text = path.read_text(encoding="utf-8")
    return any(word in text for word in ("@kernel", "@nogil_kernel", "@entry", "@inner", "@flat", "@making", "@njit"))


def draw(rooms: Sequence[str], count: int, seed: int, module: str = "") -> list[Mutant]:
    """Draw mutants at random: of each room as many, within it each place of each module, or of one, alike."""
    dice, found = random.Random(seed), list[Mutant]()
    share = -(-count // len(rooms))
    for room in rooms:
        places = [(path, place) for path in modules(room, module) for place in _places(path)]
        dice.shuffle(places)
        taken = 0
        for path, place in places:
            if taken == share or len(found) == count:
                break
            mutant = _mutant(room, path, *place)
            if mutant is not None:
                found.append(mutant)
                taken += 1
    return found


def _places(path: Path) -> Iterator[tuple[int, str, int]]:
    """Yield line, operator and occurrence of each place of a file where an operator has something to change."""
    import parso  # noqa: F401  - first: the next import would go round in a circle
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator

    nodes = list(ast_nodes(get_ast(path.read_text(encoding="utf-8"))))
    for name in _FAMILIES:
        operator, occurrence = get_operator(f"core/{name}")(), 0
        for node in nodes:
            for (line, _), _ in operator.mutation_positions(node):
                yield line, name, occurrence
                occurrence += 1


def _mutant(room: str, path: Path, line: int, name: str, occurrence: int) -> Mutant | None:
    """Return a mutant, or None if it says the same: in an annotation, or not at all."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    before = path.read_text(encoding="utf-8")
    after = mutate_code(before, get_operator(f"core/{name}")(), occurrence)
    try:
        if after is None or _meaning(after) == _meaning(before):
            return None
    except SyntaxError:
        return None
    return Mutant(room, path, line, name, after)


class _Bare(ast.NodeTransformer):
    """Leaves out what has no effect when the program runs: annotations, ``TYPE_CHECKING``, names of slots."""

    def visit_arguments(self, node: ast.arguments) -> ast.AST:
        """Take no notice of the bare ``*`` or ``/`` of a signature: it is no operator, and computes nothing."""
        node.args, node.posonlyargs = [*node.posonlyargs, *node.args, *node.kwonlyargs], []
        node.defaults += [default for default in node.kw_defaults if default is not None]
        node.kwonlyargs, node.kw_defaults = [], []
        return self.generic_visit(node)

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        return self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.annotation = ast.Constant(None)
        return self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST | None:
        return None if "TYPE_CHECKING" in ast.unparse(node.test) else self.generic_visit(node)


def _meaning(source: str) -> str:
    return ast.dump(_Bare().visit(ast.parse(source)))


class Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Offers a mutant in the place of its module."""

    def __init__(self, mutant: Mutant) -> None:
        self.mutant = mutant
        root = next(p for p in mutant.path.parents if not (p / "__init__.py").exists())
        self.name = ".".join(mutant.path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")

    def find_spec(self, name: str, path: object, target: object = None) -> Any:
        """Answer for the one module."""
        if name != self.name:
            return None
        package = self.mutant.path.name == "__init__.py"
        return importlib.util.spec_from_file_location(
            name, self.mutant.path, loader=self,
            submodule_search_locations=[str(self.mutant.path.parent)] if package else None,
        )  # fmt: skip

    def exec_module(self, module: ModuleType) -> None:
        """Run the changed code."""
        exec(compile(self.mutant.source, str(self.mutant.path), "exec"), module.__dict__)


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
        os._exit(_guarded(lambda: _learn(room, work, out)))
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
    code = int(pytest.main([*_OPTIONS, *_tests(room)], plugins=[watch]))
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
        os._exit(_guarded(lambda: _meet(mutant, tests, first)))
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
    return int(pytest.main(["-x", *_OPTIONS, *tests], plugins=[_First(noticed)]))


class _First:
    """Writes which test failed first."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self.path.write_text(report.nodeid, encoding="utf-8")


def _guarded(work: Any) -> int:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    try:
        return int(work())
    except BaseException:
        return 99


def prepare(work: Path) -> None:
    """Import all that is slow to import, but nothing that is mutated; keep no results of mutants, and no kernels of theirs."""
    import scipy.linalg  # noqa: F401

    os.environ |= {"ITOUCH_KEPT": "off", "ITOUCH_KERNELS": str(work / "kernels")}
    os.environ.pop("NUMBA_CACHE_DIR", None)
    os.chdir(TREE)
    assert not any(name.startswith("itouch") for name in sys.modules)


@dataclass(slots=True)
class Met:
    """What became of the mutants of a room: how many there were, which lived, and which only the long form noticed."""

    count: int = 0
    alive: list[Mutant] = field(default_factory=list)
    late: list[Mutant] = field(default_factory=list)


def campaign(rooms: Sequence[str], count: int, seed: int, work: Path, module: str = "") -> dict[str, Met]:
    """Draw mutants of some rooms, let the tests meet them, and return what became of them, by room."""
    drawn, found, listed, kept = draw(rooms, count, seed, module), dict[str, Met](), read_list(LIST), read_list(KEPT)
    for room in rooms:
        chosen = [mutant for mutant in drawn if mutant.room == room]
        reach = learn(room, work)
        if not reach.passed:
            print(f"{room}: its tests fail as it is: left out", flush=True)
            continue
        met = found[room] = Met(len(chosen))
        for mutant in chosen:
            tests = reach.of(mutant)
            later = [test for test in tests if stands_in(test, listed) and not stands_in(test, kept)]
            if notices(mutant, reach, [test for test in tests if test not in later], work):
                continue
            by = notices(mutant, reach, later, work)
            _, before, after = mutant.change
            change = f"{mutant.name}: {before} -> {after}"
            if by:
                met.late.append(mutant)
                print(f"noticed by the long form alone, {by}: {change}", flush=True)
            else:
                met.alive.append(mutant)
                print(f"survived: {change}", flush=True)
        print(
            f"{room}: {met.count - len(met.alive)} of {met.count} noticed, {len(met.late)} by the long form alone",
            flush=True,
        )
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaign; exit code 1 if less than 80 % are noticed, or 90 % in safety."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help=f"default: all of {', '.join(ROOMS)}")
    parser.add_argument("--sample", type=int, default=300, metavar="N", help="how many, over all rooms (default 300)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--module", default="", metavar="NAME", help="of the modules of this name alone")
    options = parser.parse_args(argv)
    rooms = options.rooms or list(ROOMS)
    work = Path(tempfile.mkdtemp(prefix="itouch-mutation-"))
    try:
        prepare(work)
        found = campaign(rooms, options.sample, options.seed, work, options.module)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    count, alive = sum(met.count for met in found.values()), sum(len(met.alive) for met in found.values())
    late = sum(len(met.late) for met in found.values())
    if not count:
        return 2
    score = 1.0 - (alive + late) / count
    print(f"{count} mutants, {count - alive} noticed, {alive} survived: {100 - 100 * alive / count:.1f} %")
    print(f"by a whole run of the short form: {count - alive - late}: {100 * score:.1f} %")
    known = equivalents()
    same = sum(mutant.change in known for met in found.values() for mutant in met.alive)
    if same and count > same:
        part = (count - alive) / (count - same)
        print(f"without {same} that change nothing (equivalent_mutants.toml): {100 * part:.1f} %")
    safety = found.get("safety", Met())
    return 0 if score >= 0.8 and len(safety.alive) + len(safety.late) <= 0.1 * safety.count else 1


if __name__ == "__main__":
    sys.exit(main())
