"""The line of help of a plugin's command, read from its source without importing it."""

from __future__ import annotations

import ast
from importlib.machinery import PathFinder
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from pathlib import Path


def synopsis(entry: EntryPoint) -> str:
    """Return the first sentence of the docstring of an entry point's function, else of its module, or nothing."""
    try:
        source = source_of(entry.module)
        tree = ast.parse(source.read_text(encoding="utf-8")) if source is not None else ast.Module([], [])
    except (OSError, SyntaxError, ValueError, ImportError):
        return ""
    named = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == entry.attr]
    said = [*map(ast.get_docstring, named), ast.get_docstring(tree)]
    first = next((words.strip().splitlines()[0] for words in said if words and words.strip()), "")
    sentence = first.split(": ", 1)[-1] if first.startswith("``") else first
    sentence = sentence.split(".")[0].split("; ")[0].strip()
    return sentence[:1].lower() + sentence[1:]


def source_of(module: str) -> Path | None:
    """Return the file of a module, without importing the packages that hold it."""
    top, *inner = module.split(".")
    spec = PathFinder.find_spec(top) or find_spec(top)
    if spec is None:
        return None
    if not inner:
        return Path(spec.origin) if spec.origin else None
    for folder in spec.submodule_search_locations or ():
        place = Path(folder, *inner)
        for found in (place.with_suffix(".py"), place / "__init__.py"):
            if found.is_file():
                return found
    return None
