"""``python -m itouch.servo.twin_process FD PARENT``: the process of one twin.

From its first instruction until the session has begun, it ends with the servo process that started it: what takes long,
imports and compiling, comes only after it has begun to watch for that.
"""

from __future__ import annotations

import signal
import socket
import sys
from collections.abc import Callable, Sequence

from itouch.gc_policy import keep_collections_rare
from itouch.servo.parent_process import end_with


def main(argv: Sequence[str]) -> int:
    """Serve one twin on an inherited socket; its description comes on standard input."""
    begun: list[Callable[[], bool]] = []
    end_with(int(argv[1]), while_=lambda: not (begun and begun[0]()))
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    said = sys.stdin.read()
    if not said:  # the servo process died before it sent the description
        return 1
    from itouch.servo.twin_server import serve

    serve(said, socket.socket(fileno=int(argv[0])), begun.append)
    return 0


if __name__ == "__main__":
    keep_collections_rare()
    sys.exit(main(sys.argv[1:]))
