"""A viewer and a recorder without windows, which do to a session what real ones do.

``python -m itouch_evidence.deaths.simulated_clients viewer|recorder NAME``

The viewer copies the newest State sixty times a second and holds the dead-man's switch; the recorder takes every State.
On a signal a stand-in uses up memory until the kernel, or Python, stops it.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Sequence

from itouch.platforms import lives
from itouch.servo.link import Link, attach
from itouch.servo.shared_memory import ServoError
from itouch_evidence.deaths.memory_exhaustion import starve_on_signal


def _view(link: Link) -> None:
    state = link.state
    while lives(link.pid):  # a starting session may be silent for longer than a running one: it waits for its twins
        link.hold()
        link.refresh(state)
        time.sleep(1 / 60)


def _follow(link: Link) -> None:
    follower, taken = link.follow(), 0
    while link.alive:
        taken += sum(len(entry.state) for entry in follower.take())
        time.sleep(0.02)


def _attached(name: str, patience: float) -> Link:
    """Attach to a session, or to one that is about to start."""
    end = time.monotonic() + patience
    while True:
        try:
            return _published(name)
        except ServoError:
            if time.monotonic() > end:
                raise
            time.sleep(0.02)


def _published(name: str) -> Link:
    """Attach to a session that has published a State.

    Raises
    ------
    ServoError
        If there is none.
    """
    with contextlib.ExitStack() as stack:
        link = stack.enter_context(attach(name))
        _ = link.state
        stack.pop_all()
        return link


def main(argv: Sequence[str]) -> int:
    """Stand in for a viewer or a recorder until the session ends."""
    starve_on_signal()
    with _attached(argv[1], float(argv[2]) if len(argv) > 2 else 0.0) as link:
        print("attached", flush=True)
        (_view if argv[0] == "viewer" else _follow)(link)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
