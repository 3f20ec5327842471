"""The notebooks run from their first cell to their last, and what they show at the end of a cell can be shown."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest
from listings import DOCS

NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))


def run(path: Path) -> tuple[list[Any], dict[str, Any]]:
    """Run the cells of a notebook one after the other; return the value of each last line, and the names."""
    scope: dict[str, Any] = {"__name__": "__main__"}
    shown = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "code":
            continue
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, path.name, "exec"), scope)
        if isinstance(last, ast.Expr):
            shown.append(eval(compile(ast.Expression(last.value), path.name, "eval"), scope))
    return shown, scope


@pytest.fixture
def beside(scenes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand where a notebook stands: two folders below the one that has the scenes."""
    folder = scenes.parent / "docs" / "notebooks"
    folder.mkdir(parents=True)
    monkeypatch.chdir(folder)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, beside: None, capsys: pytest.CaptureFixture[str]) -> None:
    shown, scope = run(path)
    pages = [each._repr_html_() for each in shown if hasattr(each, "_repr_html_")]
    assert pages and all(page.startswith("<div") for page in pages)
    if path.stem == "first-touch":
        assert shown[-1] is True  # the restored session has the same State
        assert shown[-2][0][0] == "block"
    elif path.stem == "look-into-a-recording":
        assert shown[-1][0] == 0 and shown[-1][1] > 0
        assert "['trial']" in capsys.readouterr().out
    else:
        assert 0.0 < scope["soft"].max() < scope["hard"].max()


def test_notebooks_are_kept_without_outputs() -> None:
    assert len(NOTEBOOKS) == 3
    for path in NOTEBOOKS:
        data = json.loads(path.read_text(encoding="utf-8"))
        cells = data["cells"]
        assert (data["nbformat"], cells[0]["cell_type"]) == (4, "markdown")
        assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)
        assert len({cell["id"] for cell in cells}) == len(cells)
        assert path.name in (DOCS / "how-to" / "notebooks.md").read_text(encoding="utf-8")
