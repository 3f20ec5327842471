"""The pytest plugin: it prints each suite's score card at the end of a run, and the next step of a new plugin.

It is switched on by ``pytest -p itouch.testing.plugin``, or by ``addopts`` in ``pyproject.toml``, as a scaffold does.
"""

from __future__ import annotations

import re
from typing import Any

import pytest

from itouch.testing.checks import Check, CheckResult
from itouch.testing.score_card import Card

_STEP = re.compile(r"next is (step \d+: .*)")


#: The test of a scaffold that fails as long as a step remains to be done.
_STEPS = "test_all_steps_are_done"


def pytest_collection_modifyitems(items: list[Any]) -> None:
    """Run the test of a new plugin's steps first."""
    items.sort(key=lambda item: item.name != _STEPS)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: Any) -> Any:
    """Remember it if a step remains to be done."""
    report = (yield).get_result()
    if item.name == _STEPS and report.failed:
        item.session.itouch_steps = True


def pytest_runtest_setup(item: Any) -> None:
    """Skip all other tests until all steps are done."""
    if getattr(item.session, "itouch_steps", False):
        pytest.skip("finish the steps first")


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Write the score cards, and finally the next step."""
    cards: dict[str, list[CheckResult]] = {}
    step = ""
    for reports in terminalreporter.stats.values():
        for report in reports:
            for name, value in getattr(report, "user_properties", ()):
                if name == "itouch" and getattr(report, "when", "") == "call":
                    suite, check, title, outcome, note, seconds = value
                    finding = CheckResult(Check(check, title, _nothing), outcome, note, seconds)
                    cards.setdefault(suite, []).append(finding)
            found = _STEP.search(str(getattr(report, "longrepr", "") or ""))
            step = found[1] if found and not step else step
    for suite, findings in cards.items():
        terminalreporter.write_sep("=", suite)
        Card(f"{len(findings)} checks", terminalreporter).write(findings)
    if step:
        terminalreporter.write_sep("=", "what to do next")
        terminalreporter.write_line(step)


def _nothing(harness: Any) -> None:
    """Stand in for the function of a check that was run already."""
