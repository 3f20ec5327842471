"""The long form in parts: what has passed is not run again, what failed is, and the page says both."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import long_results
import pytest

TESTS = """
import os
import pytest
from campaign import tell
from requirements import not_here

@pytest.mark.long
@pytest.mark.parametrize("word", ["a", "b"])
def test_one(word):
    tell(f"{word} was tried")

@pytest.mark.long
def test_other():
    assert "MENDED" in os.environ

@pytest.mark.long
def test_lacking():
    not_here("no such thing here")

def test_short():
    raise AssertionError
"""


@pytest.mark.parametrize("workers", [(), ("-n", "2")])
def test_a_run_goes_on_where_another_stopped(tmp_path: Path, workers: tuple[str, ...]) -> None:
    room = tmp_path / "tests" / "room"
    room.mkdir(parents=True)
    (room / "test_it.py").write_text(TESTS, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n  long: l\n  campaign: c\n", encoding="utf-8")
    kept = tmp_path / "kept.jsonl"
    words = ["-p", "forms", "-p", "no:cacheprovider", "-q", "-m", "long", "--results", str(kept), *workers, "tests"]

    def run(**more: str) -> subprocess.CompletedProcess[str]:
        env = os.environ | {"PYTHONPATH": str(long_results.HERE), **more}
        return subprocess.run(
            [sys.executable, "-m", "pytest", *words], cwd=tmp_path, env=env, capture_output=True, text=True
        )

    first = run()
    assert first.returncode == 1 and "1 failed, 2 passed, 1 skipped" in first.stdout, first.stdout + first.stderr
    page = long_results.page(long_results.read(kept).values())
    assert "| `tests/room` | 4 | 2 passed, 1 failed, 1 skipped |" in page
    assert "- `tests/room/test_it.py::test_other`" in page
    assert "| `tests/room/test_it.py::test_one` | a was tried |\n|  | b was tried |" in page
    with kept.open("a", encoding="utf-8") as file:
        file.write('{"test": "cut off by a sto')
    second = run(MENDED="yes")
    assert second.returncode == 0 and "1 passed, 1 skipped" in second.stdout, second.stdout + second.stderr
    assert "passed before and left out: 2 tests" in second.stdout
    assert "Failed" not in long_results.page(long_results.read(kept).values())


def test_with_all_passed_nothing_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(
        "import pytest\n\n@pytest.mark.long\ndef test_it():\n    pass\n", encoding="utf-8"
    )
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n  long: l\n  campaign: c\n", encoding="utf-8")
    words = [sys.executable, "-m", "pytest", "-p", "forms", "-q", "-m", "long", "--results", "kept.jsonl", "test_it.py"]
    env = os.environ | {"PYTHONPATH": str(long_results.HERE)}
    codes = [subprocess.run(words, cwd=tmp_path, env=env, capture_output=True).returncode for _ in range(2)]
    assert codes == [0, 0]
    done = subprocess.run([*words[:-5], *words[-3:]], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 4 and "give it with -m long" in done.stderr


def test_the_command_as_the_page_gives_it_goes_on_too(tmp_path: Path) -> None:
    """It names no test: what follows ``--results`` must not be taken for one, which would have no such option."""
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "none.txt").write_text("", encoding="utf-8")
    (tmp_path / "tests" / "conftest.py").write_text(
        "import pathlib\n\nimport forms\nfrom forms import *\n\n"
        "forms.LIST = forms.KEPT = pathlib.Path(__file__).with_name('none.txt')\n",
        encoding="utf-8",
    )
    (tmp_path / "tests" / "test_it.py").write_text(
        "import pytest\n\n@pytest.mark.long\ndef test_it():\n    pass\n", encoding="utf-8"
    )
    ini = "[pytest]\ntestpaths = tests\nmarkers =\n  long: l\n  campaign: c\n"
    (tmp_path / "pytest.ini").write_text(ini, encoding="utf-8")
    command = next(words for words in long_results.page([]).split("`") if "--results" in words)
    words = [sys.executable, *command.split()[1:]]
    env = os.environ | {"PYTHONPATH": str(long_results.HERE)}
    runs = [subprocess.run(words, cwd=tmp_path, env=env, capture_output=True, text=True) for _ in range(2)]
    assert "1 passed" in runs[0].stdout, runs[0].stdout + runs[0].stderr
    assert "passed before and left out: 1 tests" in runs[1].stdout, runs[1].stdout + runs[1].stderr


def test_a_failure_in_the_end_of_a_test_counts(tmp_path: Path) -> None:
    keeper = long_results.Keeper(tmp_path / "kept.jsonl")
    for when, outcome in (("setup", "passed"), ("call", "passed"), ("teardown", "failed")):
        keeper.note("tests/room/test_it.py::test_it", when, outcome, 1.0, ())
    (result,) = long_results.read(keeper.path).values()
    assert result.outcome == "failed" and result.room == "tests/room"
    assert long_results.passed(keeper.path) == frozenset()


def test_the_page_tells_what_has_not_run_and_leaves_out_what_is_gone() -> None:
    names = ["tests/a/test_a.py::test_one", "tests/a/test_a.py::test_gone"]
    found = [long_results.Result(name, "passed", 1.0, "2026-11-26", "0123abc") for name in names]
    there = [names[0], "tests/b/test_b.py::test_two[1]", "tests/b/test_b.py::test_two[2]"]
    page = long_results.page(found, there)
    assert "1 of 3 tests: 1 passed;" in page
    assert "Not run yet:\n\n- `tests/b/test_b.py::test_two` (2)\n" in page
    assert "test_gone" not in page and "| `tests/a` | 1 | 1 passed |" in page
    assert "Not run yet" not in long_results.page(found, names)


def test_what_a_campaign_told_is_a_row_each_that_names_it_once() -> None:
    told = ("law    worst\narm   0.2 %\n", "and that")
    result = long_results.Result("tests/a/test_a.py::test_one[1]", "passed", 1.0, "2026-11-26", "0123abc", told)
    page = long_results.page([result])
    assert page.endswith("| `tests/a/test_a.py::test_one` | law worst; arm 0.2 % |\n|  | and that |\n")
