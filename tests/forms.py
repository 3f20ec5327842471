"""The two forms of the tests: what each runs, what the short one says of the long one, and what the long one keeps."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any

import campaign
import long_results
import pytest
from requirements import MEANT

HERE = Path(__file__).parent
#: Tests that a whole run of the short form leaves out though they are not marked ``long``: one a line, a test of some
#: parameters, a test of any, or a file.  Chosen by ``python tests/reach.py``, by what each reaches, costs and notices.
LIST = HERE / "long_form.txt"
#: Tests that stay in the short form whatever they cost, each behind the comment that says why.
KEPT = HERE / "short_form.txt"

#: Of this run: how many tests are left to the long form, and what its campaigns told.
_LEFT: Counter[str] = Counter()
_TOLD: list[tuple[str, str]] = []
#: What the workers found wrong with the lists of tests: all the same.
_STALE = set[str]()
_DONE = pytest.StashKey[frozenset[str]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer the page of results."""
    parser.addoption(
        "--results", metavar="FILE.jsonl", type=Path, help="note what ends in it; leave out what has passed"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Find out which form runs, before any test is collected."""
    campaign.FULL = campaign.chosen(config.option.markexpr)
    if (path := config.option.results) and not hasattr(config, "workerinput"):
        if not campaign.FULL:
            raise pytest.UsageError("--results keeps what the long form found: give it with -m long")
        config.stash[_DONE] = long_results.passed(path)
        config.pluginmanager.register(_Keeper(path))


class _Keeper(long_results.Keeper):
    """Hears of every test that ends, in whichever process it ran."""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a part of a test."""
        told = [str(text) for name, text in report.user_properties if name == "campaign"]
        self.note(report.nodeid, report.when or "call", report.outcome, report.duration, told)


def has_passed(config: pytest.Config) -> frozenset[str]:
    """Return the tests that had passed when this run began: for all its processes the same."""
    found = getattr(config, "workerinput", {}).get("passed")
    return config.stash.get(_DONE, frozenset()) if found is None else frozenset(found)


def is_whole(config: pytest.Config) -> bool:
    """Tell whether all tests run, and not only files or tests that were named."""
    found = getattr(config, "workerinput", {}).get("whole")
    return config.args_source is config.ArgsSource.TESTPATHS if found is None else bool(found)


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Tell a worker, which is always given names, whether the run is a whole one."""
    node.workerinput |= {"whole": is_whole(node.config), "passed": sorted(has_passed(node.config))}


def stands_in(test: str, listed: frozenset[str]) -> bool:
    """Tell whether a list of tests, or of files, holds a test."""
    return not listed.isdisjoint((test, test.partition("[")[0], test.partition("::")[0]))


def _was_left_out(root: Path, test: str, present: set[str]) -> bool:
    """Tell whether a test's whole file was left out, for want of an extra: then nobody knows what stands in it."""
    file = root / test.partition("::")[0]
    return file.is_file() and str(file) not in present


def _stale(config: pytest.Config, items: list[pytest.Item], lists: Mapping[Path, frozenset[str]]) -> str:
    """Return what is wrong with the lists of tests, in a sentence, or nothing."""
    there = {
        name for item in items for name in (item.nodeid, item.nodeid.partition("[")[0], item.nodeid.partition("::")[0])
    }
    present = {str(item.path) for item in items}
    for path, names in lists.items():
        if gone := sorted(name for name in names - there if not _was_left_out(config.rootpath, name, present)):
            return (
                f"tests/{path.name} names tests that are not there (any more): take these lines out, or give them the "
                f"new names: {', '.join(gone)}"
            )
    return ""


def read_list(path: Path) -> frozenset[str]:
    """Return the tests that stand in a list."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return frozenset(line for line in lines if line and not line.startswith("#"))


@pytest.hookimpl(tryfirst=True)  # before marks are selected and groups are read
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Let the long form run the campaigns, too; count what the short form leaves out.

    A run of the short form that names files or tests runs all of them that are not marked: who works on a room wants
    all of its tests.

    Raises
    ------
    pytest.UsageError
        If the list names what is not there, so that a test that was renamed comes back into the short form.  A worker
        can't refuse in a sentence: it hands that to the process that prints, and runs nothing.

    """
    listed, kept = read_list(LIST), read_list(KEPT)
    whole = is_whole(config)
    if whole and (sentence := _stale(config, items, {LIST: listed, KEPT: kept})):
        output = getattr(config, "workeroutput", None)
        if output is None:
            raise pytest.UsageError(sentence)
        output["stale"] = sentence
        items.clear()
        return
    if done := has_passed(config):
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid in done])
        items[:] = [item for item in items if item.nodeid not in done]
    for item in items:
        if (whole or campaign.FULL) and stands_in(item.nodeid, listed) and not stands_in(item.nodeid, kept):
            item.add_marker("long")
        if campaign.FULL and item.get_closest_marker("campaign"):
            item.add_marker("long")
        elif not campaign.FULL:
            _LEFT["long"] += bool(item.get_closest_marker("long"))
            _LEFT["campaign"] += bool(item.get_closest_marker("campaign"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Send what a campaign told along with the test's result; let a test fail that ``CI`` may not leave out."""
    if call.when == "call":
        item.user_properties += [("campaign", text) for text in campaign.TOLD]
        campaign.TOLD.clear()
    report: pytest.TestReport = yield
    # a check of the conformance suite tells with its result why it has no meaning for a plugin
    if not hasattr(report, "wasxfail") and not any(name == "itouch" for name, _ in item.user_properties):
        leave_nothing_out(report)
    return report


@pytest.hookimpl(tryfirst=True)  # before it is counted, or sent to the process that prints
def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Let a whole file fail that ``CI`` may not leave out."""
    leave_nothing_out(report)


def leave_nothing_out(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn what was skipped into what has failed where ``CI`` is set, unless it is meant to be left out there, too."""
    if report.outcome != "skipped" or not os.environ.get("CI"):
        return
    reason = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr)
    reason = reason.removeprefix("Skipped: ")
    if reason not in MEANT:
        report.outcome = "failed"
        report.longrepr = f"where CI is set nothing is left out, and this was: {reason}"


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Collect what the campaigns told."""
    if report.when == "call":
        _TOLD.extend((report.nodeid, str(text)) for name, text in report.user_properties if name == "campaign")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Hand the count of a worker to the process that prints; nothing is wrong where all has passed before."""
    if session.exitstatus == pytest.ExitCode.NO_TESTS_COLLECTED and has_passed(session.config):
        session.exitstatus = pytest.ExitCode.OK
    if _STALE:
        session.exitstatus = pytest.ExitCode.USAGE_ERROR
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["left"] = dict(_LEFT)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any, error: object) -> None:
    """Take the count of a worker: all collect the same tests."""
    output = getattr(node, "workeroutput", {})
    _LEFT.update(output.get("left", {}) if not _LEFT else {})
    _STALE.update([output["stale"]] if "stale" in output else [])


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Say what the long form would add, or what it has found; or that a list of tests is stale."""
    for sentence in _STALE:
        terminalreporter.write_line(f"ERROR: {sentence}", red=True)
    if campaign.FULL:
        for _, text in _TOLD:
            terminalreporter.write_line(f"campaign: {text}")
        if before := len(has_passed(config)):
            terminalreporter.write_line(f"passed before and left out: {before} tests ({config.option.results})")
    elif _LEFT["long"] or _LEFT["campaign"]:
        terminalreporter.write_line(
            f"left to the long form (-m long): {_LEFT['long']} tests, and the full size of {_LEFT['campaign']} campaigns"
        )
