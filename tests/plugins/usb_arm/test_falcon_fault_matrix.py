"""The whole matrix: every fault of the virtual arm begun in every state, seen to its end, and the arm used again."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from itouch_usb_arm import Falcon, FalconError, boot
from itouch_usb_arm.virtual import Faults, VirtualBackend, VirtualFalcon, VirtualTime

IMAGE = boot.build([boot.Block(0x3F8000, tuple(range(90)))], entry=0x3F8002)
STATES = ("closed", "opening", "homing", "ready", "enabled")
#: How bad each is: once, or for as long as the test lasts.
FAULTS = {
    "drop": (1, 500), "bad": (1, 500), "wrong": (1,), "stray": (1, 500), "refuse": (1, 500), "mute": (1, 500), "late": (0.03, 0.4),
    "unplug_after": (0, 5, 16), "boot_echo": (0, 150), "unhomed": (True,), "deaf": (True,),
}  # fmt: skip
CASES = [(state, fault, worth) for state, fault in itertools.product(STATES, FAULTS) for worth in FAULTS[fault]]
#: Longest time [s] that a call may take, on the virtual clock; homing has two seconds of its own.
LONGEST = {"open": 20.0, "home": 3.5, "read": 1.0, "write": 1.0, "close": 2.0}
FORCE = (0.4, -0.3, 1.2)


class Watched:
    """An arm and its driver; every call is timed, every force on the wire and every reading is judged."""

    def __init__(self, *, running: bool, seed: int) -> None:
        self.time = VirtualTime()
        self.arm = VirtualFalcon(time=self.time, running=running, seed=seed)
        self.arm.hand.path = lambda now: (0.004 * np.sin(3.0 * now), 0.0, 0.122)
        self.falcon = Falcon(IMAGE, VirtualBackend(self.arm), clock=self.time.now)
        self.errors: list[FalconError] = []
        #: Whether a force may be on the wire: it was written with the arm homed, and nothing has failed since.
        self.allowed = False

    def call(self, name: str) -> bool:
        """Do a step; tell whether it went well."""
        begin, sent = self.time.now(), len(self.arm.commands)
        before = self.allowed
        try:
            self._step(name)
        except FalconError as error:
            assert type(error) is not FalconError, f"'{error}' has no name of its own"
            assert len(str(error)) > 15
            self.errors.append(error)
            self.allowed = False
        assert self.time.now() - begin < LONGEST[name], f"{name} took {self.time.now() - begin:.2f} s"
        frames = [numbers.values for numbers in itertools.islice(self.arm.commands, sent, None)]
        if not before:
            assert not any(map(any, frames)), f"a force was sent in '{name}' that nobody may give"
        elif not self.allowed:  # the frame that failed may have carried it; nothing after it
            assert not any(map(any, frames[1:]))
        return not (self.errors and self.errors[-1:] and not self.falcon.is_open)

    def _step(self, name: str) -> None:
        if name == "open":
            self.falcon.open()
        elif name == "home":
            assert self.falcon.home(2.0).valid
        elif name == "write":
            self.falcon.write(FORCE)
            self.allowed = True
        elif name == "close":
            self.allowed = False
            self.falcon.close()
        else:
            reading = self.falcon.read()
            assert reading.valid == np.isfinite(reading.position).all()
            if reading.valid:
                assert all(self.arm.homed), "a pose of an arm that is not homed"
                assert np.abs(reading.position - self.arm.mechanics.position).max() < 1e-3
            else:
                self.allowed = False

    def until(self, state: str) -> None:
        """Bring a healthy arm to a state."""
        for name in {"closed": "", "opening": "", "homing": "open", "ready": "open home", "enabled": "open home write"}[
            state
        ].split():
            self.call(name)
            assert not self.errors
        if state in ("ready", "enabled"):
            for _ in range(20):
                self.call("read")


@pytest.mark.parametrize(("state", "fault", "worth"), CASES)
def test_every_fault_in_every_state_ends_safely(state: str, fault: str, worth: float) -> None:
    running = fault not in ("boot_echo", "deaf")
    watched = Watched(running=running or state not in ("closed", "opening"), seed=len(state) + len(fault))
    watched.until(state)
    setattr(watched.arm.faults, fault, worth)
    for name in {
        "closed": ["close"], "opening": ["open", "read", "write"], "homing": ["home", "write", "read"],
        "ready": ["read", "read", "write", "read"], "enabled": ["read"] * 12,
    }[state]:  # fmt: skip
        watched.call(name)
    watched.call("close")
    assert not watched.falcon.is_open
    assert watched.arm.mechanics.motors == (0, 0, 0) or watched.arm.faults.refuse
    if state == "closed" and fault == "unplug_after":
        watched.arm.unplug()
        watched.call("open")
        assert type(watched.errors[-1]).__name__ == "NotFound"

    # What was wrong is put right: the arm is replugged, or switched off and on, and does its work.
    for part in dataclasses.fields(Faults):
        setattr(watched.arm.faults, part.name, getattr(Faults(), part.name))
    if not watched.arm.attached or not running:
        watched.arm.plug(running=False)
    watched.errors.clear()
    for name in ("open", "home", "write", *["read"] * 30):
        watched.call(name)
    assert not watched.errors
    assert any(watched.arm.mechanics.motors)
    watched.call("close")
    assert watched.arm.mechanics.motors == (0, 0, 0)


def test_every_fault_is_in_the_matrix() -> None:
    assert set(FAULTS) == {part.name for part in dataclasses.fields(Faults)}
