"""Prints how many lines of each room of the framework speak of heat or plates: ``python tests/meaning/heat_words.py``.

Nothing is renamed or left undocumented to lower the count: it shows where a particular kind of display is spoken of.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

FRAMEWORK = Path(__file__).parents[2] / "framework" / "itouch"
_WORDS = re.compile(r"plate|heat|flux|temperature|skin|dose", re.IGNORECASE)


def counted(folder: Path = FRAMEWORK) -> Counter[str]:
    """Return the number of such lines by room."""
    found: Counter[str] = Counter()
    for file in folder.rglob("*.py"):
        lines = sum(bool(_WORDS.search(line)) for line in file.read_text(encoding="utf-8").splitlines())
        if lines:
            found[file.relative_to(folder).parts[0]] += lines
    return found


if __name__ == "__main__":
    for room, lines in counted().most_common():
        print(f"{lines:5}  {room}")
    print(f"{counted().total():5}  in all")
