"""Many sessions of one model: each equals the one that runs alone, bit for bit, and none disturbs another."""

from __future__ import annotations

import gc
import math
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from typing import Any, NoReturn

import pytest
from shipped import SCENES

import itouch
from itouch.plugin.discovery import Catalog
from itouch.safety import Trip
from itouch.session import Session, SessionError, load_scene
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


@pytest.fixture
def patience() -> Iterator[None]:
    """Fail what waits for ever."""

    def give_up(*_: object) -> NoReturn:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(30)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


class Odd(Exception):  # noqa: N818
    """An error that can't be read back from its bytes."""

    def __init__(self, where: str, number: int) -> None:
        super().__init__(f"{where} {number}")


class Unreadable:
    """A result that can't be read back from its bytes."""

    def __reduce__(self) -> tuple[Any, ...]:
        return int, ("no number",)


def _two(then: Callable[[], Any]) -> Callable[[Session], Any]:
    """Return what does something in the session with seed 2 only."""
    return lambda session: then() if session.state["seed"] == 2 else None


def _raise(error: BaseException) -> Callable[[], NoReturn]:
    def raise_it() -> NoReturn:
        raise error

    return raise_it


FAULT = itouch.DeviceFaultError("arm", 7, Trip.DEVICE_ERROR, "was stopped")


@pytest.mark.usefixtures("patience")
@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize(
    ("error", "raised", "words"),
    [
        (Odd("here", 3), (Odd, RuntimeError), "here 3"),
        (FAULT, itouch.DeviceFaultError, "device 'arm' was stopped at tick 7"),
        (SystemExit(3), SystemExit, "3"),
        (KeyboardInterrupt("now"), KeyboardInterrupt, "now"),
    ],
)
def test_whatever_is_raised_arrives(error: BaseException, raised: Any, words: str, workers: int) -> None:
    with pytest.raises(raised, match=words) as caught:
        itouch.batch(FIRST, seeds=[1, 2, 3], until=0.01, collect=_two(_raise(error)), workers=workers)
    if workers > 1:
        assert "the process that ran seed 2" in caught.value.__notes__[0]


@pytest.mark.usefixtures("patience")
def test_a_process_that_is_killed_is_told_and_not_waited_for() -> None:
    with pytest.raises(SessionError, match="seed 2 was ended by signal 9 .* `workers`"):
        itouch.batch(
            FIRST, seeds=[1, 2, 3], until=0.01, workers=2, collect=_two(lambda: os.kill(os.getpid(), signal.SIGKILL))
        )


@pytest.mark.usefixtures("patience")
@pytest.mark.parametrize("result", [lambda: None, Unreadable()])
def test_a_result_that_cannot_be_handed_over_is_named(result: object) -> None:
    with pytest.raises(TypeError, match="returns for seed 2 can't be handed .* return plain data"):
        itouch.batch(FIRST, seeds=[1, 2, 3], until=0.01, workers=2, collect=_two(lambda: result))


@pytest.mark.usefixtures("patience")
def test_an_error_ends_sessions_that_would_never_end() -> None:
    def ask(session: Session) -> bool:
        if session.state["seed"] == 2:
            raise ValueError("no such question")
        return False

    with pytest.raises(ValueError, match="no such question"):
        itouch.batch(FIRST, seeds=[1, 2, 3], until=ask, workers=2)


@pytest.mark.parametrize("seed", [-1, 1 << 63, 1.5, "1", True])
def test_what_is_no_seed_is_refused(seed: Any) -> None:
    with pytest.raises(ValueError, match=r"seed .* 0 to 2\^63 - 1"):
        itouch.batch(FIRST, seeds=[1, seed], until=0.01)
    with pytest.raises(ValueError, match=r"seed .* 0 to 2\^63 - 1"):
        itouch.build(FIRST, seed=seed)


@pytest.mark.parametrize(
    ("given", "kind", "says"),
    [
        ({"collect": None}, TypeError, "collect = None must be a function"),
        ({"collect": "report"}, TypeError, "collect = 'report' must be a function"),
        ({"until": True}, TypeError, "until = True must be a number of seconds"),
        ({"until": "0.01"}, TypeError, "until = '0.01' must be a number of seconds"),
        ({"until": -1}, ValueError, "until = -1 must be a finite number, at least 0 s"),
        ({"until": math.nan, "seeds": []}, ValueError, "until = nan must be a finite number"),
        ({"until": math.inf}, ValueError, "until = inf must be a finite number"),
        ({"seeds": 5}, TypeError, r"seeds = 5 must be several whole numbers, as \[1, 2, 3\] or range\(5\)"),
        ({"seeds": "12"}, TypeError, "seeds = '12' must be several"),
        ({"seeds": None}, TypeError, "seeds = None must be several"),
        ({"workers": 0}, ValueError, "workers = 0 must be a whole number, at least 1"),
        ({"workers": -2}, ValueError, "workers = -2 must be"), ({"workers": 1.5}, TypeError, "workers = 1.5 must be"),
    ],
)  # fmt: skip
def test_what_no_session_can_be_run_with_is_refused_before_one_runs(
    given: dict[str, Any], kind: type[Exception], says: str
) -> None:
    with pytest.raises(kind, match=says):
        itouch.batch(SCENES / "absent.xml", **{"seeds": [1, 2], "until": 0.01, **given})


def test_a_fault_goes_whole_from_one_process_to_another() -> None:
    fault = pickle.loads(pickle.dumps(FAULT))
    assert str(fault) == str(FAULT)
    assert vars(fault) == vars(FAULT)


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
