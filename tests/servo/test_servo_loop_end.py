"""How the loop of a servo process ends: as it was asked to, or with what its session met."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from itouch.loop import DeviceFaultError
from itouch.monitors import Trip
from itouch.servo import control_block as at
from itouch.servo import guardian, serve


@pytest.mark.parametrize("met", [False, True])
def test_a_run_that_is_asked_to_stop_ends_well_unless_its_session_has_met_a_fault(met: bool) -> None:
    fault = DeviceFaultError("arm", 7, Trip.NONE, "was unplugged") if met else None
    session = SimpleNamespace(
        ticks=0, scripted=False, taps=[], loss_hooks=[], on=SimpleNamespace(waiting=[]), fault=fault
    )
    served: Any = object.__new__(serve.Servo)
    served.session, served._config, served.words = session, {"seconds": None}, {at.STOP: 1}
    served._follow_once = lambda: None
    if met:
        with pytest.raises(DeviceFaultError, match="unplugged"):
            served._run()
    else:
        served._run()
    assert served.words[at.PHASE] == at.RUNNING


def test_a_loop_at_rest_shows_often_that_it_lives_and_what_it_is_asked_for_has_not_to_wait(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A guardian whose devices were armed takes a loop that it hears nothing of for lost, and a person waits for STOP."""
    slept = list[float]()
    monkeypatch.setattr(serve.time, "sleep", slept.append)
    monkeypatch.setattr(serve, "monotonic", lambda: 77)
    asked = ["stop", "mark"]
    served: Any = object.__new__(serve.Servo)
    served.words, done = {at.BEAT: 0}, list[str]()
    served._inbox = SimpleNamespace(take=lambda: asked)
    served._commands = SimpleNamespace(carry_out=done.append, settle=lambda: True)
    served.outbox = SimpleNamespace(flush=lambda: done.append("flushed"))
    served._publish = lambda *words: done.append("published")
    served._hold, served._watch_others = (lambda: done.append("held")), (lambda: done.append("watched"))
    served._rest()
    assert done == ["stop", "mark", "published", "held", "flushed", "watched"]
    assert served.words[at.BEAT] == 77 and 0.0 < sum(slept) < guardian.SILENCE / 10.0
