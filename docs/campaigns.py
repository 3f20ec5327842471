"""The page of campaigns and their figures, and the table of the safety case, both from `campaigns.toml`."""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
CASE = HERE / "explanation" / "safety-case.md"
BEGIN, END = "<!-- table: docs/campaigns.toml -->\n", "<!-- end of the table -->"
_HEAD = """# Campaigns and their figures

This page shows what campaigns measured on simulated twins: the newest run of each command, with its date and commit.
Below each table stand the earlier runs whose findings changed something. Other figures that pages link stand
[below](#FIRST); each links the page that explains it. `python docs/reference_pages.py` writes this page, and the table
of [the safety case](safety-case.md), from `docs/campaigns.toml`.
"""


def claims() -> list[dict[str, Any]]:
    """Return what is claimed, in the order of the table, with the runs that show it."""
    return tomllib.loads((HERE / "campaigns.toml").read_text(encoding="utf-8"))["claim"]  # type: ignore[no-any-return]


def figures() -> list[dict[str, str]]:
    """Return what pages link: their figures, each with its heading, the page, and the text with command and date."""
    return tomllib.loads((HERE / "campaigns.toml").read_text(encoding="utf-8"))["figures"]  # type: ignore[no-any-return]


def anchor(name: str) -> str:
    """Return the anchor of a heading."""
    return re.sub(r"[^\w -]", "", name.lower()).replace(" ", "-")


def page() -> str:
    """Return the page of campaigns as Markdown."""
    lines = [_HEAD.replace("#FIRST", f"#{anchor(figures()[0]['name'])}")]
    for claim in claims():
        if "run" not in claim:
            continue
        lines += [f"## {claim['name'].capitalize()}\n", f"{_sentence(claim['says'])}\n"]
        lines += ["| command | figure | date | commit |", "|---|---|---|---|"]
        lines += [f"| {run['command']} | {run['figure']} | {run['date']} | {run['commit']} |" for run in claim["run"]]
        if claim.get("earlier"):
            lines += ["\nEarlier runs:\n", *(f"- {text}" for text in claim["earlier"])]
        lines.append("")
    for one in figures():
        page_of = os.path.relpath(one["page"], "explanation")
        lines += [f"## {one['name']}\n", f"Background and method: []({page_of}).\n", one["text"].strip("\n"), ""]
    return "\n".join(lines)


def table() -> str:
    """Return the table of the safety case: a claim a line, with its newest figure and a link to the runs."""
    lines = ["| claim | how to see it | newest figure |", "|---|---|---|"]
    for claim in claims():
        if "short" not in claim:
            continue
        figure = claim["short"]
        if "run" in claim:
            first = claim["run"][0]
            figure += f" ([{first['date']}, {first['commit']}](campaigns.md#{anchor(claim['name'])}))"
        lines.append(f"| {claim['says']} | {claim['see']} | {figure} |")
    return "\n".join(lines) + "\n"


def case() -> str:
    """Return the safety case with its table as it must be."""
    text = CASE.read_text(encoding="utf-8")
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    return text[:begin] + table() + text[end:]


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:] + "." if text[0] != "`" else text + "."
