"""Each figure of a campaign stands once, with its command, date and commit, and the pages show what is written there."""

from __future__ import annotations

import datetime
import importlib.metadata
import re
import subprocess
import sys

import pytest
from listings import DOCS
from requirements import missing

sys.path.insert(0, str(DOCS))

import campaigns

ROOT = DOCS.parent
CLAIMS = campaigns.claims()
#: Figures of runs whose commit nobody wrote down.
NO_COMMIT = ("Topics of ROS 2", "A sweep on Ray", "Firmware on a simulated chip")
_COMMAND = re.compile(r"`(?:itouch-py|pytest|python) ")
_DATE = re.compile(r"\b20\d\d-\d\d-\d\d\b|\b\d{1,2} (?:October|November|December) 20\d\d\b")
#: A hash has a digit, and no point of a decimal beside it; numbers of seven digits are written with spaces.
_COMMIT = re.compile(r"(?<![\w.])(?=[a-f]*\d)[0-9a-f]{7,40}(?!\w|\.\d)")
_ADVICE = "docs/campaigns.toml makes another page: python docs/reference_pages.py"


def lacks(text: str) -> list[str]:
    """Return what a text of figures does not say of how they were made."""
    commits = _COMMIT.findall(text)
    missing = [
        name for name, found in (("command", _COMMAND), ("date", _DATE), ("commit", _COMMIT)) if not found.search(text)
    ]
    return missing + ["commit of 7 digits"] * any(len(commit) != 7 for commit in commits)


def test_the_pages_of_campaigns_are_current() -> None:
    assert (DOCS / "explanation" / "campaigns.md").read_text(encoding="utf-8") == campaigns.page(), _ADVICE
    assert campaigns.CASE.read_text(encoding="utf-8") == campaigns.case(), _ADVICE


def test_a_claim_is_short_and_a_campaign_has_a_name_and_runs() -> None:
    for claim in CLAIMS:
        assert len(claim.get("short", "")) <= 120, claim["short"]
        assert ("name" in claim) == ("run" in claim) and claim.get("run") != []
        for run in claim.get("run", ()):
            assert (
                isinstance(run["date"], datetime.date) and run["figure"] and re.fullmatch("[0-9a-f]{7}", run["commit"])
            )
    names = [claim["name"] for claim in CLAIMS if "name" in claim]
    assert len(names) == len(set(names))
    links = {claim["name"]: f"(campaigns.md#{claim['name'].replace(' ', '-')})" for claim in CLAIMS if "name" in claim}
    assert all((links[claim["name"]] in campaigns.table()) == ("short" in claim) for claim in CLAIMS if "name" in claim)


def test_figures_are_linked_by_their_page_and_say_command_date_and_commit() -> None:
    names = [one["name"] for one in campaigns.figures()]
    assert len(names) == len(set(names)) and set(NO_COMMIT) <= set(names)
    for one in campaigns.figures():
        assert f"campaigns.md#{campaigns.anchor(one['name'])})" in (DOCS / one["page"]).read_text(encoding="utf-8"), (
            one["name"]
        )
        assert lacks(one["text"]) == (["commit"] if one["name"] in NO_COMMIT else []), one["name"]


@pytest.mark.parametrize(
    ("text", "lacking"),
    [
        ("`itouch-py bench loop`, 2026-11-27, commit `2bb3cd7`: 3 of 4", []),
        ("`pytest -m long tests/loop`, 3 November 2026, 1231584", []),
        ("`scenes/blocks.xml`, 2026-11-27, commit 2bb3cd7", ["command"]),
        ("`itouch-py bench loop`, November, commit 2bb3cd7", ["date"]),
        ("`itouch-py bench loop`, 2026-11-27", ["commit"]),
        ("`itouch-py bench loop`, 2026-11-27, 2bb3cd77", ["commit of 7 digits"]),
    ],
)
def test_what_a_figure_lacks_is_seen(text: str, lacking: list[str]) -> None:
    assert lacks(text) == lacking


def test_what_claims_name_is_there() -> None:
    benches = {one.name for one in importlib.metadata.entry_points(group="itouch.benches")}
    text = campaigns.table() + campaigns.page()
    named = set(re.findall(r"itouch-py bench ([\w-]+)", text))
    assert named and named <= benches
    tests = set(re.findall(r"tests/[\w/]+\.py", text))
    assert len(tests) > 8 and not [name for name in tests if not (ROOT / name).is_file()]


def test_commits_of_runs_are_of_this_history() -> None:
    if not (ROOT / ".git").exists():
        missing("no history here: test a clone of the repository")
    shallow = subprocess.run(["git", "rev-parse", "--is-shallow-repository"], cwd=ROOT, capture_output=True, text=True)
    if shallow.stdout.strip() != "false":
        missing("no whole history here: git fetch --unshallow")
    told = {commit for one in campaigns.figures() for commit in _COMMIT.findall(one["text"])}
    for commit in told | {run["commit"] for claim in CLAIMS for run in claim.get("run", ())}:
        done = subprocess.run(["git", "merge-base", "--is-ancestor", commit, "HEAD"], cwd=ROOT, capture_output=True)
        assert done.returncode == 0, commit
