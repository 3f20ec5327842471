"""The syntax trees of source files, each parsed once in a process: several tests read them all."""

from __future__ import annotations

import ast
from functools import cache


@cache
def syntax(text: str) -> ast.Module:
    """Return the syntax tree of a file's text, which is for reading only: parsing takes longer than what is looked for."""
    return ast.parse(text)
