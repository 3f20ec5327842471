"""The tests notice what is wrong: a change of the program by hand here, hundreds drawn at random in the long form."""

from __future__ import annotations

import ast
import importlib.util
import json
import subprocess
import sys
from array import array
from pathlib import Path

import mutant_runner
import mutants
import mutation
import pytest
from shipped import REPOSITORY

HERE = Path(__file__).parent

BY_HAND = """
import sys
sys.path.insert(0, {here!r})
import mutants
import mutation
work = mutation.Path(sys.argv[1])
mutation.prepare(work)
path = mutation.TREE / "framework/itouch/safety/limiting.py"
as_it_is = path.read_text(encoding="utf-8")
tests = ["tests/safety/test_guard.py"]
assert as_it_is.count({old!r}) >= 1
control = mutation.Mutant("safety", path, 1, "nothing", as_it_is)
changed = mutation.Mutant("safety", path, 1, "by hand", as_it_is.replace({old!r}, {new!r}))
for mutant in (control, changed):
    print(bool(mutation.notices(mutant, mutation.Reach(), tests, work)))
"""


@pytest.mark.long
def test_a_guard_that_clamps_the_wrong_way_is_noticed(tmp_path: Path) -> None:
    code = BY_HAND.format(
        here=str(HERE), old="kept = min(max(values[i], low), high)", new="kept = max(min(values[i], low), high)"
    )
    words = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(words, cwd=REPOSITORY, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]


@pytest.mark.parametrize("entry", sorted(mutation.equivalents()), ids=lambda entry: "")
def test_what_is_said_to_change_nothing_is_one_line_that_is_still_there(entry: tuple[str, str, str]) -> None:
    file, line, changed = entry
    lines = [mutants.bare(one) for one in (REPOSITORY / file).read_text(encoding="utf-8").splitlines()]
    assert lines.count(line) == 1, f"{line!r} stands in {file} {lines.count(line)} times: it would hide another"
    assert line != changed


def test_a_change_that_is_listed_hides_no_other() -> None:
    path = REPOSITORY / "framework/itouch/monitors/readings_kernels.py"
    text = path.read_text(encoding="utf-8")

    def change(old: str, new: str) -> tuple[str, str, str]:
        return mutation.Mutant("monitors", path, 1, "by hand", text.replace(old, new)).change

    assert change("total = 0.0", "total =  1.0") in mutation.equivalents()
    assert change("total = 0.0", "total = 2.0") not in mutation.equivalents()
    assert change("if apart >", "if apart >=") not in mutation.equivalents()
    assert change("if apart >", "if apart >=")[1:] == ("ifapart>limits.apart[0]:", "ifapart>=limits.apart[0]:")


#: A program of one line, and tests of which not each is to be believed.
PROGRAM = "def answer() -> int:\n    return 42\n"
OF_IT = {
    "test_plain.py": "import program\ndef test_it(): assert program.answer() == 42",
    "test_broken.py": "import program\ndef test_it(): assert program.answer() == 43",
    "test_leaves.py": (
        "import program, os\ndef test_first(): os.environ['LEFT'] = str(program.answer())\n"
        "def test_second(): assert os.environ.get('LEFT', '42') == '42'"
    ),
    "test_imports.py": "import program\nassert program.answer() == 42\ndef test_it(): pass",
    "test_busy.py": (
        "import program, time\ndef test_it():\n    while time.process_time() < 0.5: pass\n"
        "def test_more(): assert program.answer() == 42"
    ),
    "test_apart.py": (
        "import subprocess, sys\ndef test_it():\n    words = [sys.executable, '-c', 'import program; print(program.answer())']\n"
        "    done = subprocess.run(words, cwd='tests', capture_output=True, text=True)\n    assert done.stdout.strip() == '42'"
    ),
    "test_bare.py": "import program\ndef test_it(): program.answer()",
    "test_beside.py": "import sys\nassert 'test_bare' not in sys.modules\ndef test_it(): pass",
}
MEETINGS = """
import json, os, sys
sys.path.insert(0, {here!r})
from pathlib import Path
import mutants, mutant_runner
mutant_runner.PATIENCE = 1.0
folder = Path.cwd()
(folder / "work").mkdir()

def meet(line, tests, budget=60.0, control=None):
    changed = mutants.Mutant("", folder / "tests" / "program.py", 2, "", "def answer() -> int:\\n    " + line + "\\n")
    meeting = mutant_runner.Meeting(mutant_runner.Tests(mutant_runner.Reached(), {{}}), folder / "work", budget)
    found = meeting.meet(changed, ["tests/test_" + test for test in tests])
    return found.by.removeprefix("tests/test_"), found.how, found.cut

print(json.dumps([meet(*case) for case in json.loads(sys.argv[1])]))
"""
NOTICED = [
    (("return 43", ["bare.py::test_it", "plain.py::test_it"]), ["plain.py::test_it", "fails", False]),
    (("return 41", ["bare.py::test_it"]), ["", "", False]),
    (("return 41", ["apart.py::test_it"]), ["apart.py::test_it", "fails", False]),
    # it fails as the program is, too
    (("return 41", ["broken.py::test_it", "plain.py::test_it"]), ["plain.py::test_it", "fails", False]),
    # it fails for what another has left
    (("return 41", ["leaves.py::test_first", "leaves.py::test_second"]), ["", "", False]),
    (("return 41", ["imports.py::test_it"]), ["imports.py::test_it", "is not collected", False]),
    # it is not collected beside another, with the mutant or without
    (("return 41", ["bare.py::test_it", "beside.py::test_it"]), ["", "", False]),
    (("__import__('os')._exit(3)", ["bare.py::test_it"]), ["bare.py::test_it", "ends with exit code 3", False]),
    (("exec('while True: pass')", ["bare.py::test_it"]), ["bare.py::test_it", "hangs", False]),
    (("return 41", ["busy.py::test_it", "busy.py::test_more"], 0.3), ["", "", True]),
    (("return 41", ["busy.py::test_it", "busy.py::test_more"], 60.0), ["busy.py::test_more", "fails", False]),
]  # fmt: skip


def test_a_mutant_is_noticed_by_who_passes_alone_without_it(tmp_path: Path) -> None:
    tests = tmp_path / "tests"
    tests.mkdir()
    for name, text in {**OF_IT, "program.py": PROGRAM}.items():
        (tests / name).write_text(text, encoding="utf-8")
    words = [sys.executable, "-c", MEETINGS.format(here=str(HERE)), json.dumps([case for case, _ in NOTICED])]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [expected for _, expected in NOTICED]


def test_who_waits_on_a_busy_machine_does_not_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr("os.getloadavg", lambda: (0.1, 0.1, 0.1))
    assert mutant_runner.hangs(61.0, 0.0, allowed=60.0)
    assert not mutant_runner.hangs(59.0, 0.0, allowed=60.0)
    assert not mutant_runner.hangs(200.0, 30.0, allowed=60.0), "it runs, slowly"
    assert mutant_runner.hangs(100.0, 61.0, allowed=60.0)
    monkeypatch.setattr("os.getloadavg", lambda: (8.0, 8.0, 8.0))
    assert not mutant_runner.hangs(200.0, 0.0, allowed=60.0), "whom it waits for has to wait"
    assert mutant_runner.hangs(500.0, 0.0, allowed=60.0)


def test_every_decorator_that_compiles_is_known() -> None:
    """Coverage does not see what they decorate: its mutants meet those that reach its callers."""
    made_in = ("itouch.compiling", "itouch.plugin.kernels", "itouch.contact.kernel_decorators", "numba")
    used = set[str]()
    for path in (path for root in ("framework", "plugins") for path in (REPOSITORY / root).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if not any(f"from {module} import" in text for module in made_in):
            continue
        tree = ast.parse(text)
        imported = {
            name.asname or name.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module in made_in
            for name in node.names
        }  # fmt: skip
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        names = {ast.unparse(one).partition("(")[0] for node in functions for one in node.decorator_list}
        used |= names & imported
        assert all(
            mutant_runner.is_kernel(node) for node in functions
            if {ast.unparse(one).partition("(")[0] for one in node.decorator_list} & imported & mutants.COMPILING
        )  # fmt: skip
    assert "linked" in used and used <= mutants.COMPILING
    assert not mutant_runner.is_kernel(ast.parse("@lru_cache\ndef f(): pass").body[0])


def test_lines_are_found_where_they_stand_by_now() -> None:
    assert mutant_runner.moved("a\nb\nc\nd\n", "new\na\nB\nB2\nd\n") == {1: [2], 2: [3, 4], 3: [3, 4], 4: [5]}


MODULES = {
    "framework/room/kernels.py": (
        "LIMIT = 3.0\n\n\n@kernel\ndef inner_part(x):\n    return x + 1\n\n\n"
        "@kernel\ndef whole(x):\n    return inner_part(x)\n"
    ),
    "framework/room/python.py": (
        "from .kernels import LIMIT, whole\n\nBOUND = whole\n\n\ndef call(x):\n    y = BOUND(\n        x)\n"
        "    if y > LIMIT: return 1\n    return y\n"
    ),
    "framework/room/apart.py": "def inner_part(x):\n    return inner_part(x)\n",
}  # fmt: skip


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the room of a tree of three modules."""
    for name, text in MODULES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    monkeypatch.setattr(mutant_runner, "TREE", tmp_path)
    monkeypatch.setitem(mutation.ROOMS, "room", ("framework/room", ("room",)))
    mutant_runner._uses.cache_clear()
    return tmp_path / "framework/room"


def test_who_calls_a_kernel_or_reads_a_constant_reaches_it(small: Path) -> None:
    python, kernels = small / "python.py", small / "kernels.py"
    assert set(mutant_runner.users(kernels, ["inner_part"])) == {(python, 7), (python, 8)}
    assert set(mutant_runner.users(kernels, ["LIMIT"])) == {(python, 9)}
    assert mutant_runner.place(python, 8).statement == range(7, 9)
    assert mutant_runner.place(python, 8).function == range(6, 11)
    assert mutant_runner.place(kernels, 6) == mutant_runner.Place(
        range(6, 7), range(0), frozenset({"inner_part"}), True
    )
    assert mutant_runner.place(kernels, 1).names == {"LIMIT"}


def test_a_mutant_meets_who_reaches_it_and_who_shares_a_fixture_with_those(small: Path) -> None:
    maker, heir, other, room = (
        "tests/a/test_a.py::test_1", "tests/a/test_a.py::test_2", "tests/b/test_b.py::test_3", "tests/room/test_c.py::test_4"
    )  # fmt: skip
    cost = {maker: 2.0, heir: 0.01, other: 0.5, room: 1.0, "tests/gone.py::test": 0.1}
    lines = {("framework/room/python.py", 7): array("i", [0]), ("framework/room/python.py", 9): array("i", [1, 2, 4])}
    reached = mutant_runner.Reached([maker, other, room, heir, "tests/gone.py::test"], cost, lines)
    fixture = ["tests/a/test_a.py:made"]
    for name, text in (("d/test_d.py", "from room.python import call"), ("room/test_e.py", "")):
        (small.parents[1] / "tests" / name).parent.mkdir(parents=True, exist_ok=True)
        (small.parents[1] / "tests" / name).write_text(text, encoding="utf-8")
    (small / "__init__.py").touch()
    near, new = "tests/d/test_d.py::test_5", "tests/room/test_e.py::test_6"
    tests = mutant_runner.Tests(reached, {maker: fixture, heir: fixture, other: [], room: [], near: [], new: []})

    def met(name: str, line: int) -> list[str]:
        return tests.of(mutation.Mutant("room", small / name, line, "", ""))

    assert met("python.py", 8) == [near, maker, heir, new]
    assert met("python.py", 9) == [near, room, other, new]
    assert met("python.py", 10) == [near, room, other, maker, heir, new], "a line that nobody reaches: its function"
    assert met("kernels.py", 6) == [maker, heir, new, room], "a kernel: who calls it, then the room"
    assert met("kernels.py", 1) == [room, other, new]
    assert met("apart.py", 2) == [new, room]


def test_a_test_that_names_what_is_changed_is_met_before_all_others(small: Path) -> None:
    text = (
        "from room.python import call\n\ndef test_other():\n    assert 1\n\nclass TestCalls:\n"
        "    def test_it(self):\n        assert call(1) == 2\n"
    )
    folder = small.parents[1] / "tests" / "d"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "test_d.py").write_text(text, encoding="utf-8")
    other, direct, far = "tests/d/test_d.py::test_other", "tests/d/test_d.py::TestCalls::test_it", "tests/far.py::test"
    reached = mutant_runner.Reached(
        [other, direct, far], {other: 0.01, direct: 0.5, far: 0.01},
        {("framework/room/python.py", 7): array("i", [0, 1, 2])},
    )  # fmt: skip
    tests = mutant_runner.Tests(reached, {other: [], direct: [], far: []})
    assert mutant_runner.said(small / "python.py", 8) == {"call"}
    assert tests.of(mutation.Mutant("room", small / "python.py", 8, "", ""))[0] == direct
    tests.cost[direct] = 2.0 * mutant_runner.COSTLY
    assert tests.of(mutation.Mutant("room", small / "python.py", 8, "", ""))[0] == other


def test_the_page_of_all_attributes_is_met_first_by_what_a_module_binds(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(mutation.ROOMS, "room", ("framework/room", ("room", mutants.PAGE)))
    page, user = f"tests/{mutants.PAGE}::test_a_page[scene.md]", "tests/room/test_c.py::test_4"
    reached = mutant_runner.Reached(
        [page, user], {page: 0.5, user: 0.01}, {("framework/room/python.py", 9): array("i", [1])}
    )
    tests = mutant_runner.Tests(reached, {page: [], user: []})
    assert tests.of(mutation.Mutant("room", small / "kernels.py", 1, "", "")) == [page, user]
    assert tests.of(mutation.Mutant("room", small / "python.py", 9, "", "")) == [user]
    reached.lines["framework/room/python.py", 9] = array("i", [0, 1])  # the page is made by who uses it, too
    assert tests.of(mutation.Mutant("room", small / "kernels.py", 1, "", "")) == [page, user]


def test_what_a_decorator_says_of_a_class_meets_the_law_that_reads_it(small: Path) -> None:
    path = small / "python.py"
    path.write_text(path.read_text() + "\n\n@dataclass(frozen=True, slots=True)\nclass Some:\n    x: int\n", "utf-8")
    law, user = f"tests/{mutant_runner.DATACLASSES}", "tests/room/test_c.py::test_4"
    tests = mutant_runner.Tests(mutant_runner.Reached([law, user], {law: 5.0, user: 0.01}), {law: [], user: []})
    line = path.read_text().splitlines().index("@dataclass(frozen=True, slots=True)") + 1
    assert tests.of(mutation.Mutant("room", path, line, "", "")) == [law, user]
    assert tests.of(mutation.Mutant("room", path, line + 2, "", "")) == [user]


def test_who_reads_the_text_of_a_mutant_reads_the_mutant(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "read_text", Path.read_text)  # put back at the end
    mutant_runner._as_text(mutation.Mutant("room", small / "python.py", 1, "", "changed"))
    assert (small / "python.py").read_text(encoding="utf-8") == "changed"
    assert (small / "kernels.py").read_text(encoding="utf-8") != "changed"


def test_a_new_case_reaches_what_the_others_of_its_function_do(small: Path) -> None:
    cases = [f"tests/a/test_a.py::test[{n}]" for n in range(3)]
    reached = mutant_runner.Reached(
        cases[:2], dict.fromkeys(cases[:2], 0.1), {("framework/room/python.py", 9): array("i", [1])}
    )
    tests = mutant_runner.Tests(reached, {case: [] for case in cases})
    assert set(tests.of(mutation.Mutant("room", small / "python.py", 9, "", ""))) == {cases[1], cases[2]}


def test_the_order_is_one_case_of_each_then_the_room_then_what_it_costs() -> None:
    cost = {"r.py::a[1]": 0.2, "r.py::a[2]": 0.1, "o.py::b": 0.01, "o.py::c": 5.0, "r.py::d": 0.5}
    found = mutant_runner.in_order(cost, {"r.py::a[1]", "r.py::a[2]", "r.py::d"}, cost)
    assert found == ["r.py::a[2]", "r.py::d", "o.py::b", "r.py::a[1]", "o.py::c"]
    found = mutant_runner.in_order(cost, {"r.py::a[1]", "r.py::a[2]", "r.py::d"}, cost, {"o.py"})
    assert found == ["o.py::b", "o.py::c", "r.py::a[2]", "r.py::d", "r.py::a[1]"]
    found = mutant_runner.in_order(cost, set(), cost, {"r.py"})
    assert found == ["r.py::a[2]", "r.py::d", "r.py::a[1]", "o.py::b", "o.py::c"]


@pytest.mark.parametrize(
    ("text", "does"),
    [
        ("import itouch.loop.run_statistics as s", True), ("from itouch.loop.run_statistics import Histogram", True),
        ("from itouch.loop import (", True), ("from itouch.loop.rigid_transforms import Frame", False),
        ("from itouch.loop.run_statistics_of import Histogram", False),
    ],
)  # fmt: skip
def test_a_test_that_imports_what_is_changed_is_known(text: str, does: bool, tmp_path: Path) -> None:
    path = tmp_path / "test_it.py"
    path.write_text(text, encoding="utf-8")
    assert mutant_runner.names(path, "itouch.loop.run_statistics") == does


def test_results_keep_the_last_word_on_each(tmp_path: Path) -> None:
    results = mutation.Results(tmp_path / "results.jsonl")
    path = mutation.TREE / "framework/itouch/safety/limiting.py"
    text = path.read_text(encoding="utf-8")
    line = next(n for n, one in enumerate(text.splitlines(), 1) if "kept = min(max(values[i], low), high)" in one)
    lives = mutation.Mutant("safety", path, line, "by hand", text.replace("max(values[i], low)", "max(values[i], 0)"))
    noticed = mutation.Mutant("safety", path, line, "by hand", text.replace("max(values[i], low)", "max(values[i], 1)"))
    results.note(lives, 7, mutation.Outcome(cut=True), late=False)
    results.note(noticed, 7, mutation.Outcome("tests/a.py::b", "fails", 1.0), late=False)
    met = results.met()["safety"]
    assert (met.count, met.alive, met.cut) == (2, [lives.change], 1)
    if importlib.util.find_spec("parso"):  # the extra "mutation", without which nothing is changed again
        assert results.survivors() == {}, "an operator of which there is nothing in the file"
    moved = mutation.Mutant("safety", path, line + 1, "by hand", lives.source)
    results.note(moved, 7, mutation.Outcome("tests/a.py::b", "fails", 1.0), late=True, was=line)
    met = results.met()["safety"]
    assert (met.count, met.alive, met.late) == (2, [], 1)


@pytest.mark.parametrize(
    ("words", "says"),
    [(["--again"], "go with --reach FOLDER"), (["--reach", ".", "--again"], "give the file, --results FILE.jsonl")],
)
def test_what_goes_together_is_asked_for(words: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        mutation.main(words)
    assert stopped.value.code == 2
    assert says in capsys.readouterr().err


@pytest.mark.long
def test_mutants_of_all_rooms_are_noticed() -> None:
    pytest.importorskip("cosmic_ray", reason="pip install -e '.[mutation]'")
    done = subprocess.run([sys.executable, str(HERE / "mutation.py")], cwd=REPOSITORY, check=False)
    assert done.returncode == 0
