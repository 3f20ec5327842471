"""HTML tables and cells of a session's page; every text that goes into them is escaped here."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence


def text(value: object) -> str:
    """Return a text as markup that shows it, whatever it holds."""
    return html.escape(str(value).encode("utf-8", "replace").decode())


def number(value: object, form: str = ".6g", scale: float = 1.0) -> str:
    """Return a value as the text of a cell: a number in this form, ``None`` or an infinity as a dash, text as it is."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int) and form == ".6g":
        return str(value)
    if isinstance(value, int | float):
        try:
            shown = format(float(value) * scale, f"z{form}" if form.startswith(".") else form)
        except OverflowError:
            return "-"
        return shown if math.isfinite(float(value) * scale) else "-"
    return str(value)


def table(
    heads: Sequence[str], rows: Sequence[Sequence[object]], *, words: Sequence[int] = (), choices: bool = False
) -> str:
    """Return a table; ``words`` are the columns that hold text; with ``choices`` its rows can be chosen."""
    mark = [' class="words"' if index in words else "" for index in range(len(heads))]
    head = "".join(f'<th scope="col"{m}>{text(title)}</th>' for m, title in zip(mark, heads, strict=True))
    row_tag = '<tr class="choice" tabindex="0" role="button" aria-pressed="false">' if choices else "<tr>"
    body = "".join(
        row_tag + "".join(f"<td{m}>{text(cell)}</td>" for m, cell in zip(mark, row, strict=True)) + "</tr>\n"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>'


def flattened(name: str, value: object) -> list[tuple[str, str]]:
    """Return nested figures as rows of name and text."""
    if isinstance(value, Mapping):
        return [row for key, inner in value.items() for row in flattened(f"{name} {_plain(key)}".strip(), inner)]
    if isinstance(value, list | tuple) and any(isinstance(entry, Mapping) for entry in value):
        return [(f"{name} {i}", _sentence(entry)) for i, entry in enumerate(value, start=1)]
    return [] if value is None or value == [] else [(name, _sentence(value))]


def _sentence(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{_plain(key)} {_sentence(inner)}" for key, inner in value.items())
    return ", ".join(map(_sentence, value)) if isinstance(value, list | tuple) else number(value)


def _plain(key: object) -> str:
    return str(key).replace("_", " ")
