"""A list of tests that names one that has gone stops a whole run with one sentence, with workers and without."""

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
