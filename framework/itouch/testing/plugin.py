"""The pytest plugin: at the end of a run the score card of every suite, and which step of a new plugin is next.

It is switched on by ``pytest -p itouch.testing.plugin``, or by ``addopts`` in ``pyproject.toml`` as a scaffold does.
"""

from __future__ import annotations

import re
from typing import Any

import pytest

from itouch.testing.checks import Check, Finding
from itouch.testing.score_card import Card

_STEP = re.compile(r"next is (step \d+: .*)")


#: The test of a scaffold that fails as long as a step is to be done.
_STEPS = "test_all_steps_are_done"


def pytest_collection_modifyitems(items: list[Any]) -> None:
    """Begin with the steps of a new plugin."""
    items.sort(key=lambda item: item.name != _STEPS)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: Any) -> Any:
    """Remember that a step is still to be done."""
    report = (yield).get_result()
    if item.name == _STEPS and report.failed:
        item.session.itouch_steps = True


def pytest_runtest_setup(item: Any) -> None:
    """Leave everything else out until all steps are done."""
    if getattr(item.session, "itouch_steps", False):
        pytest.skip("first the steps are to be done")


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Write the cards, and last of all the next step."""
    cards: dict[str, list[Finding]] = {}
    step = ""
    for reports in terminalreporter.stats.values():
        for report in reports:
            for name, value in getattr(report, "user_properties", ()):
                if name == "itouch" and getattr(report, "when", "") == "call":
                    suite, check, title, outcome, note, seconds = value
                    finding = Finding(Check(check, title, _nothing), outcome, note, seconds)
                    cards.setdefault(suite, []).append(finding)
            found = _STEP.search(str(getattr(report, "longrepr", "") or ""))
            step = found[1] if found and not step else step
    for suite, findings in cards.items():
        terminalreporter.write_sep("=", suite)
        Card(f"{len(findings)} checks", terminalreporter).write(findings)
    if step:
        terminalreporter.write_sep("=", "what to do next")
        terminalreporter.write_line(step)


def _nothing(subject: Any) -> None:
    """Stand for a check that was run already."""
