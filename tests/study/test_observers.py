"""Simulated observers against what is published of people."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from scipy.special import erfcx

from itouch_tools.study.observers import (
    CombinedObserver,
    Felt,
    FluxObserver,
    NaiveObserver,
    Observer,
    Person,
    ReceptorObserver,
    noise_of,
)

SKIN, PERIOD = 1167.0, 0.01
MATERIALS = {"aluminium": 22249.0, "pyrex": 1613.0, "wood": 352.0, "polystyrene": 42.0}
SURE = Person(lapse=0.0)


def felt(effusivity: float, *, gap: float = 10.0, resistance: float = 2e-3, seconds: float = 3.0) -> Felt:
    """Touch a half-space: closed forms for two half-spaces with a contact resistance (Carslaw and Jaeger)."""
    t = np.arange(1, round(seconds / PERIOD) + 1) * PERIOD
    h = (1 / resistance) * (1 / SKIN + 1 / effusivity)
    share = effusivity / (effusivity + SKIN)

    def drop(depth: float) -> np.ndarray:
        z = depth / (2 * np.sqrt(1.005e-7 * t))
        erfc = np.vectorize(math.erfc)(z)
        return gap * share * (erfc - np.exp(-z * z) * erfcx(z + h * np.sqrt(t)))

    skin, deep = 306.15 - drop(0.0), 306.15 - drop(0.2e-3)
    skin[0] = deep[0] = 306.15  # at the begin
    return Felt(gap / resistance * erfcx(h * np.sqrt(t)), skin, deep, PERIOD)


def rate(count: int, right: object) -> float:
    return sum(bool(right(np.random.default_rng(n))) for n in range(count)) / count  # type: ignore[operator]


def test_43_percent_more_flux_is_told_in_three_of_four_at_any_base() -> None:
    assert noise_of() == pytest.approx(0.3750, abs=5e-5)
    assert noise_of(criterion=0.84) == pytest.approx(0.2543, abs=5e-5)
    observer = FluxObserver(SURE)
    for base in (300.0, 1000.0, 5000.0):
        a, b = (Felt(np.full(100, flux), np.zeros(0), np.zeros(0), PERIOD) for flux in (base, 1.43 * base))
        assert rate(1500, lambda rng, a=a, b=b: observer.colder([a, b], rng) == 1) == pytest.approx(0.75, abs=0.04)


@pytest.mark.parametrize("kind", [FluxObserver, CombinedObserver, ReceptorObserver, NaiveObserver])
def test_the_order_of_materials(kind: type[Observer]) -> None:
    cues = [float(kind(SURE).cue(felt(beta)).sum()) for beta in MATERIALS.values()]
    assert cues == sorted(cues, reverse=True)


@pytest.mark.parametrize("kind", [FluxObserver, CombinedObserver, ReceptorObserver])
def test_two_metals_cannot_be_told_apart(kind: type[Observer]) -> None:
    pair = [felt(36700.0), felt(22249.0)]
    assert rate(2000, lambda rng: kind(SURE).colder(pair, rng) == 0) < 0.58


def test_the_confusions_that_the_flux_model_predicts() -> None:
    observer, known = FluxObserver(SURE), {name: felt(beta) for name, beta in MATERIALS.items()}
    table = {
        shown: Counter(observer.identify(known[shown], known, np.random.default_rng(n)) for n in range(700))
        for shown in MATERIALS
    }
    diagonal = [table[name][name] / 700 for name in MATERIALS]
    assert diagonal == pytest.approx([0.584, 0.315, 0.712, 0.980], abs=0.07)
    assert table["aluminium"]["pyrex"] / 700 == pytest.approx(0.267, abs=0.07)
    assert table["polystyrene"]["aluminium"] == 0


@pytest.mark.parametrize("kind", [FluxObserver, CombinedObserver])
def test_cooled_wood_is_taken_for_metal(kind: type[Observer]) -> None:
    # 32 people answered "metal" to metal in 95 % and to wood of the same contact temperature in 94 % of trials
    metal, warm_wood = felt(22249.0, resistance=1e-4), felt(352.0, resistance=1e-4)
    wanted = metal.mean_flux()
    cold_wood = felt(352.0, gap=10.0 * wanted / warm_wood.mean_flux(), resistance=1e-4)
    known = {"metal": metal, "wood": warm_wood}
    for shown in (metal, cold_wood):
        assert rate(400, lambda rng, shown=shown: kind(SURE).identify(shown, known, rng) == "metal") > 0.9


def test_nothing_felt_is_guessed() -> None:
    nothing = Felt(np.zeros(100), np.full(100, 306.0), np.full(100, 306.0), PERIOD)
    assert rate(2000, lambda rng: FluxObserver(SURE).colder([nothing, nothing], rng) == 0) == pytest.approx(
        0.5, abs=0.04
    )


def test_cold_weighs_more_than_warmth_at_the_receptors() -> None:
    cold, warm = (float(ReceptorObserver(SURE).cue(felt(22249.0, gap=gap))[0]) for gap in (4.0, -4.0))
    assert cold > 0.0 > warm
    assert cold > -warm


def test_same_and_odd() -> None:
    observer = FluxObserver(SURE)
    wood, metal = felt(352.0), felt(22249.0)
    foam = felt(42.0)
    assert rate(500, lambda rng: observer.same([wood, wood], rng)) > 0.6
    assert rate(500, lambda rng: observer.same([foam, metal], rng)) < 0.05
    assert rate(500, lambda rng: observer.odd([foam, metal, foam], rng) == 1) > 0.9
    with pytest.raises(ValueError, match="three intervals"):
        observer.odd([wood, metal], np.random.default_rng(0))


def test_people_differ_and_are_drawn_again_the_same() -> None:
    panel = [Person.drawn(np.random.default_rng(n), biased=True, answers=["a", "b"]) for n in range(300)]
    assert panel[3] == Person.drawn(np.random.default_rng(3), biased=True, answers=["a", "b"])
    fingers = np.array([person.finger_temperature - 273.15 for person in panel])
    assert (fingers.mean(), fingers.std()) == (pytest.approx(28.5, abs=0.5), pytest.approx(2.8, abs=0.4))
    assert len({person.noise for person in panel}) == 300
