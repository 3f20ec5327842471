"""What guardian and servo process decide about one another, without processes: no timing has a say in it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch.servo import control_block as at
from itouch.servo.guardian import Guardian
from itouch.servo.serve import Servo
from itouch.servo.shared_memory import ServoError


@pytest.mark.parametrize(
    ("was_armed", "armed", "phase", "said"),
    [
        (True, 1, at.RUNNING, "the servo process died"),
        (True, 1, at.ENDED, "the servo process ended with devices that were not safe"),
        (True, 0, at.ENDED, ""),
        (False, 1, at.RUNNING, ""),
    ],
)
def test_devices_of_a_servo_process_that_died_are_made_safe_if_they_were_not(
    was_armed: bool, armed: int, phase: int, said: str
) -> None:
    guardian: Any = Guardian.__new__(Guardian)
    safe: list[str] = []
    guardian._said, guardian._was_armed, guardian._segment = "", was_armed, SimpleNamespace(phase=phase)
    guardian._words = np.zeros(64, np.int64)
    guardian._words[at.ARMED] = armed
    guardian._make_safe = lambda why: (safe.append(why), why)[1]
    assert guardian._died() == said
    assert safe == ([said] if said else [])


@pytest.mark.parametrize(("obeyed", "beat", "waits"), [(True, 0, True), (True, 5, False), (False, 0, False)])
def test_devices_that_obey_wait_for_a_guardian_that_lives(
    obeyed: bool, beat: int, waits: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("itouch.servo.serve.GUARDIAN_START", -1.0)
    servo: Any = Servo.__new__(Servo)
    servo._obeyed, servo.words, servo._rest = obeyed, np.zeros(64, np.int64), lambda: None
    servo.words[at.GUARDIAN_BEAT] = beat
    if not waits:
        servo._await_guardian()
        return
    with pytest.raises(ServoError, match="did not start: nothing is enabled without it"):
        servo._await_guardian()
