"""Checks that a step joined into the tick gives the same bytes as it does alone, whatever State it begins with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from itouch.joining import Chain, can_join, is_newest
from itouch.loop import Engine
from itouch.plugin import Bound, Record
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.harness import PERIOD, DeviceSubject
from itouch.testing.scenario import ModalitySubject

_ADVICE = "let the Python method be a call of what is bound, or compute both in the same order"


def _runner(bounds: Sequence[Bound], alone: Callable[[], None]) -> Callable[[], None]:
    """Return a function that runs bound calls in a chain, and ``alone`` if they hand over to Python."""
    if not bounds:
        raise NotApplicableError("it is plain Python: it does not join")
    if not can_join():
        raise NotApplicableError("nothing can be joined here: compiling is switched off, or there is no clock for it")
    chain = Chain(bounds, [len(bounds)])

    def run() -> None:
        if chain.run() >= 0:
            alone()

    return run


@check("joined", "a compiled step does what step does")
def twin(subject: DeviceSubject) -> str:
    """Drive two twins alike, one by its step, one by the joined call; also from States that were perturbed."""
    one, other = subject.bench(), subject.bench()
    if not is_newest(type(other.twin), "bound_step", "step"):
        raise NotApplicableError("it is plain Python, or its step is newer than what would join")
    other.drive()  # a finger is attached
    alone = partial(other.twin.step, other.state, other.command, other.touch, PERIOD)
    bound = other.twin.bound_step(other.state, other.command, other.touch, PERIOD)
    run = _runner([bound] if bound is not None else [], alone)
    rng, ticks = np.random.default_rng(11), 1500
    for tick in range(ticks):
        one.tick = other.tick = tick
        one.drive()
        other.drive()
        if tick % 50 == 49:
            _shake(one.state, rng)
            other.state.raw[:] = one.state.raw
        one.twin.step(one.state, one.command, one.touch, PERIOD)
        run()
        _same(one.state, other.state, list(one.state), tick)
    return f"{ticks} ticks, shaken {ticks // 50} times"


@check("joined", "a compiled update does what update does")
def modality(subject: ModalitySubject) -> str:
    """Run the scene; do every update both ways from the same State."""
    engine = subject.engine()
    looked = 0
    for one in subject.own(engine):
        step = next(step for step in engine.plan.steps if step.name == one.name)
        if not step.bounds:
            raise NotApplicableError("it is plain Python, or not updated in every tick: it does not join")
        period = engine.model.period
        alone = partial(one.instance.update, one.model, engine.state, period)
        run = _runner(step.bounds, alone)
        for _ in range(round(subject.seconds / period)):
            engine.tick()
            _both(engine, alone, run)
            looked += 1
    return f"{looked} updates"


def _both(engine: Engine, alone: Callable[[], None], joined: Callable[[], None]) -> None:
    kept = engine.state.tobytes()
    alone()
    seen = engine.state.copy()
    engine.state.raw[:] = np.frombuffer(kept, np.uint8)
    joined()
    _same(seen, engine.state, list(seen), engine.ticks)
    engine.state.raw[:] = np.frombuffer(kept, np.uint8)


def _shake(state: Record, rng: np.random.Generator) -> None:
    """Change all numbers of a State at random by a few per cent."""
    for view in state.values():
        if view.dtype == np.float64:
            view *= rng.uniform(0.97, 1.03, view.shape)


def _same(alone: Record, joined: Record, names: list[str], tick: int) -> None:
    for name in names:
        if alone[name].tobytes() != joined[name].tobytes():
            raise CheckError(
                f"the field '{name}' is {joined[name]} joined and {alone[name]} in Python, at tick {tick}",
                cause="two implementations that differ, or arithmetic in another order",
                advice=_ADVICE,
            )
