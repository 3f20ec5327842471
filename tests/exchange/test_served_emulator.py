"""An emulator in a thread: what it raises is told to the simulation, and nothing of it is left running."""

from __future__ import annotations

import threading
import time
from typing import Any

import pytest

from itouch.exchange.thread import ServedEmulator
from itouch.plugin import Emulator, Field, Record

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

READING, COMMAND = (Field("height", unit="m"),), (Field("goal", unit="m"),)


class Fails(Emulator):
    """Serves twice, and then does what it is made with."""

    def __init__(self, error: BaseException | None) -> None:
        super().__init__(None)
        self.error, self.served = error, 0

    def open(self) -> str:
        return "nowhere"

    def close(self) -> None:
        """Have nothing to close."""

    def file_descriptors(self) -> Any:
        return []

    def service_interval(self) -> float:
        return 1e-3

    def serve(self, now: float, reading: Record, command: Record) -> bool:
        self.served += 1
        if self.served > 2 and self.error is not None:
            raise self.error
        command["goal"] = 2.0 * reading["height"]
        return True


def served(error: BaseException | None) -> tuple[ServedEmulator, Record, Record]:
    reading, command = Record.of(READING), Record.of(COMMAND)
    return ServedEmulator(Fails(error), reading, command), reading, command


def before_long(done: Any) -> None:
    deadline = time.monotonic() + 300.0
    while not done():
        assert time.monotonic() < deadline
        time.sleep(1e-3)


@pytest.mark.parametrize("error", [ValueError("no such word"), SystemExit(3), KeyboardInterrupt()])
def test_what_an_emulator_raises_is_raised_where_its_command_is_taken(error: BaseException) -> None:
    one, _, command = served(error)
    before_long(lambda: not one._thread.is_alive())
    with pytest.raises(Exception, match=str(error) or type(error).__name__):
        one.take(command)
    one.close()


def test_what_it_is_shown_becomes_a_command_until_it_is_closed() -> None:
    one, reading, command = served(None)
    reading["height"] = 0.25
    one.show(1.0, reading)
    before_long(lambda: one.take(command) and command["goal"].item() == 0.5)
    one.close()
    assert not one._thread.is_alive()
    assert one._thread not in threading.enumerate()
