"""``itouch-py view --ros2`` and ``--rerun``: pass a running session on to other programs, until it ends."""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import socket
import subprocess
import sys
from typing import TYPE_CHECKING

from itouch.schema import ItouchError
from itouch.schema.extras import need
from itouch.schema.terminal import note

if TYPE_CHECKING:
    from itouch_tools.viewer.live.ros2 import Place


def ros2(options: argparse.Namespace) -> int:
    """Publish a session to ROS 2."""
    from itouch.servo import attach

    need("ros2", "--ros2")
    from itouch_tools.viewer.live.ros2 import RATE, tell

    place, rate = _place(options), RATE if options.rate is None else options.rate
    logging.getLogger("zenoh_ros2_sdk").setLevel(logging.ERROR)
    with attach(options.session) as link:
        if not 1.0 <= rate <= round(1.0 / link.period):
            raise ItouchError(f"--rate {rate:g}: 1 to {1.0 / link.period:.0f} Hz, the servo rate")
        if not place.answers:
            note(f"no Zenoh router answers at {place.host}:{place.port} yet: start one, with ROS by "
                 "`ros2 run rmw_zenoh_cpp rmw_zenohd`")  # fmt: skip

        def told(names: list[str]) -> None:
            print(f"attached to '{link.name}'; Ctrl-C ends the topics and not the session", file=sys.stderr)
            print("\n".join(names), flush=True)

        with contextlib.suppress(KeyboardInterrupt):
            passed = tell(link, place, rate, told)
            if passed:
                note(f"{passed} moments were skipped: this machine was too slow for {rate:g} Hz")
    return 0


def rerun(options: argparse.Namespace) -> int:
    """Show a session in Rerun: in a new window, or in a Rerun that is running."""
    from itouch.servo import attach

    need("rerun", "--rerun")
    from itouch_tools.viewer.live.rerun import show
    from itouch_tools.viewer.offscreen import has_display

    if options.to and not options.to.startswith(("rerun+http://", "rerun+https://")):
        raise ItouchError(f"--to '{options.to}': write where a Rerun listens, rerun+http://127.0.0.1:9876/proxy")
    with attach(options.session) as link, contextlib.ExitStack() as stack:
        if not options.to and not has_display():
            raise ItouchError("there is no display; --to ADDRESS shows it in a Rerun elsewhere, --web in a browser")
        address, window = options.to or "", None
        if not address:
            port = _free()
            words = [sys.executable, "-m", "rerun", "--port", str(port), "--expect-data-soon"]
            window = stack.enter_context(subprocess.Popen(words))
            stack.callback(window.terminate)
            address = f"rerun+http://127.0.0.1:{port}/proxy"

        def told() -> None:
            print(f"attached to '{link.name}'; Ctrl-C ends the view and not the session", file=sys.stderr, flush=True)

        with contextlib.suppress(KeyboardInterrupt):
            show(link, address, told, lambda: window is None or window.poll() is None)
    return 0


def _free() -> int:
    """Return a port of this machine that is free."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _place(options: argparse.Namespace) -> Place:
    """Read where topics are to be published.

    Raises
    ------
    ItouchError
        If the router or the domain of ROS is no such thing.
    """
    from itouch_tools.viewer.live.ros2 import Place

    host, _, port = (options.router or "127.0.0.1").partition(":")
    said = os.environ.get("ROS_DOMAIN_ID", "0") if options.domain is None else str(options.domain)
    if not host or (port and not (port.isdecimal() and 0 < int(port) <= 65535)):
        raise ItouchError(f"--router '{options.router}': write HOST or HOST:PORT, with a port of 1 to 65535")
    if not said.isdecimal() or int(said) > 232:
        raise ItouchError(f"the domain of ROS is 0 to 232, not '{said}' (--domain, ROS_DOMAIN_ID)")
    return Place(host, int(port or 7447), int(said))
