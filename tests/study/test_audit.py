"""The audit of a study: it finds what tells the condition, and nothing where nothing does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from run_scene import write_study

from itouch.plugin.discovery import Catalog
from itouch_tools.cli import main
from itouch_tools.study.audit import GROUPS, guess, judged, observe
from itouch_tools.study.reading import load_study

CATALOG = Catalog()


def test_a_classifier_that_can_fail_and_can_succeed() -> None:
    rng = np.random.default_rng(1)
    labels = [f"m{index % 4}" for index in range(1000)]
    codes = np.arange(1000) % 4
    noise = rng.normal(size=(1000, 9))
    found = guess(labels, noise)
    assert found.chance == pytest.approx(0.25)
    assert found.blind
    assert not found.leaks
    linear, hidden = noise.copy(), noise.copy()
    linear[:, 3] += 0.7 * codes
    hidden[:, 5] = np.where(codes % 2, 3.0, 0.3) * hidden[:, 5]  # its spread alone tells, not its mean
    for leaking in (linear, hidden):
        told = guess(labels, leaking)
        assert told.leaks
        assert not told.blind
    assert guess(labels, np.zeros((1000, 9))).blind
    assert [one.features for one in judged(labels, noise)] == ["all", *GROUPS]


def test_trials_of_a_small_study_are_observed(tmp_path: Path) -> None:
    file = load_study(write_study(tmp_path, more='<blind approach="0.3 s"/>'), CATALOG)
    labels, table = observe(file, CATALOG, 7)
    assert len(labels) == len(table) == 7
    assert set(labels[:3]) == {"wood", "steel", "cork"}
    approach = table[:, 1]
    assert approach == pytest.approx(0.3, abs=0.003)  # the same for each
    assert np.ptp(approach) == 0.0
    again = observe(file, CATALOG, 7)
    assert again[0] == labels
    assert (again[1] == table).all()


def test_the_audit_is_a_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_study(tmp_path, more='<blind approach="0.1 s"/>')
    assert main(["study", "audit", str(path), "--trials", "21"]) in (0, 1)
    assert "of 21 guessed, chance 33.3 %" in capsys.readouterr().out
    assert main(["study", "audit", str(path), "--trials", "3"]) == 2
