"""Release of devices and outputs at the end of a session: each step is carried out, whatever earlier ones raised."""

from __future__ import annotations

import sys
from collections.abc import Callable

from itouch.loop.device_runner import DeviceFaultError, Runner
from itouch.plugin import DeviceError
from itouch.schema import ItouchError
from itouch.schema.diagnostics import spoken
from itouch.schema.plugin_errors import error_text


def in_turn(*steps: Callable[[], object]) -> None:
    """Do every step; the first error is raised when all are done, with the later ones as its notes."""
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
        Naming the device, if it raises anything but KeyboardInterrupt.
    """
    try:
        runner.lifecycle.close()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a plugin that exits does not end the program
        why = spoken(error) if isinstance(error, ItouchError) else error_text(error)
        raise DeviceError(f"device '{runner.model.name}' could not be released: {why}") from error


def raise_unless_failing(step: Callable[[], None]) -> None:
    """Do a step; what a device raises while another error is under way becomes a note of that one."""
    under_way = sys.exception()
    try:
        step()
    except (DeviceError, DeviceFaultError) as error:
        if under_way is None:
            raise
        under_way.add_note(f"then: {spoken(error)}")
