"""``python -m itouch.servo.twin FD PARENT``: the process of one twin.

It ends with the servo process that started it until the session has begun, from its first instruction on: what takes
long, the imports and the compiling, comes after.
"""

from __future__ import annotations

import signal
import socket
import sys
from collections.abc import Callable, Sequence

from itouch.servo.parent_process import end_with


def main(argv: Sequence[str]) -> int:
    """Serve one twin on a socket that was passed on; its description comes on standard input."""
    begun: list[Callable[[], bool]] = []
    end_with(int(argv[1]), while_=lambda: not (begun and begun[0]()))
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    said = sys.stdin.read()
    if not said:  # the servo process has gone before it said what is to be simulated
        return 1
    from itouch.servo.twin_server import serve

    serve(said, socket.socket(fileno=int(argv[0])), begun.append)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
