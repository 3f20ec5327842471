"""What CONTRIBUTING.md, SECURITY.md and the decisions tell of the house is so."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import itertools
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import module_pages
import pytest
import rooms
import sentence_page
from counts import counts, longest, repeated
from sources import ROOT, Module, circles, imports, modules, shelf, syntax

DECISIONS = sorted((ROOT / "docs" / "explanation" / "decisions").glob("*.md"))
QUIZ = tomllib.loads((Path(__file__).parent / "quiz.toml").read_text(encoding="utf-8"))["change"]


def test_the_map_is_drawn_from_the_imports() -> None:
    assert rooms.kept() == rooms.drawn(), "python tests/house/rooms.py --write"


def test_the_page_of_modules_is_that_of_the_program() -> None:
    page = module_pages.page()
    assert module_pages.PAGE.read_text(encoding="utf-8") == page, "python tests/house/rooms.py --write"
    assert page.count("\n- `") == len(modules()) + sum(map(len, module_pages.others().values()))


def test_the_page_of_sentences_is_that_of_the_program() -> None:
    assert sentence_page.PAGE.read_text(encoding="utf-8") == sentence_page.page(), "python tests/house/rooms.py --write"


def test_sentences_are_what_is_told_and_nothing_else() -> None:
    text = '''"""The module is about nothing at all."""
def told(name):
    """It has a docstring that is no sentence of the program."""
    say("one two", f"device {name!r} reads nothing" f", as {say('it was told so')} knows", "%d of %d, %d left")
    say("error: it is wrong\\n  = help: do it otherwise", "<a b='it is no sentence'/>")
    say(f"<{name}> has no effect")
'''
    assert list(sentence_page.sentences(ast.parse(text))) == [
        "device … reads nothing, as … knows", "it was told so", "error: it is wrong", "= help: do it otherwise",
        "<…> has no effect",
    ]  # fmt: skip


def test_every_room_says_what_it_is() -> None:
    says, _ = rooms.graph()
    assert all(len(text.split()) > 3 for text in says.values()), says
    assert len(set(says.values())) == len(says)


def test_each_room_has_a_folder_of_tests() -> None:
    """Under its own name, and a plugin under that of its folder; single modules are tested with those that use them."""
    every, (_, below) = modules(), rooms.graph()
    lacking = dict[str, str]()
    for room in below:
        module = every[rooms.whole(room, every)]
        if module.is_package:
            plugin = shelf(module.name) == "plugins"
            folder = Path("tests", "plugins", module.path.relative_to(ROOT).parts[1]) if plugin else Path("tests", room)
            if not any((ROOT / folder).glob("test_*.py")):
                lacking[room] = str(folder)
    assert not lacking


def test_files_that_the_pages_name_exist() -> None:
    rooted = r"`((?:framework|plugins|scenes|docs|tests|\.ci)/[\w./-]+|[A-Z]+\.\w+)`"
    for page in ("CONTRIBUTING.md", "SECURITY.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        targets = re.findall(rooted, text) + re.findall(r"\]\(([^)#:]+)\)", text)
        assert len(targets) > 3
        missing = [name for name in targets if not (ROOT / name).exists()]
        assert not [name for name in missing if name != "tests/ROOM"]
    # files of the framework that are named from its folder
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for name in re.findall(r"`((?:cli|elements)/\w+\.py)`", text):
        places = {"cli": "itouch_tools/cli", "elements": "itouch/scene/elements"}
        folder, _, file = name.partition("/")
        assert (ROOT / "framework" / places[folder] / file).is_file(), name


def test_no_two_files_of_tests_have_one_name() -> None:
    """They stand in no packages: the second would not be collected."""
    own = [path.name for path in (ROOT / "tests").rglob("test_*.py") if "outside" not in path.parts]
    assert sorted(own) == sorted(set(own))


def test_each_test_is_there_on_every_machine() -> None:
    """What a test lacks it says when it runs (`needed`): one behind an `if` is gone, and the lists of forms with it."""
    hidden = [
        f"{path.relative_to(ROOT)}:{inner.lineno}"
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
        if re.search(r"^(if|try)\b", text := path.read_text(encoding="utf-8"), re.MULTILINE)
        for statement in syntax(text).body
        if isinstance(statement, ast.If | ast.Try)
        for inner in ast.walk(statement)
        if isinstance(inner, ast.FunctionDef) and inner.name.startswith("test_")
    ]
    assert not hidden


def test_every_decision_has_an_area() -> None:
    """The page before them says what each range of numbers is about, and ranges do not overlap."""
    page = (ROOT / "docs" / "explanation" / "decisions.md").read_text(encoding="utf-8")
    areas = [(int(first), int(last or first)) for first, last in re.findall(r"\b(0\d{3})(?:\s+to\s+(0\d{3}))?\b", page)]
    assert areas == sorted(areas) and all(before[1] < after[0] for before, after in itertools.pairwise(areas))
    numbers = [int(path.name[:4]) for path in DECISIONS]
    assert [number for number in numbers if not any(first <= number <= last for first, last in areas)] == []


def test_decisions_are_numbered_once() -> None:
    numbers = [page.name[:4] for page in DECISIONS]
    assert len(set(numbers)) == len(numbers)
    for page in DECISIONS:
        assert page.read_text(encoding="utf-8").startswith(f"# {page.name[:4]} "), page.name


def test_what_took_the_place_of_a_decision_is_named() -> None:
    superseded = [page for page in DECISIONS if "**Status.** Superseded" in page.read_text(encoding="utf-8")]
    assert superseded
    for page in superseded:
        status = page.read_text(encoding="utf-8").split("**Status.**")[1].split("\n\n")[0]
        later = re.findall(r"\((\d{4}-[\w-]+\.md)\)", status)
        assert later and all((page.parent / name).is_file() for name in later), page.name


def test_changes_are_sorted_by_kind() -> None:
    """Below each version there are the kinds, each once, in their order, and lists in them."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    kinds = ("Added", "Changed", "Deprecated", "Removed", "Fixed", "Security")
    for version in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        found = re.findall(r"^### (\w+)$", version, flags=re.MULTILINE)
        assert found == [kind for kind in kinds if kind in found]


@pytest.mark.parametrize("change", QUIZ, ids=lambda change: Path(change["file"]).stem)
def test_a_change_is_made_where_the_quiz_says(change: dict[str, str]) -> None:
    assert [name for name, text in _program().items() if change["says"] in text] == [change["file"]]


@cache
def _program() -> dict[str, str]:
    """Return the text of each file of the program, of its firmware and of the scenes that come with it."""
    kinds = {".py", ".in", ".h", ".c", ".ino", ".xml"}
    found = (path for folder in ("framework", "plugins", "scenes") for path in sorted((ROOT / folder).rglob("*")))
    return {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in found if path.suffix in kinds}


def test_the_quiz_asks_for_many_files() -> None:
    """Each question once, and hardly a file twice."""
    assert len(QUIZ) == len({change["do"] for change in QUIZ}) == 90
    assert len({change["file"] for change in QUIZ}) >= 87


def test_a_constant_stands_on_the_page_with_its_value_where_a_comment_says_something_of_it() -> None:
    text = '''"""Text."""
#: How long [s] it waits:
#: and no longer.
WAIT = 80e-3
LONGER = 0.2
_FAR, NEAR = 1.0, 2.0  # of the finger [m]
_INSIDE = 3

SILENT = 3
NOISE = 4  # noqa: E1
#: What it knows.
TABLE = {
    "a": 1,
}
#: Not a constant.
small = 5
'''
    assert list(module_pages.constants(Module("a", Path("a.py"), text))) == [
        ("WAIT = 80e-3, LONGER = 0.2", "How long [s] it waits: and no longer"),
        ("_FAR, NEAR = 1.0, 2.0", "of the finger [m]"),
        ("TABLE", "What it knows"),
    ]


def test_constants_of_the_firmware_stand_on_the_page() -> None:
    text = """#define GUARD_H
/* Supply of the bridge,
   and its current. */
#define SUPPLY_V 12.0f
#define MOST_A 3.0f /* greatest */

#define ALONE 1
"""
    assert list(module_pages.defined(text)) == [
        ("SUPPLY_V = 12.0f", "Supply of the bridge, and its current"),
        ("MOST_A = 3.0f", "greatest"),
    ]


def test_what_a_file_is_for_is_the_beginning_of_its_first_comment(tmp_path: Path) -> None:
    for name, text, says in (
        ("a.xml", "<?xml version='1.0'?>\n<!-- Two blocks of 1.5 cm.  They\n are warm, and of metal: feel them. No. -->", "Two blocks of 1.5 cm. They are warm, and of metal: feel them"),
        ("b.css", "/* How it looks: colours. */\na {}", "How it looks: colours"),
        ("c.py.in", '"""The device $name."""', "The device $name"),
        ("d.js", "f();", ""),
    ):  # fmt: skip
        path = tmp_path / name
        path.write_text(text)
        assert module_pages.first_comment(path) == says


SMALL = '''"""A module
of two lines."""

import json

# a comment
def longer(a: int) -> int:
    """Say."""
    text = """not a docstring
    """
    return a  # and the end


def short() -> None: ...
'''


def test_code_is_what_is_no_docstring_comment_or_blank() -> None:
    module = Module("small", Path("small.py"), SMALL)
    assert module.code_lines() == {4, 7, 9, 10, 11, 14}
    assert longest({"small": module}, 1) == [(4, "small.longer")]


def test_imports_are_found_wherever_they_stand() -> None:
    names = ["a", "a.b", "a.b.c", "a.d", "e"]
    text = '''"""import e"""
from a import b
if TYPE_CHECKING:
    from . import (
        c,
    )
def later():
    import a.d
    from .. import d as other
'''
    module = Module("a.b", Path("a/b/__init__.py"), text)
    assert module.imported(names) == {"a.b.c", "a.d"}
    assert module.imported(names, deferred=False) == {"a.b.c"}


def test_a_package_is_imported_with_its_modules() -> None:
    """Python runs the packages on the way to a module, but those of the importing module have begun before it."""
    names = ["a", "a.b", "a.b.c", "a.d", "a.d.e"]
    assert Module("a.b.c", Path("a/b/c.py"), "from a.d.e import x\n").imported(names) == {"a.d", "a.d.e"}
    assert Module("a.d.e", Path("a/d/e.py"), "import a.d\n").imported(names) == {"a.d"}


def test_circles_are_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set[str](), "e": {"e", "a"}}
    assert circles(graph) == [["b", "c"]]


def test_no_two_modules_need_one_another() -> None:
    """Nor for their types alone, nor inside a function: what needs its owner is given what it needs of it."""
    assert circles(imports(modules())) == []


def test_a_file_name_is_of_one_file() -> None:
    """Nowhere twice in the framework, nor in one plugin: who hears a file's name finds the file."""
    assert repeated(modules()) == {}


def test_the_counts_of_a_checkout(tmp_path: Path) -> None:
    """A small house whose figures are known."""
    files = {
        "framework/itouch/__init__.py": '"""House."""\n',
        "framework/itouch/loop/__init__.py": "",
        "framework/itouch/loop/step.py": "from itouch.loop import plan\nX = 1\n",
        "framework/itouch/loop/plan.py": "def f():\n    from itouch.loop import step\n    return step\n",
        "framework/itouch_tools/cli/plan.py": "from itouch.loop.step import X\n\n# no\n",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    found = counts(tmp_path)
    assert (found["lines of code"], found["files"], found["  core: lines of code"]) == (6, 5, 5)
    assert found["files with one importer"] == found["  of them under 60 lines of code"] == 1
    assert found["file names that occur twice or more"] == 1
    assert found["  within the framework, or within one plugin"] == 1
    assert found["import circles, TYPE_CHECKING included"] == 0
    assert found["import circles, imports inside functions included"] == 1
    assert found["longest function 1"] == "3 f (itouch.loop.plan)"


def test_other_packages_ask_for_what_the_project_asks_for() -> None:
    """The conda recipe and the image follow pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = (ROOT / ".ci" / "packages" / "recipe.yaml").read_text(encoding="utf-8")
    (oldest,) = re.findall(r'^  python_min: "([\d.]+)"$', recipe, re.MULTILINE)
    run = recipe.split("  run:\n")[1].split("\ntests:")[0].replace("${{ python_min }}", oldest)
    asked = re.findall(r"^    - ([\w-]+) ([<>=.,\d]+)$", run, re.MULTILINE)
    python = ("python", project["requires-python"])
    assert asked == [python, *(re.fullmatch(r"([\w-]+)(.*)", one).groups() for one in project["dependencies"])]  # type: ignore[union-attr]
    assert f'version: "{project["version"]}"' in recipe
    image = (ROOT / ".ci" / "packages" / "Dockerfile").read_text(encoding="utf-8")
    installed = set(re.findall(r"\b(?:lib|fonts)[\w.-]+", image.split("apt-get install")[1].split("\n")[0]))
    checked = (ROOT / ".ci" / "system_packages").read_text(encoding="utf-8")
    assert installed and all(name in checked for name in installed)
    assert image.index("USER touch") < image.index("ENTRYPOINT")
    (mounted,) = re.findall(r'-v "\$PWD:([^"]+)" itouch-py run \w+\.xml', image)  # as it is told, it finds the scene
    assert re.findall(r"^WORKDIR (.+)$", image, re.MULTILINE)[-1] == mounted
    assert f"--owner=touch --group=touch {mounted}\n" in image[: image.index("USER touch")]


def test_packages_that_tests_ask_for_are_named_where_the_checks_install_them() -> None:
    asked = re.compile(r'need_program\([^)]*package="([^"]+)"')
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")]
    needed = {package for text in texts for found in asked.findall(text) for package in found.split()}
    every = (ROOT / ".ci" / "system_packages").read_text(encoding="utf-8").partition("need=()")[0]
    (more,) = re.findall(r"^more=\((.*)\)$", (ROOT / ".ci" / "nightly").read_text(encoding="utf-8"), re.MULTILINE)
    listed = set(re.findall(r"[\w.+-]+", f"{every} {more}"))
    assert {"qemu-user", "gcc"} <= needed and needed - listed == set()


def test_a_source_distribution_has_what_lies_at_the_root() -> None:
    told = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
    pages = {f"/{path.name}" for path in ROOT.iterdir() if path.suffix in (".md", ".cff") or path.name == "LICENSE"}
    assert pages <= set(told["sdist"]["include"])


def test_kernels_of_a_release_are_made_by_the_pinned_versions_and_all_scenes_can_run() -> None:
    """They run with the Numba and NumPy that made them only; one of the scenes that make them has a rigid body."""
    script = (ROOT / ".ci" / "release").read_text(encoding="utf-8")
    (installed,) = re.findall(r"pip\" install -q -c \"\$tools/pins.txt\" '(.*)'$", script, re.MULTILINE)
    chosen = re.findall(
        r'"(\w+)"', re.findall(r"^SCENES = (.*)$", (ROOT / ".ci" / "compile_kernels.py").read_text(), re.M)[0]
    )
    assert any("<dynamics" in (ROOT / "scenes" / f"{name}.xml").read_text(encoding="utf-8") for name in chosen)
    assert installed == ".[dynamics]"


def test_a_wheel_with_kernels_names_a_platform_that_an_index_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An index refuses `linux_x86_64`; what is named is what Numba's own wheel names, if that is of Linux."""
    monkeypatch.syspath_prepend(str(ROOT / ".ci"))
    tag = importlib.import_module("wheel_tag")
    (tmp_path / "framework/itouch/compiled").mkdir(parents=True)
    (tmp_path / "framework/itouch/compiled/manifest.json").write_text("{}")
    hook = tag.Tag(str(tmp_path), {}, None, None, str(tmp_path), "wheel")
    for platform, named in (("linux-x86_64", "manylinux_2_28_x86_64"), ("macosx-11.0-arm64", "macosx_11_0_arm64")):
        monkeypatch.setattr(tag.sysconfig, "get_platform", lambda platform=platform: platform)
        data: dict[str, object] = {}
        hook.initialize("standard", data)
        assert str(data["tag"]).endswith(f"-{named}") and data["pure_python"] is False
    of_numba = importlib.metadata.distribution("numba").read_text("WHEEL") or ""
    if "manylinux" in of_numba:
        assert f"-{tag.LINUX}_" in of_numba


def test_pinned_versions_are_looked_up_in_a_clone_of_the_advisories(tmp_path: Path) -> None:
    """Listed, in a range, repaired, withdrawn, another spelling of the name: who is affected is told, nobody else."""
    entries = {
        "PYSEC-1": ("left-pad", "versions: [1.0.1, 2.0]\n  ranges: []"),
        "PYSEC-2": ("left-pad", "ranges:\n  - {type: ECOSYSTEM, events: [{introduced: '0'}, {fixed: 1.0.1}]}"),
        "PYSEC-3": (
            "left-pad",
            "ranges:\n  - {type: ECOSYSTEM, events: [{introduced: '1.0'}, {last_affected: 1.0.1}]}",
        ),
        "PYSEC-4": (
            "right-pad",
            "ranges:\n  - {type: ECOSYSTEM, events: [{introduced: '0'}]}\nwithdrawn: '2026-01-02'",
        ),
    }
    for name, (package, said) in entries.items():
        path = tmp_path / "vulns" / package / f"{name}.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        head = f"id: {name}\ndetails: so it is\npublished: '2026-01-01T00:00:00Z'\naffected:\n- package: {{name: {package}}}"
        path.write_text(f"{head}\n  {said}\n")
    pins = tmp_path / "pins.txt"
    pins.write_text("Left_Pad==1.0.1 \\\n    --hash=sha256:ab\nright-pad==3.0\n")
    script = ROOT / ".ci" / "advisories.py"
    done = subprocess.run([sys.executable, script, tmp_path, pins], capture_output=True, text=True, timeout=600)
    assert done.returncode == 1, done.stderr
    assert done.stdout.splitlines() == [
        "left-pad 1.0.1: PYSEC-1: so it is",
        "left-pad 1.0.1: PYSEC-3: so it is",
        "2 pinned versions, 2 known weaknesses, by entries until 2026-01-01",
    ]
    done = subprocess.run(
        [sys.executable, script, pins.parent / "no", pins], capture_output=True, text=True, timeout=600
    )
    assert (done.returncode, done.stdout) == (2, "") and "is no clone" in done.stderr


def test_a_release_is_not_made_over_another(tmp_path: Path) -> None:
    (tmp_path / "SHA256SUMS").write_text("of another release")
    done = subprocess.run(["bash", ROOT / ".ci" / "release", tmp_path], capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stdout) == (1, "")
    assert "is not empty" in done.stderr
    done = subprocess.run(
        ["bash", ROOT / ".ci" / "release", tmp_path / "new", "--kernel"], capture_output=True, text=True
    )
    assert done.returncode == 2 and "--kernel is not known" in done.stderr and not (tmp_path / "new").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["SHA256SUMS"]
