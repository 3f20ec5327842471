"""Writes the page of all sentences: ``python tests/house/rooms.py --write`` puts it beside the page of all files.

Each sentence that the program may say stands there in the file that says it: who wants other words finds the file by a
search for those that he has seen.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator

from module_pages import plain
from sources import ROOT, modules

PAGE = ROOT / "docs" / "reference" / "sentences.md"
HEAD = """# Sentences

This page lists all texts of the program by the file that has them: messages, notices, words in tables, windows and reports, help. An ellipsis (…) stands for
what is filled in. Search this page for words that you have seen to find the file to change. Texts outside Python files are not here: the page of a
session, the browser's window, templates and firmware, which stand at the end of [modules and constants](modules.md). Written by `python
tests/house/rooms.py --write`.
"""
#: How many words a text has at least that is taken for a sentence, and how many lines at most.
LEAST, MOST = 3, 4


def page() -> str:
    """Return the page as Markdown."""
    lines = [HEAD]
    for module in sorted(modules().values(), key=lambda module: module.path):
        if found := list(dict.fromkeys(sentences(module.tree))):
            lines.append(f"## {plain(str(module.path.relative_to(ROOT)))}\n")
            lines += [f"- {plain(text)}" for text in found]
            lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def sentences(tree: ast.AST) -> Iterator[str]:
    """Yield the texts of a module that are sentences, in their order, without docstrings."""
    for node in _values(tree):
        if isinstance(node, ast.JoinedStr):
            text = "".join(part.value if _is_text(part) else "…" for part in node.values)  # type: ignore[misc,attr-defined]
        elif _is_text(node):
            text = node.value  # type: ignore[attr-defined]
        else:
            continue
        lines = text.strip().split("\n")
        is_xml = text.lstrip().startswith("<") and text.rstrip().endswith(">")
        if len(lines) <= MOST and not is_xml:  # nor is code or a template a sentence
            yield from (" ".join(line.split()) for line in lines if len(line.split()) >= LEAST and _has_words(line))


def _values(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a tree in the order of the text, no docstring, and nothing inside a formatted text's parts."""
    left = [iter([tree])]
    while left:
        node = next(left[-1], None)
        if node is None:
            left.pop()
            continue
        if len(left) > 1:
            if isinstance(node, ast.Expr) and _is_text(node.value):
                continue
            yield node
        if isinstance(node, ast.JoinedStr):
            parts = [part.value for part in node.values if isinstance(part, ast.FormattedValue)]
            left += [ast.iter_child_nodes(part) for part in reversed(parts)]
        else:
            left.append(ast.iter_child_nodes(node))


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _has_words(line: str) -> bool:
    """Tell words from formats and lists of numbers: three of them are letters alone, but for what ends them."""
    return sum(word.strip(".,:;()'\"!?").isalpha() for word in line.split()) >= LEAST
