"""Many sessions of one model: each equals the one that runs alone, bit for bit, and none disturbs another."""

from __future__ import annotations

import gc

import pytest
from shipped import SCENES

import itouch
from itouch.plugin.discovery import Catalog
from itouch.safety import Trip
from itouch.session import Session, load_scene
from itouch.world import Model

FIRST = SCENES / "first_touch.xml"


@pytest.fixture(scope="module")
def model() -> Model:
    """Return the model of a scene with faults, noise and events."""
    catalog = Catalog()
    return Model.of(load_scene(SCENES / "two_fingers.xml", catalog=catalog), catalog)


def _state(session: Session) -> tuple[int, bytes, str]:
    return int(session.state["seed"]), session.state.tobytes(), str(session.report()["contacts"])


def test_each_session_is_what_it_is_alone(model: Model) -> None:
    seeds = [5, 1, 9, 2]
    alone = []
    for seed in seeds:
        session = Session(model, seed=seed)
        session.run(0.8)
        alone.append(_state(session))
        session.close()
    assert itouch.batch(model, seeds=seeds, until=0.8, collect=_state, workers=2) == alone
    assert itouch.batch(model, seeds=seeds, until=0.8, collect=_state, workers=1) == alone
    assert len({state for _, state, _ in alone}) == len(seeds)  # the seeds do tell them apart


def test_sessions_in_one_process_taken_in_turns_do_not_disturb_each_other(model: Model) -> None:
    together = [Session(model, seed=seed) for seed in (1, 2)]
    for _ in range(300):
        for session in together:
            session.run(session.model.period)
    for session, seed in zip(together, (1, 2), strict=True):
        alone = Session(model, seed=seed)
        alone.run(0.3)
        assert alone.state.tobytes() == session.state.tobytes()


def test_until_may_be_a_question_and_the_report_is_collected_by_default() -> None:
    found = itouch.batch(FIRST, seeds=range(2), until=lambda session: session.ticks >= 40)
    assert [report["simulated_s"] for report in found] == [0.04, 0.04]
    assert [report["seed"] for report in found] == [0, 1]


def test_a_session_that_trips_is_collected_and_the_others_go_on() -> None:
    def stop(session: Session) -> bool:
        if session.state["seed"] == 1 and session.ticks == 10:
            session.make_safe(itouch.DeviceFaultError("arm", session.ticks, Trip.DEVICE_ERROR, "was stopped"))
        return session.fault is not None or session.ticks >= 60

    found = itouch.batch(FIRST, seeds=[0, 1, 2], until=stop, collect=lambda session: session.fault is not None)
    assert found == [False, True, False]


def test_what_a_worker_raises_arrives() -> None:
    def refuse(session: Session) -> None:
        raise KeyError(int(session.state["seed"]))

    with pytest.raises(KeyError):
        itouch.batch(FIRST, seeds=[3, 4], until=0.01, collect=refuse)


def test_hardware_is_refused() -> None:
    catalog = Catalog()
    scene = load_scene(FIRST, twin="none", catalog=catalog)
    with pytest.raises(ValueError, match="runs on twins; 'arm' is real"):
        itouch.batch(Model.of(scene, catalog), seeds=[1], until=0.1)


def test_a_run_leaves_the_garbage_collector_alone() -> None:
    seen = []
    session = itouch.build(FIRST)
    session.run(0.003, each=lambda: seen.append(gc.isenabled()))
    session.close()
    assert seen == [True] * 3
