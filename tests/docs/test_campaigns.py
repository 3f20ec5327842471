"""Each figure of a campaign stands once, with its command, date and commit, and the pages show what is written there."""

from __future__ import annotations

import datetime
import importlib.metadata
import re
import subprocess
import sys

import pytest
from listings import DOCS

sys.path.insert(0, str(DOCS))

import campaigns

ROOT = DOCS.parent
CLAIMS = campaigns.claims()
_ADVICE = "docs/campaigns.toml makes another page: python docs/reference_pages.py"


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


def test_figures_are_linked_by_their_page_and_say_command_and_date() -> None:
    for one in campaigns.figures():
        anchor = one["name"].lower().replace(" ", "-").replace(",", "")
        assert f"campaigns.md#{anchor})" in (DOCS / one["page"]).read_text(encoding="utf-8"), one["name"]
        assert re.search(r"\b20\d\d\b", one["text"]) and "`itouch-py " in one["text"], one["name"]


def test_what_claims_name_is_there() -> None:
    benches = {one.name for one in importlib.metadata.entry_points(group="itouch.benches")}
    text = campaigns.table() + campaigns.page()
    named = set(re.findall(r"itouch-py bench ([\w-]+)", text))
    assert named and named <= benches
    tests = set(re.findall(r"tests/[\w/]+\.py", text))
    assert len(tests) > 8 and not [name for name in tests if not (ROOT / name).is_file()]


def test_commits_of_runs_are_of_this_history() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("no history here")
    shallow = subprocess.run(["git", "rev-parse", "--is-shallow-repository"], cwd=ROOT, capture_output=True, text=True)
    if shallow.stdout.strip() != "false":
        pytest.skip("no whole history here")
    for commit in {run["commit"] for claim in CLAIMS for run in claim.get("run", ())}:
        done = subprocess.run(["git", "merge-base", "--is-ancestor", commit, "HEAD"], cwd=ROOT, capture_output=True)
        assert done.returncode == 0, commit
