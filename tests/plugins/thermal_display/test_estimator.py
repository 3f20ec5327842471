"""The derivatives that the estimator learns by are those of the column that it steps."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest

from itouch.compiling import kernel
from itouch.plugin import Record
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.flux import observer as at
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.heat import FINGER

PERIOD, STEPS, APART = 1e-3, 300, 1e-4
NAMES = ("RESISTANCE", "SEEBECK", "LEGS", "OHMIC", "PLATE", "TISSUE", "LAG", "OFFSET", "FLUX", "PRESS", "DELAY")


def wired() -> ModelLaw:
    """Return the law of a display behind a wire."""
    return ModelLaw(
        DisplayParams(), FINGER, 310.15, 306.15, 2e-3, 296.15, PERIOD, band=(288.15, 313.15), ceiling=6.4, longest=60
    )


def touched(law: ModelLaw, came: int, until: int) -> Record:
    """Return State after some steps, in one of which a finger has come."""
    state = Record.of(law.fields())
    law.reset(state)
    law.feel(state, 1.0)
    for k in range(until):
        if k == came:
            law.begin(state, 0.0)
        law.track(state, 0.3, math.nan, math.nan, math.nan)
    return state


@pytest.mark.parametrize("until", [30, 60, 300])
def test_a_derivative_is_what_the_column_does_when_the_finger_comes_at_another_time(until: int) -> None:
    law, apart = wired(), 1
    early, late = (touched(law, 20 + by, until)["x"][0] for by in (-apart, apart))
    expected = (late - early) / (2 * apart * PERIOD)
    found = touched(law, 20, until)["x"][1 + at.ONSET]
    column = law.fine.tissue.shape[1] + law.fine.plate.shape[1]
    for which in (at.X_FLUX, at.X_SEEN, at.X_FILM):  # one is of the period to come, the other of both beside it
        assert found[column + which] == pytest.approx(expected[column + which], rel=0.04)


@pytest.mark.parametrize("late", [-6, -3, 0, 3, 6])
@pytest.mark.parametrize("first", [4, 11, 19])
def test_a_reading_soon_after_the_touch_says_when_the_finger_came(first: int, late: int) -> None:
    """Taken for a better or a worse contact it would cost 10 to 20 % of the flux for seconds."""
    law, came = wired(), 20
    plant, own, errors = touched(law, came, 0), touched(law, came, 0), []
    for k in range(500):
        if k == came:
            law.begin(plant, 0.0)
        if k == came + late:
            law.begin(own, 0.0)
        for state in (plant, own):
            law.track(state, 0.3, math.nan, math.nan, math.nan)
        if k > came + max(0, late) and k % 24 == (came + first) % 24:
            x, column = plant["x"], law.fine.tissue.shape[1] + law.fine.plate.shape[1]
            law.recall(own, x[0, column + at.X_SEEN].item(), 3, x[0, column + at.X_FILM].item(), 3, math.nan, 0.024)
        if k > came + 100:
            errors.append(law.estimate(own)[0] / law.estimate(plant)[0] - 1.0)
    assert np.sqrt(np.mean(np.square(errors))) < 0.02


@kernel
def _steps(constants: Any, tissue: Any, plate: Any, x: Any, theta: Any, memory: Any) -> None:
    for k in range(STEPS):
        current, scale = 2.0 * math.sin(0.05 * k), 1.0 + 3.0 * math.exp(-k / 50)
        at.advance(constants, tissue, plate, x, theta, memory, current, scale)


@functools.cache
def prepared() -> tuple[ModelLaw, np.ndarray, Record]:
    """Return a law, its constants with a sink that keeps its temperature, and State before the first step."""
    law = ModelLaw(
        DisplayParams(), FINGER, 310.15, 306.15, 2e-3, 296.15, PERIOD, band=(288.15, 313.15), ceiling=6.4, longest=9
    )
    state = Record.of(law.fields())
    law.reset(state)
    constants = law.constants.copy()
    constants[at.O_SINK_CAPACITY] = 1e12  # its sensor says how warm the sink is: no derivative goes by way of it
    return law, constants, state


@functools.cache
def stepped(touching: bool, moved: int = -1, by: float = 0.0) -> np.ndarray:
    """Return column and derivatives after some steps under changing currents and a press, one parameter moved."""
    law, constants, state = prepared()
    x, theta, memory = (np.array(state[name]) for name in ("x", "theta", "memory"))
    theta[:] = 0.01
    theta[at.DELAY] = 1e-3
    if moved >= 0:
        theta[moved] += by
    memory[at.M_TOUCHING], memory[at.M_PART] = float(touching), 0.7
    _steps(constants, law.fine.tissue, law.fine.plate, x, theta, memory)
    x.flags.writeable = False
    return x


@pytest.mark.parametrize("touching", [True, False])
@pytest.mark.parametrize("name", NAMES)
def test_a_derivative_is_what_the_column_does_when_its_parameter_is_another(name: str, touching: bool) -> None:
    which = int(getattr(at, name))
    apart = APART * (1e-2 if name == "DELAY" else 1e3 if name == "FLUX" else 1.0)
    expected = (stepped(touching, which, apart)[0] - stepped(touching, which, -apart)[0]) / (2.0 * apart)
    found = stepped(touching)[1 + which]
    assert np.abs(found - expected).max() <= 2e-5 * np.abs(expected).max() + 1e-9
    felt = name not in ("RESISTANCE", "TISSUE", "PRESS") if not touching else True
    assert bool(np.abs(found).max() > 0.0) == (felt and name != "OFFSET")


@pytest.mark.parametrize("seed", range(12))
def test_a_parameter_that_would_pass_its_authority_goes_to_its_end_and_the_others_to_where_they_then_are(
    seed: int,
) -> None:
    """As the least squares under that constraint have it; the one at its end is no more certain than before."""
    rng = np.random.default_rng(seed)
    count, reach = at.COUNT, np.array(at.AUTHORITY[: at.COUNT])
    root = rng.normal(size=(count, count)) * 0.05 * reach[:, None]
    cover, theta = root @ root.T + np.diag((0.02 * reach) ** 2), np.zeros(count)
    slopes, noise = rng.normal(size=count) / reach, 0.1
    slopes *= math.copysign(1.0, cover[at.TISSUE] @ slopes)
    gain = cover @ slopes
    innovation = 2.0 * math.sqrt(slopes @ gain + noise**2)
    theta[at.TISSUE] = reach[at.TISSUE] - 0.5 * gain[at.TISSUE] * innovation / (slopes @ gain + noise**2)
    within = reach[at.TISSUE] - theta[at.TISSUE]  # half of the way that the reading alone would lead it

    # the same by solving for what minimises prior and misfit with TISSUE at its end
    others = [k for k in range(count) if k != at.TISSUE]
    known = np.linalg.inv(cover)
    curved = known + np.outer(slopes, slopes) / noise**2
    right = slopes * innovation / noise**2 - curved[:, at.TISSUE] * within
    expected = np.zeros(count)
    expected[others] = np.linalg.solve(curved[np.ix_(others, others)], right[others])
    expected[at.TISSUE] = within

    x, before, found = rng.normal(size=(1 + count, 3)), cover.copy(), theta.copy()
    column = x[0] + expected @ x[1:]
    at.correct(x, found, cover, np.zeros(count), slopes, -1, innovation, noise)
    np.testing.assert_allclose((found - theta) / reach, expected / reach, atol=1e-9)
    np.testing.assert_allclose(x[0], column, rtol=1e-9)
    assert cover[at.TISSUE, at.TISSUE] == before[at.TISSUE, at.TISSUE]
    assert np.linalg.eigvalsh(cover / np.outer(reach, reach)).min() > 0.0
    assert all(cover[k, k] < before[k, k] for k in others)


def test_a_contact_rendered_in_one_call_is_the_one_rendered_call_by_call() -> None:
    law, steps = ModelLaw(
        DisplayParams(slew=100.0), FINGER, 310.15, 306.15, 2e-3, 296.15, PERIOD, band=(288.15, 313.15), ceiling=6.4
    ).coarser(), 40  # fmt: skip
    flux = 3000.0 / np.sqrt(1.0 + 0.1 * np.arange(steps + law.ahead + 1))
    press = 1.0 + 0.5 * np.exp(-0.2 * np.arange(steps + law.ahead + 1))
    states = [Record.of(law.fields()) for _ in range(4)]
    for state in states:
        law.reset(state)
        law.begin(state, 0.0, float(press[0]))
    for plant in states[1::2]:
        plant["theta"][at.SEEBECK] = -0.1
    own, plant = states[:2]
    column = law.fine.tissue.shape[1] + law.fine.plate.shape[1]
    found, fingers = law.rendered(own, plant, flux, press, steps)
    again, other = states[2:]
    for i in range(steps):
        again["wanted"][:] = flux[i + law.offsets]
        current = law.follow(again, float(press[i]))[0]
        law.track(other, current, math.nan, math.nan, math.nan, float(press[i]))
        read, film = other["x"][0, column + at.X_SEEN], other["x"][0, column + at.X_FILM]
        law.track(again, current, read, film, math.nan, float(press[i]))
        assert found[i] == other["x"][0, column + at.X_FLUX]
        assert np.array_equal(fingers[i], other["x"][0, : fingers.shape[1]])
    assert own.tobytes() == again.tobytes()
    assert found[-1] != found[0]


@pytest.mark.parametrize("longest", [0, 60])
def test_behind_a_wire_the_unexplained_flux_is_as_uncertain_again_when_a_finger_comes(longest: int) -> None:
    """What a delay that differs had looked like on the bare plate led polystyrene 10 % off."""
    law = ModelLaw(
        DisplayParams(), FINGER, 310.15, 306.15, 2e-3, 296.15, PERIOD, band=(288.15, 313.15), ceiling=6.4,
        longest=longest,
    )  # fmt: skip
    state = Record.of(law.fields())
    law.reset(state)
    state["cover"][at.FLUX, at.FLUX] = 4.0
    law.begin(state, 0.0)
    assert state["cover"][at.FLUX, at.FLUX] == 4.0 + (law.prior[at.FLUX] ** 2 if longest else 0.0)
