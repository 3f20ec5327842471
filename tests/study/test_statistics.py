"""Statistics of studies against published values, independent programs and simulated truth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch_tools.study import statistics as s

A = np.array([[14, 5, 1, 0], [5, 11, 4, 0], [1, 4, 13, 2], [0, 0, 2, 18]])
B = np.array([[16, 3, 1, 0], [8, 9, 3, 0], [2, 6, 11, 1], [0, 1, 3, 16]])
LEVELS, RIGHT, TRIALS = [0, 0.1, 0.2, 0.4, 0.8], [20, 23, 27, 33, 39], [40] * 5


@pytest.mark.parametrize(("alternatives", "wanted"), [(2, 0.9539), (3, 1.4338), (4, 1.6822), (5, 1.8463)])
def test_d_prime_of_75_percent_right(alternatives: int, wanted: float) -> None:
    assert s.d_prime_of_alternatives(0.75, alternatives) == pytest.approx(wanted, abs=5e-5)


@pytest.mark.parametrize(("alternatives", "wanted"), [(2, 0.7602), (3, 0.6337), (4, 0.5520), (5, 0.4937)])
def test_right_at_a_d_prime_of_one(alternatives: int, wanted: float) -> None:
    assert s.correct_of_alternatives(1.0, alternatives) == pytest.approx(wanted, abs=5e-5)


def test_the_odd_one_is_harder_than_the_coldest() -> None:
    found = [s.d_prime_of_oddity(p) for p in (0.50, 0.75, 0.80)]
    assert found == pytest.approx([1.4663, 2.7974, 3.1286], abs=5e-5)
    assert s.correct_of_oddity(1.22) == pytest.approx(0.455, abs=5e-4)
    assert s.correct_of_alternatives(1.22, 3) == pytest.approx(0.695, abs=5e-4)


@given(st.floats(0.0, 5.0), st.integers(2, 9))
def test_d_prime_comes_back(d: float, alternatives: int) -> None:
    assert s.d_prime_of_alternatives(s.correct_of_alternatives(d, alternatives), alternatives) == pytest.approx(
        d, abs=1e-6
    )


def test_the_ends_of_d_prime() -> None:
    assert s.d_prime_of_alternatives(1.0, 3) == math.inf
    assert s.d_prime_of_alternatives(0.0, 3) == -math.inf
    assert s.d_prime_of_oddity(0.2) == 0.0
    assert s.d_prime_of_rates(s.log_linear(20, 20), s.log_linear(0, 20)) == pytest.approx(3.96, abs=0.01)
    with pytest.raises(ValueError, match="between 0 and 1"):
        s.d_prime_of_alternatives(1.2, 3)


def test_information_transfer_and_its_bias() -> None:
    found = s.information_transfer(A)
    assert (found.plug_in, found.bias) == pytest.approx((0.899826, 0.045084), abs=5e-7)
    assert s.information_transfer(B).corrected == pytest.approx(0.732023, abs=5e-7)
    assert (s.proportion_correct(A), s.kappa(A), s.kappa(B)) == pytest.approx((0.70, 0.60, 0.53333), abs=5e-6)


def test_the_bias_correction_takes_most_of_the_bias_away() -> None:
    rng = np.random.default_rng(5)
    tables = [rng.multinomial(20, [0.25] * 4, size=4) for _ in range(400)]
    found = [s.information_transfer(t) for t in tables]
    assert np.mean([f.plug_in for f in found]) == pytest.approx(0.087, abs=0.008)
    assert abs(np.mean([f.corrected for f in found])) < 0.015


def test_luces_choice_model() -> None:
    found = s.choice_model(B)
    eta = found.similarity
    wanted = [0.4234, 0.0908, 0.4347, 0.0285, 0.1241, 0.0]
    pairs = [eta[0, 1], eta[0, 2], eta[1, 2], eta[1, 3], eta[2, 3], eta[0, 3]]
    assert pairs == pytest.approx(wanted, abs=5e-5)
    assert found.bias == pytest.approx([0.4582, 0.2295, 0.1912, 0.1211], abs=5e-5)
    assert (found.deviance, found.freedom) == (pytest.approx(0.69925, abs=5e-6), 3)


@pytest.mark.parametrize("table", [np.zeros((3, 3)), np.diag([5, 5, 5]), [[4, 0], [0, 0]], [[1]]])
def test_tables_with_holes_give_an_answer(table: object) -> None:
    counts = np.asarray(table)
    s.proportion_correct(counts), s.kappa(counts), s.information_transfer(counts), s.choice_model(counts)


def test_a_matrix_of_trials() -> None:
    assert s.confusion_matrix("abba", "aaba", "ab").tolist() == [[2, 0], [1, 1]]
    with pytest.raises(ValueError, match="'c' is none of a, b"):
        s.confusion_matrix("ab", "ac", "ab")


def test_equivalence_of_two_proportions() -> None:
    found = s.tost(70, 100, 66, 100, margin=0.1)
    assert (found.z[0], found.z[1], found.p) == pytest.approx((2.12414, -0.910346, 0.181320), abs=5e-6)
    assert (found.low, found.high) == pytest.approx((-0.06841, 0.14841), abs=5e-6)
    assert s.tost(350, 500, 345, 500, margin=0.1).p == pytest.approx(0.000997, abs=5e-7)
    assert s.tost(20, 20, 20, 20, margin=0.1).p < 1e-6  # no variance was seen
    assert s.tost(20, 20, 20, 20, margin=0.1, method="score").p == pytest.approx(0.07, abs=0.03)


def test_the_score_test_is_that_of_the_constrained_maximum() -> None:
    # p1 = .72750, p2 = .62750 maximise the likelihood under p1 - p2 = .1: found on a grid
    grid = np.linspace(0.7, 0.75, 50001)
    likelihood = 70 * np.log(grid) + 30 * np.log1p(-grid) + 66 * np.log(grid - 0.1) + 34 * np.log1p(0.1 - grid)
    p1 = grid[likelihood.argmax()]
    error = math.sqrt((p1 * (1 - p1) + (p1 - 0.1) * (1.1 - p1)) / 100 * 200 / 199)
    assert s.tost(70, 100, 66, 100, margin=0.1, method="score").z[1] == pytest.approx(-0.06 / error, rel=1e-6)


def test_answers_of_one_person_are_not_independent() -> None:
    rng = np.random.default_rng(2)
    wrong = clustered = 0
    for _ in range(200):  # true difference of exactly the margin: equivalence may be claimed in 5 % of studies
        talent = np.clip(rng.normal(0.7, 0.05, 20), 0, 1)
        shift = np.clip(talent + rng.normal(0.1, 0.15, 20), 0, 1)
        first, second = rng.binomial(40, shift), rng.binomial(40, talent)
        truth = float((shift - talent).mean())
        clustered += s.clustered_tost(first / 40, second / 40, margin=0.1).p < 0.05
        wrong += s.tost(int(first.sum()), 800, int(second.sum()), 800, margin=0.1).p < 0.05
        assert abs(truth) < 0.3
    assert clustered / 200 < 0.1
    assert wrong > clustered


def test_small_tests_against_known_values() -> None:
    answers = [[int(c) for c in row] for row in ["110", "100", "111", "110", "100", "010", "111", "100"]]
    found = s.cochran_q(answers)
    assert (found.statistic, found.freedom, found.p) == (
        pytest.approx(6.33333, abs=5e-6),
        2,
        pytest.approx(0.042144, abs=5e-7),
    )
    assert s.cochran_q([[1, 1], [1, 1]]).p == 1.0
    assert s.mcnemar(9, 3) == pytest.approx(0.145996, abs=5e-7)
    assert [s.binomial_tail(k, 40, 0.25) for k in (14, 15, 16)] == pytest.approx([0.10323, 0.05444, 0.02624], abs=5e-6)
    assert s.wilson(16, 20) == pytest.approx((0.58398, 0.91934), abs=5e-6)
    assert s.wilson(0, 0) == (0.0, 1.0)
    assert s.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_a_psychometric_function_against_an_independent_fit() -> None:
    found = s.fit_psychometric(LEVELS, RIGHT, TRIALS, guess=0.5, lapse=0.02)
    assert (found.threshold, found.spread) == pytest.approx((0.299236, 0.203122), abs=2e-6)
    assert (found.loss, found.deviance, found.level(0.75)) == pytest.approx((103.604463, 0.311638, 0.309849), abs=2e-6)
    low, high = s.profile_interval(LEVELS, RIGHT, TRIALS, found)
    assert low < found.threshold < high
    with pytest.raises(ValueError, match="never to 0.99"):
        found.level(0.99)


def test_intervals_of_a_threshold_cover_the_truth() -> None:
    rng = np.random.default_rng(11)
    truth = s.Psychometric(0.4, 0.2, 0.5, 0.02, "normal", 0, 0, False)
    levels, held = np.array([0.05, 0.2, 0.35, 0.5, 0.8]), 0
    for _ in range(50):
        right = rng.binomial(60, truth(levels))
        found = s.fit_psychometric(levels, right, [60] * 5, guess=0.5, lapse=0.02)
        low, high = s.profile_interval(levels, right, [60] * 5, found)
        held += low <= 0.4 <= high
    assert 0.86 < held / 50 <= 1.0  # the long campaign bounds it closer


@pytest.mark.parametrize("right", [[40] * 5, [20] * 5, [20, 20, 20, 40, 40]])
def test_data_without_a_slope_are_told(right: list[int]) -> None:
    found = s.fit_psychometric(LEVELS, right, TRIALS, guess=0.5, lapse=0.02)
    assert math.isfinite(found.threshold)
    assert math.isfinite(found.loss)


def test_overdispersed_answers() -> None:
    assert math.exp(s.beta_binomial_log_pmf(7, 10, 0.7, 1 / math.sqrt(11))) == pytest.approx(0.185759, abs=5e-7)
    assert s.beta_binomial_log_pmf(8, 10, 0.75, 0.2) == pytest.approx(-1.404928, abs=5e-7)
    assert math.exp(s.beta_binomial_log_pmf(7, 10, 0.7, 0.0)) == pytest.approx(0.266828, abs=5e-7)


def test_the_interval_over_participants_is_repeatable_and_covers() -> None:
    rng = np.random.default_rng(4)
    held = 0
    for trial in range(60):
        panel = list(rng.normal(0.7, 0.12, 16))
        low, high = s.participant_interval(panel, lambda p: float(np.mean(p)), seed=trial, draws=500)
        held += low <= 0.7 <= high
    assert held / 60 > 0.85
    again = [s.participant_interval(panel, lambda p: float(np.mean(p)), seed=1, draws=200) for _ in range(2)]
    assert again[0] == again[1]
    assert all(map(math.isnan, s.participant_interval([0.7], lambda p: p[0], seed=1)))
