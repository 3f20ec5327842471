"""A recording may end with a report that is anything: the page is made, and holds no number that JSON has none for."""

from __future__ import annotations

import contextlib
import copy
import json
import random

import pytest
from campaign import seeds
from shipped import SCENES

import itouch
from itouch_tools.report import collect as collecting
from itouch_tools.report.session_page import page

JUNK = [None, True, -1, 10**400, float("nan"), float("inf"), "x", "</script>", [], [1, [2]], {}, {"a": {"b": []}}, 0.5]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("forged")
    session = itouch.build(SCENES / "faults.xml")
    session.record(folder / "run.mcap")
    with contextlib.suppress(itouch.DeviceFaultError):
        session.run(8.5)
    session.close()
    return collecting.collect(folder / "run.mcap"), json.dumps(session.report())


def spoil(value, dice: random.Random, odds: float):
    """Return the same with parts of it replaced or left out."""
    if dice.random() < odds:
        return dice.choice(JUNK)
    if isinstance(value, dict):
        return {key: spoil(inner, dice, odds) for key, inner in value.items() if dice.random() > odds / 2}
    return [spoil(inner, dice, odds) for inner in value] if isinstance(value, list) else value


@pytest.mark.parametrize("odds", [0.02, 0.1, 0.4])
@pytest.mark.parametrize("seed", seeds(5, 40))
def test_the_page_of_a_forged_report_is_made(found, seed, odds):
    findings, report = found
    dice = random.Random(seed)
    shown = copy.copy(findings)
    shown.report = collecting._report(spoil(json.loads(report), dice, odds), json.loads(report))
    shown.faults = shown.report["faults"]
    shown.marks = [{"time": dice.choice(JUNK), "name": dice.choice(JUNK), "payload": dice.choice(JUNK)}]
    shown.timing = {**shown.report["servo"], "histograms_us": dice.choice(JUNK)}
    shown.summary = collecting._summary(shown.report, shown.faults, 1.0)
    text = page(shown)
    assert json.loads(text.split('type="application/json">')[1].split("</script>")[0])["charts"]
