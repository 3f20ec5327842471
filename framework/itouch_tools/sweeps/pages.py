"""Pages of sweeps: a function turns the rows into lines of Markdown and a figure.

The functions of the shipped sweeps lie beside them, in ``scenes/sweeps/pages.py``; one of your own is named as
``FILE.py:FUNCTION`` or ``package.module:function``.  It takes the rows, a list of mappings from column to value, and
returns the lines and a function that draws the figure on given axes.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from itouch.scene import bundled_scenes
from itouch.schema import ItouchError
from itouch.schema.diagnostics import did_you_mean
from itouch_tools.sweeps.functions import load_function
from itouch_tools.sweeps.sweep_store import rows, table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rows = list[dict[str, Any]]
Drawn = Callable[["Axes"], None]
Maker = Callable[[Rows], tuple[list[str], Drawn]]
_SHIPPED = "sweeps/pages.py"


def names() -> list[str]:
    """Return the names of the pages of the shipped sweeps."""
    home = bundled_scenes.folder()
    if home is None or not (home / _SHIPPED).is_file():
        return []
    tree = ast.parse((home / _SHIPPED).read_text(encoding="utf-8"))
    public = (node.name for node in tree.body if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"))
    return sorted(name.replace("_", "-") for name in public)


def maker(name: str, folder: Path = Path()) -> Maker:
    """Return the function that makes a page: a shipped one by its name, or one of your own, with a colon in its name.

    Raises
    ------
    ItouchError
        If there is no such function.
    """
    if ":" in name:
        return load_function(name, folder)
    home = bundled_scenes.folder()
    if home is None or name not in names():
        known = did_you_mean(name, names(), "pages are")
        raise ItouchError(f"there is no page '{name}'\n  = help: {known}; your own: FILE.py:FUNCTION")
    return load_function(f"{_SHIPPED}:{name.replace('-', '_')}", home)


def write_page(kind: str, folder: Path, output: Path) -> Path:
    """Write the page of a sweep's rows as Markdown, with its figure beside it; return the page.

    Raises
    ------
    ItouchError
        If the folder has no rows, or those of another sweep, or there is no such page.
    """
    if not table(folder).num_rows:
        raise ItouchError(f"'{folder}' has no rows")
    found: Rows = sorted(rows(folder), key=lambda row: str(row["digest"]))
    make, stem = maker(kind), Path(kind.replace(":", "-")).name
    try:
        lines, draw = make(found)
    except (KeyError, ValueError, IndexError) as error:
        raise ItouchError(f"the rows in '{folder}' are not those of '{kind}': {error}") from None
    output.mkdir(parents=True, exist_ok=True)
    picture = output / f"{stem}.png"
    lines += ["", f"![{kind}]({picture.name})", ""] if _drawn(draw, picture) else [""]
    page = output / f"{stem}.md"
    page.write_text("\n".join(lines), encoding="utf-8")
    return page


def _drawn(draw: Drawn, picture: Path) -> bool:
    """Draw a figure if matplotlib is installed; return whether it is."""
    from importlib.util import find_spec

    if find_spec("matplotlib") is None:
        return False
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7.0, 4.5), layout="constrained")
    draw(axes)
    figure.savefig(picture, dpi=110)
    plt.close(figure)
    return True
