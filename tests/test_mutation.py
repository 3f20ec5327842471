"""The tests notice what is wrong: a change of the program by hand here, hundreds drawn at random in the long form."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mutation
import pytest
from shipped import REPOSITORY

HERE = Path(__file__).parent

BY_HAND = """
import sys
sys.path.insert(0, {here!r})
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
    lines = [mutation.bare(one) for one in (REPOSITORY / file).read_text(encoding="utf-8").splitlines()]
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
    assert change("if apart >", "if apart >=")[1:] == ("ifapart>able.apart[0]:", "ifapart>=able.apart[0]:")


@pytest.mark.long
def test_mutants_of_all_rooms_are_noticed() -> None:
    pytest.importorskip("cosmic_ray", reason="pip install -e '.[mutation]'")
    done = subprocess.run([sys.executable, str(HERE / "mutation.py")], cwd=REPOSITORY, check=False)
    assert done.returncode == 0
