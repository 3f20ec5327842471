"""``python -m itouch.servo.process``: the servo process.  It builds the engine, runs it, publishes, and ends safely.

It is started by ``itouch.launch`` with the session's memory and a line to the launcher; nothing else holds its
interpreter, so plugins can be plain Python.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
from collections.abc import Sequence
from typing import Any

from itouch.servo import words as at
from itouch.servo.channel import Outbox, messages
from itouch.servo.segment import Segment, monotonic


def main(argv: Sequence[str]) -> int:
    """Run a session as the launcher asks, and tell it how that ended."""
    segment = Segment(int(argv[0]), argv[1])
    line = socket.socket(fileno=int(argv[2]))
    segment.words[at.SERVO] = os.getpid()
    segment.words[at.BEAT] = monotonic()
    _end_on_signals(segment)
    config = next(messages(line), None)
    if config is None:
        return 1
    outbox = Outbox(line)
    error: BaseException | None = None
    report: dict[str, Any] | None = None
    try:
        report, error = _serve(segment, outbox, config)
    except BaseException as raised:
        error = raised
    segment.words[at.ARMED] = 0
    segment.words[at.PHASE] = at.ENDED
    outbox.finish({"report": report, "error": _told(error)})
    return 1 if error is not None else 0


def _serve(segment: Segment, outbox: Outbox, config: dict[str, Any]) -> tuple[dict[str, Any], BaseException | None]:
    from itouch.servo.serve import Servo, build

    servo = Servo(build(config), segment, outbox, config)
    return servo.run()


def _told(error: BaseException | None) -> dict[str, Any] | None:
    if error is None:
        return None
    from itouch.servo.errors import encode

    return encode(error)


def _end_on_signals(segment: Segment) -> None:
    """Let SIGTERM end the session safely; what a terminal sends is the launcher's to answer."""

    def stop(number: int, frame: object) -> None:
        segment.words[at.STOP] = 1

    signal.signal(signal.SIGTERM, stop)
    for number in (signal.SIGINT, signal.SIGHUP):
        with contextlib.suppress(OSError, ValueError):
            signal.signal(number, signal.SIG_IGN)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
