"""Whether ``run`` opens a window, and the window on a session that was launched."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from typing import TYPE_CHECKING

from itouch.schema.terminal import note

if TYPE_CHECKING:
    from collections.abc import Callable

    from itouch.servo import Handle


def wanted(options: argparse.Namespace) -> bool:
    """Tell whether to open a window: yes, unless something else is asked for or there is no display."""
    from itouch_tools.viewer.offscreen import has_display

    return _asked(options) and has_display()


def tell(options: argparse.Namespace, *, opened: bool) -> None:
    """Print a line, once something runs, if there is no display for the window."""
    if _asked(options) and not opened:
        note("no display: running without a window, as with --headless")


def _asked(options: argparse.Namespace) -> bool:
    return not (options.headless or options.pace == "fast" or options.screenshot or options.film or options.wav)


def show(handle: Handle, look: Callable[[], None], *, mute: bool) -> None:
    """Open a window on a session that was launched, and show it until the session ends or the window is closed.

    Nothing moves before the window is open: hardware is not enabled, and twins, which are enabled by themselves, are
    paused.  If the window can't be opened, that is printed, and the session runs without it.
    ``look`` is called at each picture, to update the terminal.
    """
    from itouch.servo import ServoError
    from itouch_tools.viewer.offscreen import GraphicsError, open_window

    window = None
    with contextlib.suppress(ServoError):  # if the session has ended, its launcher reports that
        handle.command("pause")  # refused with hardware, which waits to be enabled anyway
        try:
            window = open_window(handle.link, time.perf_counter, handle=handle, mute=mute)
        except GraphicsError as error:
            print(f"no window: {error}", file=sys.stderr)
        handle.command("resume")
        handle.command("enable")

    def going() -> bool:
        look()
        return not handle.wait(0.0)

    if window is not None:
        window.show(while_=going)
