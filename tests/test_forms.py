"""A list of tests that names one that has gone stops a whole run with one sentence; in CI, what is left out fails.

With workers and without.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from forms import HERE

PLUGIN = """
from pathlib import Path
import forms
from forms import *
from forms import pytest_collection_modifyitems
forms.LIST, forms.KEPT = Path("long_form.txt"), Path("short_form.txt")
"""


@pytest.mark.parametrize("workers", [(), ("-n", "2")], ids=["alone", "workers"])
def test_a_stale_name_is_one_sentence(tmp_path: Path, workers: tuple[str, ...]) -> None:
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_it.py").write_text("def test_it():\n    pass\n", encoding="utf-8")
    (tmp_path / "listed.py").write_text(PLUGIN, encoding="utf-8")
    (tmp_path / "short_form.txt").write_text("", encoding="utf-8")
    (tmp_path / "pytest.ini").write_text(
        "[pytest]\ntestpaths = tests\nmarkers =\n  long: l\n  campaign: c\n", encoding="utf-8"
    )
    words = [sys.executable, "-m", "pytest", "-p", "listed", "-p", "no:cacheprovider", "-q", *workers]
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(HERE)])}

    def run(names: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "long_form.txt").write_text(names, encoding="utf-8")
        return subprocess.run(words, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)

    stale = run("tests/test_it.py::test_gone\n")
    said = stale.stdout + stale.stderr
    assert stale.returncode == 4, said
    assert said.count("tests/long_form.txt names tests that are not there") == 1, said
    assert "give them the new names: tests/test_it.py::test_gone" in said
    assert "INTERNALERROR" not in said and "Traceback" not in said and "passed" not in said
    sound = run("")
    assert sound.returncode == 0 and "1 passed" in sound.stdout, sound.stdout + sound.stderr


LEFT_OUT = """
import sys
import pytest
from requirements import meant, not_here

def test_skipped():
    pytest.skip("it lacks this")

@pytest.mark.skipif(True, reason="it lacks that")
def test_marked():
    pass

@pytest.fixture(scope="session")
def thing():
    pytest.importorskip("no_such_module")

def test_with_a_thing(thing):
    pass

def test_meant():
    not_here("not on this machine")

@pytest.mark.skipif(True, reason=meant("not on this system"))
def test_meant_and_marked():
    pass

@pytest.mark.xfail(strict=True)
def test_expected():
    raise AssertionError

def test_a_check(record_property):
    record_property("itouch", ["Suite", "a-check", "A check", "left out", "it has no wire", 0.0])
    pytest.skip("it has no wire")
"""


@pytest.mark.parametrize("workers", [(), ("-n", "2")], ids=["alone", "workers"])
def test_where_ci_is_set_nothing_is_left_out_but_what_is_meant_to_be(tmp_path: Path, workers: tuple[str, ...]) -> None:
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_incomplete_plugins.py").write_text(LEFT_OUT, encoding="utf-8")
    (tmp_path / "listed.py").write_text(PLUGIN, encoding="utf-8")
    for name in ("short_form.txt", "long_form.txt"):
        (tmp_path / name).write_text("", encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n  long: l\n  campaign: c\n", encoding="utf-8")
    words = [sys.executable, "-m", "pytest", "-p", "listed", "-p", "no:cacheprovider", "-q", "-rf", *workers, "tests"]
    env = {name: value for name, value in os.environ.items() if name != "CI"}
    env["PYTHONPATH"] = os.pathsep.join([str(tmp_path), str(HERE)])

    def run(**more: str) -> tuple[int, str]:
        done = subprocess.run(words, cwd=tmp_path, env=env | more, capture_output=True, text=True, check=False)
        return done.returncode, done.stdout + done.stderr

    code, said = run()
    assert code == 0 and "6 skipped, 1 xfailed" in said, said
    code, said = run(CI="1")
    assert code == 1 and "1 failed, 3 skipped, 1 xfailed, 2 errors" in said, said
    for lacking in ("it lacks this", "it lacks that", "could not import 'no_such_module'"):
        assert f"where CI is set nothing is left out, and this was: {lacking}" in said, said
    (tmp_path / "tests" / "test_file.py").write_text("import pytest\npytest.importorskip('no_such_module')\n", "utf-8")
    code, said = run()
    assert code == 0, said
    code, said = run(CI="1")
    assert code != 0 and "this was: could not import 'no_such_module'" in said, said
