"""Doing what a scaffold's README says, literally."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

_BLOCK = re.compile(r"\*\*Step (\d+)\*\* \(`([\w.]+)`\)(.*?)(?=\*\*Step|\Z)", re.S)


def finish(home: Path, package: str) -> int:
    """Put each step's example into its place and delete the step's line; return the number of steps."""
    count = 0
    for number, file, text in _BLOCK.findall((home / "README.md").read_text()):
        path = home / package / file
        lines = path.read_text().splitlines()
        at = next(i for i, line in enumerate(lines) if f"STEP {number}:" in line)
        block = re.search(r"```python\n(.*?)```", text, re.S)
        if block is None:
            del lines[at]
        else:
            indent = " " * (len(lines[at]) - len(lines[at].lstrip()))
            lines[at : at + 1] = textwrap.indent(block[1].rstrip("\n"), indent).splitlines()
        path.write_text("\n".join(lines) + "\n")
        count += 1
    return count
