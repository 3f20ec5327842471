"""Scripts that drive a window: all of a module in one process, each with a window and a session of its own.

They stand in ``scripts``, in a folder for each module; ``prepared.py`` there, or above, makes what they import of it.
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

HERE = Path(__file__).parent
_PREPARED = "prepared.py"


def scripts_of(folder: str) -> dict[str, Path]:
    """Return the scripts of a folder by the names of their tests: their docstrings without the full stop."""
    found = dict[str, Path]()
    for path in sorted((HERE / "scripts" / folder).glob("*.py")):
        if path.name != _PREPARED:
            name = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").removesuffix(".")
            assert name and name not in found, f"{path} has no docstring, or that of another script"
            found[name] = path
    assert found, folder
    return found


def asked(request: pytest.FixtureRequest, scripts: Mapping[str, Path]) -> dict[str, Path]:
    """Return the scripts of which this run asks: those whose tests were not left to the long form."""
    here = {item.callspec.params.get("name") for item in request.session.items
            if item.path == request.path and hasattr(item, "callspec")}  # fmt: skip
    return {name: script for name, script in scripts.items() if name in here}


def drive(
    scripts: Mapping[str, Path], words: Sequence[str], environment: Mapping[str, str], folder: Path
) -> dict[str, str]:
    """Run scripts, and return what went wrong with each, or an empty text; ``words`` are in ``sys.argv[2:]``."""
    task, out = folder / "task.json", folder / "said.json"
    above = next(iter(scripts.values())).parents
    prepare = next(found for place in above if (found := place / _PREPARED).exists())
    task.write_text(json.dumps([str(prepare), {name: str(script) for name, script in scripts.items()}, str(out)]))
    done = subprocess.run([sys.executable, str(HERE / "scripts" / "run.py"), str(task), *words], capture_output=True,
                          text=True, env=dict(environment), timeout=600)  # fmt: skip
    said = json.loads(out.read_text()) if out.exists() else {}
    died = f"the process ended with {done.returncode} before this script had: {done.stderr}"
    return {name: said.get(name, died) for name in scripts}
