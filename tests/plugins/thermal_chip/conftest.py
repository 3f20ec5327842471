"""The reference display's program in simavr; where CI is set, a tool that is missing is a failure."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import requirements

from itouch_thermal.chip.display import SimulatedDisplay
from itouch_thermal.chip.host import SimulatedHost
from itouch_thermal.chip.program import Built, built, missing

Start = Callable[..., SimulatedHost]


@pytest.fixture(scope="session")
def program() -> Built:
    if lacking := missing():
        requirements.missing(f"the simulated chip needs {lacking}")
    return built()


@pytest.fixture
def start(program: Built) -> Iterator[Start]:
    """Return a function that switches a display on and greets it."""
    displays = []

    def make(*, greet: bool = True, program: Built = program, **values: Any) -> SimulatedHost:
        display = SimulatedDisplay(program=program, **values)
        displays.append(display)
        host = SimulatedHost(display)
        if greet:
            host.begin()
        return host

    yield make
    for display in displays:
        display.close()
