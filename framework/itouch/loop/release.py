"""Release of devices and outputs at the end of a session: each step is done whatever those before raised."""

from __future__ import annotations

import sys
from collections.abc import Callable

from itouch.loop.runner import Runner
from itouch.plugin import DeviceError
from itouch.schema import ItouchError
from itouch.schema.diagnostics import spoken
from itouch.world.plugin_errors import said


def in_turn(*steps: Callable[[], object]) -> None:
    """Do every step; what was raised first is raised when all are done, what came later stands in its notes."""
    first: BaseException | None = None
    for step in steps:
        try:
            step()
        except BaseException as error:
            if first is None:
                first = error
            else:
                first.add_note(f"then: {spoken(error)}")
    if first is not None:
        raise first


def released(runner: Runner) -> None:
    """Release one device.

    Raises
    ------
    DeviceError
        Naming the device, if it raises whatever else.
    """
    try:
        runner.close()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a plugin that exits does not end the program
        why = spoken(error) if isinstance(error, ItouchError) else said(error)
        raise DeviceError(f"device '{runner.model.name}' could not be released: {why}") from error


def raise_unless_failing(step: Callable[[], None]) -> None:
    """Do a step; if it raises a ``DeviceError`` while another error is under way, that one goes on, with a note."""
    under_way = sys.exception()
    try:
        step()
    except DeviceError as error:
        if under_way is None:
            raise
        under_way.add_note(f"then: {spoken(error)}")
