"""Do the intervals and tests keep what they promise?  Synthetic studies with a known truth show it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from itouch_tools.study import statistics as stats

#: Trials of a participant in one condition, standard deviation between people, and the truth.
TRIALS, BETWEEN, TRUTH = 20, 0.12, 0.70
#: Smallest panel for which the promises are made; for smaller ones what is reached is only stated.
LARGE = 16


@dataclass(frozen=True, slots=True)
class Kept:
    """How often something happened: ``share`` of ``studies``, with Wilson's interval, and the ``promised`` range."""

    what: str
    participants: int
    studies: int
    share: float
    low: float
    high: float
    promised: tuple[float, float]

    @property
    def kept(self) -> bool:
        """Whether Wilson's interval overlaps the promised range."""
        return self.promised[0] <= self.high and self.low <= self.promised[1]


def panels(rng: np.random.Generator, people: int, mean: float, conditions: int = 1) -> np.ndarray:
    """Return the right answers, out of `TRIALS`, of a panel of people who differ, shape (people, conditions).

    People's own proportions are beta-distributed around ``mean`` with the standard deviation `BETWEEN`.
    """
    size = mean * (1.0 - mean) / BETWEEN**2 - 1.0
    own = rng.beta(mean * size, (1.0 - mean) * size, (people, 1))
    return rng.binomial(TRIALS, np.broadcast_to(own, (people, conditions)))


def coverage(studies: int, people: int, *, seed: int = 1, draws: int = 1000) -> Kept:
    """Return how often the 95 % interval over participants covers the truth."""
    rng = np.random.default_rng([seed, people])
    hits = 0
    for study in range(studies):
        shares = (panels(rng, people, TRUTH)[:, 0] / TRIALS).tolist()
        low, high = stats.participant_interval(shares, _mean, seed=study, draws=draws)
        hits += low <= TRUTH <= high
    return _found(
        "95 % interval of the proportion right covers the truth",
        people,
        studies,
        hits,
        (0.93, 0.97) if people >= LARGE else (0.0, 1.0),
    )


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def equivalence_errors(studies: int, people: int, *, seed: int = 2) -> Kept:
    """Return how often TOST calls two conditions equivalent that differ by exactly the margin."""
    rng = np.random.default_rng([seed, people])
    hits, margin = 0, 0.7 - (0.1 + 0.6 * 6.0 / 7.0)  # between the means of `own` and `other`
    for _ in range(studies):
        own = rng.beta(14.0, 6.0, people)
        other = 0.1 + (own - 0.1) * 6.0 / 7.0
        first, second = rng.binomial(TRIALS, own) / TRIALS, rng.binomial(TRIALS, other) / TRIALS
        hits += stats.clustered_tost(first, second, margin=margin).p < 0.05
    return _found(
        "TOST calls a difference of the margin equivalent",
        people,
        studies,
        hits,
        (0.04 if people >= LARGE else 0.0, 0.06),
    )


def difference_errors(studies: int, people: int, *, seed: int = 3) -> Kept:
    """Return how often Cochran's Q finds a difference between three equal conditions."""
    rng = np.random.default_rng([seed, people])
    hits = 0
    for _ in range(studies):
        own = rng.beta(7.0, 3.0, (people, 1))
        answers = (rng.random((people, 3)) < own).astype(int)
        hits += stats.cochran_q(answers).p < 0.05
    return _found("Cochran's Q finds a difference where there is none", people, studies, hits, (0.04, 0.06))


def regression_errors(studies: int, people: int, *, seed: int = 4) -> Kept:
    """Return how often the GEE logistic model finds an effect of a factor that has none."""
    rng = np.random.default_rng([seed, people])
    hits = 0
    codes = [f"P{person}" for person in range(people) for _ in range(2 * TRIALS)]
    source = ["real", "rendered"] * (people * TRIALS)
    for _ in range(studies):
        own = np.repeat(rng.beta(7.0, 3.0, people), 2 * TRIALS)
        right = (rng.random(len(own)) < own).astype(int)
        hits += stats.logistic_gee(right.tolist(), {"source": source}, codes)[1].p < 0.05
    least = 0.04 if people >= LARGE else 0.0
    return _found("the GEE model finds an effect where there is none", people, studies, hits, (least, 0.06))


def _found(what: str, people: int, studies: int, hits: int, promised: tuple[float, float]) -> Kept:
    low, high = stats.wilson(int(hits), studies)
    return Kept(what, people, studies, hits / studies, low, high, promised)


def campaign(studies: int = 500, null: int = 2000) -> Iterator[Kept]:
    """Yield each promise about intervals and tests, with what synthetic studies showed."""
    for people in (8, 12, 16, 24):
        yield coverage(studies, people)
    for people in (8, 16, 24):
        yield equivalence_errors(null, people)
    yield difference_errors(null, 40)
    for people in (8, 16, 24):
        yield regression_errors(null, people)
