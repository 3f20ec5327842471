"""What was measured on a day or at a commit stands on the pages of figures; other pages say what it means, and link it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from listings import DOCS, ROOT, pages

#: Pages that are there for dates and commits: what was measured, what was changed, what was decided.
_PLACES = {
    "docs/explanation/campaigns.md",
    "docs/explanation/long-form.md",
    "docs/explanation/safety-case.md",
    "docs/changes.md",
}
#: Lines of other pages that have a day or a commit, by page: what the line has in it, and why it stays there.
_EXCEPTED = {
    "docs/how-to/calibrate.md": (
        ("touch-off of 2026-11-21, until 2026-12-21", "what the command prints of its record"),
        ("holds until 2026-12-21", "the same"),
        ("mount-fit of 2026-11-21, until 2027-05-20", "the same"),
        ("holds until 2027-05-20", "the same"),
    ),
    "docs/index.md": (("itouch-py 0.1.0, commit 155cd18:", "an example of how a version is cited"),),
    "docs/reference/screens.md": (
        ("Before (version 0.1, commit ccd28ae)", "the program of which the old pictures can be made again"),
        ("Before (commit ccd28ae)", "the same"),
    ),
}
_MONTHS = "January|February|March|April|May|June|July|August|September|October|November|December"
_DAY = re.compile(rf"\b20\d\d-\d\d-\d\d\b|\b\d{{1,2}} (?:{_MONTHS}) 20\d\d\b")
#: Seven to ten digits of a hash: letters and digits, or what is called a commit.  Longer ones are digests of runs.
_COMMIT = re.compile(
    r"(?<![\w/.#-])(?=[a-f]*\d)(?=\d*[a-f])[0-9a-f]{7,10}(?![\w/-])|commits? `?(?=[a-f]*\d)[0-9a-f]{7,40}\b"
)


def told(page: str, text: str) -> list[str]:
    """Return the lines of a page that have a day or a commit and are not excepted."""
    allowed = [part for part, _ in _EXCEPTED.get(page, ())]
    lines = [line for line in text.splitlines() if _DAY.search(line) or _COMMIT.search(line)]
    return [line for line in lines if not any(part in line for part in allowed)]


def _pages() -> list[Path]:
    found = [*pages(), *sorted(ROOT.glob("plugins/**/README.md"))]
    return [
        page for page in found
        if page.relative_to(ROOT).as_posix() not in _PLACES and page.parent.name not in ("decisions", "notebooks")
    ]  # fmt: skip


@pytest.mark.parametrize("page", _pages(), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_links_what_was_measured_on_a_day(page: Path) -> None:
    name = page.relative_to(ROOT).as_posix()
    assert told(name, page.read_text(encoding="utf-8")) == [], "move it to docs/campaigns.toml, and link the entry"


def test_excepted_lines_are_there() -> None:
    for page, lines in _EXCEPTED.items():
        text = (ROOT / page).read_text(encoding="utf-8")
        assert [part for part, _ in lines if part not in text] == [], page


def test_the_specification_of_the_display_has_the_limits_that_the_bench_prints() -> None:
    page = (DOCS / "reference" / "thermal-display.md").read_text(encoding="utf-8")
    specified = "".join(re.findall(r"^\|.*\|.*(\|.*\|.*\|)$", page.partition("## Specification\n")[2], flags=re.M))
    printed = (DOCS / "explanation" / "campaigns.md").read_text(encoding="utf-8")
    rows = re.findall(r"^(\S.{38}) (.{40}) +\S+ +(\S+) ok ", printed, flags=re.M)
    limits = {float(limit) for case, figure, limit in rows if "that of paper" not in figure and "plate " not in figure}
    assert len(rows) > 25 and {0.8, 3.0, 1.25, 35000.0} <= limits
    told = {float(number) for number in re.findall(r"\d+(?:\.\d+)?", specified)} | {35000.0}
    assert "35 kW/m²" in specified and limits - told == set()


@pytest.mark.parametrize(
    ("line", "seen"),
    [
        ("Of 400 random motions one had more (25 November 2026).", True),
        ("On 2026-11-26 it was 0.3 %.", True),
        ("It was 0.3 % at `b2bdb93e`.", True),
        ("Measured at commit 1231584: 0.3 %.", True),
        ("Since f0654ed the rest is compiled code.", True),
        ("It was 0.3 % of 1231584 samples, in 2026.", False),
        ("| `cad51a824f9c` | 3.1 % | foam |", False),
        ("The effaced facade was 12 mm off.", False),
    ],
)
def test_a_day_and_a_commit_are_seen(line: str, seen: bool) -> None:
    assert told("docs/page.md", line) == [line] * seen
