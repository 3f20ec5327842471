"""Adaptive procedures against the library's own steps, and their return after a crash."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
import SweetSpot
from hypothesis import given, settings
from hypothesis import strategies as st

from itouch_tools.study.adaptive import MissingLibraryError, Procedure, Running, Staircase

RULES = {
    "up-down": Staircase("up-down", 0.0, 2.0, 1.5, step=0.1, reversals=12, trials=80),
    "quest": Staircase("quest", -3.0, 3.0, 0.0),
    "psi": Staircase("psi", -3.0, 3.0, 0.0, trials=15),
}


def test_up_down_steps_as_published() -> None:
    running = Running.begin(Staircase("up-down", -5.0, 5.0, 1.0, step=0.1, reversals=6, trials=400))
    shown = []
    for answer in "110111001101":
        shown.append(running.level())
        running.answer(answer == "1")
    assert shown == pytest.approx([1, 0.9, 0.8, 1.1, 1, 0.9, 0.8, 1.1, 1.4, 1.3, 1.2, 1.5])
    assert running.finished
    assert running.estimate() == pytest.approx(1.3)


def test_quest_steps_as_an_independent_posterior() -> None:
    running = Running.begin(RULES["quest"])
    shown = []
    for answer in "1011101111":
        shown.append(running.level())
        running.answer(answer == "1")
    wanted = [0.16118, -0.09413, 0.50384, 0.33484, 0.18990, 0.06383, 0.38551, 0.27937, 0.18897, 0.10991]
    assert shown == pytest.approx(wanted, abs=5e-6)
    assert running.level() == pytest.approx(0.03873, abs=5e-6)
    assert running.estimate() == pytest.approx(-0.05, abs=1e-9)


def test_psi_steps_as_the_library() -> None:
    function = SweetSpot.PsychometricFunction(shape=SweetSpot.Logistic(0.5), gamma=0.5)
    function.Grid(alpha=(-3, 3, 61), beta=(-2, 2, 11), lambda_=(0.0, 0.1, 3))
    function.SetPrior(alpha=(0.0, 1.0), beta=(0.0, 1.0))
    library = SweetSpot.PsiMarginal(function, xCandidates=np.linspace(-3, 3, 31), maxIterations=15)
    running = Running.begin(RULES["psi"])
    for answer in "110101101110111":
        assert running.level() == pytest.approx(library.PendingValue(), abs=1e-9)
        running.answer(answer == "1")
        library.Observe(int(answer))
    assert running.finished
    assert running.estimate() == pytest.approx(library.Estimate(), abs=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(["up-down", "quest"]), st.lists(st.booleans(), max_size=30), st.integers(0, 30))
def test_rows_bring_a_staircase_back(name: Procedure, answers: list[bool], cut: int) -> None:
    whole = Running.begin(RULES[name])
    for count, answer in enumerate(answers):
        if whole.finished:
            break
        if count == cut:
            whole = Running.begin(RULES[name], list(whole.rows))
        whole.answer(answer)
    again = Running.begin(RULES[name], whole.rows)
    assert again.finished == whole.finished
    assert whole.finished or again.level() == whole.level()
    assert again.estimate() == whole.estimate() or math.isnan(whole.estimate())


@pytest.mark.parametrize("name", ["up-down", "quest"])
def test_thresholds_are_found(name: Procedure) -> None:
    fine = Staircase("up-down", -2.0, 2.0, 0.6, step=0.03, reversals=24, trials=400)
    rule = fine if name == "up-down" else RULES[name]  # coarse steps overshoot: the library's mean is 0.2 too high
    found = []
    for seed in range(30):
        rng, running = np.random.default_rng(seed), Running.begin(rule)
        while not running.finished:
            p = 0.5 + 0.48 / (1.0 + math.exp(-3.0 * (running.level() - 0.4)))
            running.answer(bool(rng.random() < p))
        found.append(running.estimate())
    assert np.nanmean(found) == pytest.approx(0.43, abs=0.12)


def test_what_is_no_answer_is_refused() -> None:
    with pytest.raises(ValueError, match="0 or 1"):
        Running.begin(RULES["quest"], [(0.0, 2)])
    with pytest.raises(ValueError, match="0 or 1"):
        Running.begin(RULES["quest"], [(math.nan, 1)])
    running = Running.begin(Staircase("quest", -3.0, 3.0, 0.0, trials=1))
    running.answer(True)
    with pytest.raises(ValueError, match="has ended"):
        running.answer(True)
    with pytest.raises(ValueError, match="step of more than 0"):
        Staircase("up-down", 0.0, 1.0, 0.5)
    with pytest.raises(ValueError, match="among them"):
        Staircase("quest", 0.0, 1.0, 1.5)


@given(st.lists(st.booleans(), max_size=60))
@settings(max_examples=25, deadline=None)
def test_levels_stay_in_their_range(answers: list[bool]) -> None:
    running = Running.begin(RULES["up-down"])
    for answer in answers:
        if running.finished:
            break
        assert 0.0 <= running.level() <= 2.0
        running.answer(answer)


def test_without_the_library_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "SweetSpot", None)
    with pytest.raises(MissingLibraryError, match=r"pip install 'itouch-py\[study\]'"):
        Running.begin(RULES["quest"]).level()
