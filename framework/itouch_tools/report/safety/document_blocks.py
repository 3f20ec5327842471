"""A document of headings, paragraphs, lists and tables, as Markdown and as one HTML page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading of level 1 to 3."""

    text: str
    level: int = 2


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph; ``kind`` is "", "good", "bad" or "note"."""

    text: str
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Items:
    """A list of points, numbered or not."""

    points: tuple[str, ...]
    numbered: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table; the rows whose indices are in ``bad`` are highlighted in HTML."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    bad: frozenset[int] = frozenset()


Block = Heading | Paragraph | Items | Table


def markdown(blocks: Iterable[Block]) -> str:
    """Return the document as Markdown."""
    return "\n\n".join(_markdown(block) for block in blocks) + "\n"


def _markdown(block: Block) -> str:
    if isinstance(block, Heading):
        return f"{'#' * block.level} {block.text}"
    if isinstance(block, Paragraph):
        return f"**{block.text}**" if block.kind in ("good", "bad") else block.text
    if isinstance(block, Items):
        marks = [f"{n}." for n in range(1, len(block.points) + 1)] if block.numbered else ["-"] * len(block.points)
        return "\n".join(f"{mark} {point}" for mark, point in zip(marks, block.points, strict=True))
    lines = [_row(block.header), _row(["---"] * len(block.header))]
    return "\n".join([*lines, *(_row(row) for row in block.rows)])


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def html(blocks: Iterable[Block], title: str) -> str:
    """Return the document as one HTML page that needs nothing else."""
    body = "\n".join(_html(block) for block in blocks)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width">\n<title>{escape(title)}</title>\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _html(block: Block) -> str:
    if isinstance(block, Heading):
        return f"<h{block.level}>{escape(block.text)}</h{block.level}>"
    if isinstance(block, Paragraph):
        kind = f' class="{block.kind}"' if block.kind else ""
        return f"<p{kind}>{escape(block.text)}</p>"
    if isinstance(block, Items):
        tag = "ol" if block.numbered else "ul"
        return f"<{tag}>{''.join(f'<li>{escape(point)}</li>' for point in block.points)}</{tag}>"
    head = "".join(f"<th>{escape(cell)}</th>" for cell in block.header)
    rows = "\n".join(_html_row(row, index in block.bad) for index, row in enumerate(block.rows))
    return f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"


def _html_row(cells: Sequence[str], bad: bool) -> str:
    mark = ' class="bad"' if bad else ""
    return f"<tr{mark}>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"


_STYLE = """
body { font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #1c2430; background: #fff; margin: 0 }
main { max-width: 60rem; margin: 2rem auto; padding: 0 1.5rem }
h1 { font-size: 1.8rem; margin: 0 0 .3rem } h2 { font-size: 1.25rem; margin: 2.2rem 0 .6rem; padding-bottom: .2rem;
 border-bottom: 2px solid #d7dde5 } h3 { font-size: 1.05rem; margin: 1.4rem 0 .4rem }
table { border-collapse: collapse; width: 100%; margin: .6rem 0 1rem; font-size: .87rem }
th { text-align: left; background: #eef2f6; } th, td { border: 1px solid #d7dde5; padding: .3rem .5rem;
 vertical-align: top }
td:last-child { overflow-wrap: anywhere; min-width: 12rem } td:first-child { white-space: nowrap }
tbody tr:nth-child(even) { background: #f8fafc }
tbody tr.bad td { background: #fdecea } p.good, p.bad, p.note { padding: .6rem .8rem; border-left: 5px solid }
p.good { background: #eaf6ee; border-color: #2e8b57 } p.bad { background: #fdecea; border-color: #c0392b;
 font-weight: 600 } p.note { background: #fff7e0; border-color: #d9a400 }
@media print { main { max-width: none; margin: 0 } h2 { break-after: avoid } tr { break-inside: avoid } }
"""
