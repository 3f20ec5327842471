"""The garbage collector runs rarely while a program starts or compiles, and as often as before afterwards."""

from __future__ import annotations

import gc
import threading
from collections.abc import Generator
from pathlib import Path

import pytest
from shipped import SCENES

import itouch
from itouch import gc_policy

USUAL = (600, 9, 8)


@pytest.fixture(autouse=True)
def usual() -> Generator[None]:
    before = gc.get_threshold()
    gc.set_threshold(*USUAL)
    yield
    gc.set_threshold(*before)


def test_the_last_that_ends_brings_back_what_was_before_the_first_that_began() -> None:
    with gc_policy.rare_collections():
        begun, end = threading.Event(), threading.Event()

        def other() -> None:
            with gc_policy.rare_collections():
                begun.set()
                end.wait(60)

        thread = threading.Thread(target=other)
        thread.start()
        assert begun.wait(60)
    assert gc.get_threshold() == gc_policy.MEANWHILE  # the other one is still at it
    end.set()
    thread.join()
    assert gc.get_threshold() == USUAL


def test_a_process_of_its_own_looks_as_often_as_one_pass_may_take_and_more_seldom_while_it_builds() -> None:
    gc_policy.keep_collections_rare()
    assert gc.get_threshold() == gc_policy.SELDOM
    with gc_policy.rare_collections():
        assert gc.get_threshold() == gc_policy.MEANWHILE > gc_policy.SELDOM
    assert gc.get_threshold() == gc_policy.SELDOM


def test_who_looks_more_seldom_or_not_at_all_goes_on_so() -> None:
    gc.set_threshold(900_000, 3, 100)
    with gc_policy.rare_collections():
        assert gc.get_threshold() == (900_000, *gc_policy.MEANWHILE[1:])
    assert gc.get_threshold() == (900_000, 3, 100)
    gc.set_threshold(0)
    with pytest.raises(KeyError), gc_policy.rare_collections():
        assert gc.get_threshold()[0] == 0
        raise KeyError
    assert gc.get_threshold()[0] == 0


def test_building_a_session_looks_seldom_and_leaves_it_as_it_was(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    seen = list[tuple[int, int, int]]()
    from itouch.session import Session, SessionError
    from itouch.world import Model

    def look(*args: object, **named: object) -> Model:
        seen.append(gc.get_threshold())
        raise ValueError

    monkeypatch.setattr("itouch.session.session.survey", look)
    with pytest.raises(ValueError):
        itouch.build(SCENES / "materials.xml")
    assert seen == [gc_policy.MEANWHILE]
    assert gc.get_threshold() == USUAL
    with pytest.raises(SessionError):
        itouch.restore(tmp_path / "none.itouch")
    assert gc.get_threshold() == USUAL
    assert Session is itouch.Session
