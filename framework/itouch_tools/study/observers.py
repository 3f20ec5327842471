"""Simulated observers: what a person would answer who felt only what the twin's finger felt.

An observer draws a noisy cue from what was felt in each interval, and decides by its criteria.  Models and sources are
in ``docs/explanation/observers.md``.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

#: Weber fraction of the rate of heat extraction (Bergmann Tiest and Kappers 2009, AP&P 71:481): 43 %; the abstract
#: does not say at which proportion right, so the criterion is a parameter here.
WEBER = 0.43
#: Mean flux [W/m2] below which a flux is not distinguished from none.
FLOOR = 20.0
#: Depth [m] of the modelled thermoreceptors, and their static [imp/s/K] and dynamic [imp/K] response to cooling.
DEPTH, STATIC, DYNAMIC = 0.2e-3, 0.72, 50.0


@dataclass(frozen=True, slots=True)
class Felt:
    """What a finger felt in one interval, sampled at a fixed rate from the beginning of the contact.

    ``flux`` [W/m2] out of the finger, ``skin`` [K] at the surface and ``deep`` [K] at the receptors' depth, all of
    shape (samples,), ``period`` [s].
    """

    flux: NDArray[np.float64]
    skin: NDArray[np.float64]
    deep: NDArray[np.float64]
    period: float

    def mean_flux(self, seconds: float = 1.0) -> float:
        """Return the mean flux [W/m2] of the first ``seconds``; 0 if nothing was touched."""
        count = max(1, round(seconds / self.period))
        return float(self.flux[:count].mean()) if len(self.flux) else 0.0


def noise_of(weber: float = WEBER, criterion: float = 0.75) -> float:
    """Return the noise of the log cue with which an increase by ``weber`` is noticed in ``criterion`` of 2AFC trials.

    The noise is a standard deviation sigma: d' = ln(1 + weber) / sigma, and the proportion right is Phi(d' / sqrt 2);
    43 % at 75 % right give 0.375.
    """
    from itouch_tools.study.statistics import d_prime_of_alternatives

    return math.log1p(weber) / d_prime_of_alternatives(criterion, 2)


@dataclass(frozen=True, slots=True)
class Person:
    """What differs between people: noise of the log cue and of its memory, lapse rate, biases, finger temperature [K].

    ``bias`` holds the log of each answer's weight.
    """

    noise: float = 0.375
    memory: float = 0.0
    lapse: float = 0.02
    bias: Mapping[str, float] = field(default_factory=dict)
    finger_temperature: float = 301.65

    @classmethod
    def drawn(cls, rng: np.random.Generator, *, biased: bool = False, answers: Sequence[str] = ()) -> Person:
        """Draw a person: finger 28.5 +- 2.8 degC (Bhattacharjee et al. 2021, 32 people)."""
        person = cls(
            noise=0.375 * math.exp(0.22 * rng.standard_normal()),
            lapse=float(rng.beta(2.0, 98.0)),
            finger_temperature=273.15 + float(np.clip(28.5 + 2.8 * rng.standard_normal(), 19.5, 33.5)),
        )
        weights = {answer: float(0.35 * rng.standard_normal()) for answer in answers} if biased else {}
        return replace(person, bias=weights, lapse=0.06 if biased else person.lapse)


class Observer(ABC):
    """A model of a person's judgement.  It keeps nothing that changes: its random numbers come from ``rng``."""

    def __init__(self, person: Person) -> None:
        self.person = person

    @abstractmethod
    def cue(self, felt: Felt) -> NDArray[np.float64]:
        """Return the cue without noise, in units in which the noise is ``person.noise``, shape (cues,)."""

    def perceived(self, felt: Felt, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return the noisy cue of one interval, shape (cues,)."""
        exact = self.cue(felt)
        return exact + self.person.noise * rng.standard_normal(len(exact))

    def coldness(self, felt: Felt, rng: np.random.Generator) -> float:
        """Return how cold an interval seems: larger is colder."""
        return float(self.perceived(felt, rng).mean() * math.sqrt(len(self.cue(felt))))

    def identify(self, felt: Felt, prototypes: Mapping[str, Felt], rng: np.random.Generator) -> str:
        """Return the name of the known thing that was touched: the one with the nearest cue, weighted by the biases."""
        names = sorted(prototypes)
        if rng.random() < self.person.lapse:
            return names[int(rng.integers(len(names)))]
        seen = self.perceived(felt, rng)
        spread = math.hypot(self.person.noise, self.person.memory)
        scores = []
        for name in names:
            known = self.cue(prototypes[name]) + self.person.memory * rng.standard_normal(len(seen))
            likelihood = -0.5 * float((((seen - known) / spread) ** 2).sum())
            scores.append(likelihood + self.person.bias.get(name, 0.0))
        return names[int(np.argmax(scores))]

    def colder(self, intervals: Sequence[Felt], rng: np.random.Generator) -> int:
        """Return the index of the interval that felt coldest."""
        if rng.random() < self.person.lapse:
            return int(rng.integers(len(intervals)))
        return int(np.argmax([self.coldness(felt, rng) for felt in intervals]))

    def odd(self, intervals: Sequence[Felt], rng: np.random.Generator) -> int:
        """Return the index of the odd one of three intervals: the one that is not in the closest pair."""
        if len(intervals) != 3:
            raise ValueError(f"the odd one is sought among three intervals, not {len(intervals)}")
        if rng.random() < self.person.lapse:
            return int(rng.integers(3))
        cues = [self.perceived(felt, rng) for felt in intervals]
        distances = {left: float(((cues[(left + 1) % 3] - cues[(left + 2) % 3]) ** 2).sum()) for left in range(3)}
        return min(distances, key=lambda left: distances[left])

    def same(self, intervals: Sequence[Felt], rng: np.random.Generator) -> bool:
        """Tell whether two intervals seem the same: whether their cues differ by less than noise * sqrt(2 cues)."""
        if len(intervals) != 2:
            raise ValueError(f"same or different is asked of two intervals, not {len(intervals)}")
        if rng.random() < self.person.lapse:
            return bool(rng.integers(2))
        first, second = (self.perceived(felt, rng) for felt in intervals)
        return float(np.linalg.norm(first - second)) < math.sqrt(2.0 * len(first)) * self.person.noise


def _log_flux(felt: Felt) -> float:
    """Return the log of the first second's mean flux relative to the floor; it has the sign of the flux (warm: < 0)."""
    flux = felt.mean_flux()
    return math.copysign(math.log1p(abs(flux) / FLOOR), flux)


class FluxObserver(Observer):
    """Judges by the mean flux of the first second, with Weber noise.

    The *initial* flux would be no cue: with a contact resistance it is the same for all materials.
    """

    def cue(self, felt: Felt) -> NDArray[np.float64]:
        """Return the log of the mean flux."""
        return np.array([_log_flux(felt)])


class CombinedObserver(Observer):
    """Judges by the mean flux and by how far the skin has cooled by the end, each with its own noise."""

    #: Change of the skin's temperature [K] at which its log cue is ln 2.
    SCALE = 2.0

    def cue(self, felt: Felt) -> NDArray[np.float64]:
        """Return the log of the mean flux, and the log of the fall of the skin's temperature."""
        fall = float(felt.skin[0] - felt.skin[-1]) if len(felt.skin) else 0.0
        return np.array([_log_flux(felt), math.copysign(math.log1p(abs(fall) / self.SCALE), fall)])


class ReceptorObserver(Observer):
    """Judges by the impulses of cold receptors in the first second: a static and a dynamic response, with adaptation.

    A(t) = Ks (T0 - T) + Kd max(0, -dT/dt) with T at 0.2 mm; T0 follows T with the time constant ``ADAPTATION`` [s].
    Warming subtracts half as much as cooling adds: - Kd / 2 max(0, dT/dt).
    """

    ADAPTATION = 30.0
    #: Number of impulses in a second that is distinguished from none.
    REST = 4.0

    def cue(self, felt: Felt) -> NDArray[np.float64]:
        """Return the log of the number of impulses, negative if the skin warms."""
        if len(felt.deep) < 2:
            return np.zeros(1)
        count = max(2, round(1.0 / felt.period))
        deep = felt.deep[:count]
        adapted = np.empty_like(deep)
        level = float(deep[0])
        for index, value in enumerate(deep):
            level += (float(value) - level) * felt.period / self.ADAPTATION
            adapted[index] = level
        rate = -np.gradient(deep, felt.period)
        answer = STATIC * (adapted - deep) + DYNAMIC * np.maximum(rate, 0.0) - 0.5 * DYNAMIC * np.maximum(-rate, 0.0)
        impulses = float(answer.mean() * len(deep) * felt.period)
        return np.array([math.copysign(math.log1p(abs(impulses) / self.REST), impulses)])


class NaiveObserver(FluxObserver):
    """A flux observer for a person with biased criteria and many lapses: draw it with ``Person.drawn(biased=True)``."""
