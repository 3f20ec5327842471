"""The two forms of the tests: what each runs, what the short one says of the long one, and the page of the long one."""

from __future__ import annotations

import datetime
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import campaign
import pytest

HERE = Path(__file__).parent

_BEGAN = time.monotonic()
#: Of this run: how many tests are left to the long form, and what its campaigns told.
_LEFT: Counter[str] = Counter()
_TOLD: list[tuple[str, str]] = []


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer the page of results."""
    parser.addoption("--results", metavar="FILE", type=Path, help="write what the long form found to this page")


def pytest_configure(config: pytest.Config) -> None:
    """Find out which form runs, before any test is collected."""
    campaign.FULL = campaign.chosen(config.option.markexpr)


@pytest.hookimpl(tryfirst=True)  # before marks are selected and groups are read
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let the long form run the campaigns, too; count what the short form leaves out."""
    for item in items:
        if campaign.FULL and item.get_closest_marker("campaign"):
            item.add_marker("long")
        elif not campaign.FULL:
            _LEFT["long"] += bool(item.get_closest_marker("long"))
            _LEFT["campaign"] += bool(item.get_closest_marker("campaign"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
    """Send what a campaign told along with the test's result."""
    if call.when == "call":
        item.user_properties += [("campaign", text) for text in campaign.TOLD]
        campaign.TOLD.clear()
    return (yield)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Collect what the campaigns told."""
    if report.when == "call":
        _TOLD.extend((report.nodeid, str(text)) for name, text in report.user_properties if name == "campaign")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Hand the count of a worker to the process that prints."""
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["left"] = dict(_LEFT)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any, error: object) -> None:
    """Take the count of a worker: all collect the same tests."""
    _LEFT.update(getattr(node, "workeroutput", {}).get("left", {}) if not _LEFT else {})


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Say what the long form would add, or what it has found."""
    if campaign.FULL:
        for _, text in _TOLD:
            terminalreporter.write_line(f"campaign: {text}")
        if config.option.results:
            config.option.results.write_text(_page(terminalreporter), encoding="utf-8")
    elif _LEFT["long"] or _LEFT["campaign"]:
        terminalreporter.write_line(
            f"left to the long form (-m long): {_LEFT['long']} tests, and the full size of {_LEFT['campaign']} campaigns"
        )


def _page(reporter: Any) -> str:
    """Return the page of a run of the long form."""
    words = ["git", "-C", str(HERE), "log", "-1", "--format=%h of %cs"]
    commit = subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
    counts = {name: len(reporter.stats.get(name, ())) for name in ("passed", "failed", "error", "skipped")}
    command = " ".join(["pytest", *sys.argv[1:]])
    took = datetime.timedelta(seconds=round(time.monotonic() - _BEGAN))
    lines = [
        "# The last whole run of the long form",
        "",
        f"`{command}`, {datetime.datetime.now(datetime.UTC).date()}, commit {commit}: "
        + ", ".join(f"{count} {name}" for name, count in counts.items() if count)
        + f", in {took}.",
        "",
        "| campaign | result |",
        "|---|---|",
        *(f"| `{name.split('[')[0]}` | {text} |" for name, text in _TOLD),
        "",
    ]
    return "\n".join(lines)
