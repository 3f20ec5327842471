"""``python -m itouch.servo.process``: the servo process.  It builds the engine, runs it, publishes, and ends safely.

``itouch.launch`` starts it with the session's memory and a line to the launcher; no other code shares its interpreter,
so that plugins can be plain Python.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from itouch.gc_policy import keep_collections_rare
from itouch.platforms import lives, signals
from itouch.process_exit import end_in_order, end_soon
from itouch.servo import control_block as at
from itouch.servo.launcher_pipe import Outbox, messages
from itouch.servo.parent_process import LOOK, end_with
from itouch.servo.shared_memory import SharedMemory, monotonic

#: What is said of a session that was asked to end before anything could act.
_ENDED_EARLY = "the session was asked to end while it began: nothing was enabled"


class _EndedEarly(BaseException):
    """SIGTERM came before anything may act."""


def main(argv: Sequence[str]) -> int:
    """Run a session as the launcher asks, and tell the launcher how it ended."""
    segment = SharedMemory(int(argv[0]), argv[1])
    line = socket.socket(fileno=int(argv[2]))
    parent = int(argv[3])
    segment.words[at.SERVO] = os.getpid()
    segment.words[at.BEAT] = monotonic()
    try:
        _end_on_signals(segment)
        return _obey(segment, line, parent)
    except _EndedEarly:  # what to build was not known yet
        return 1


def _obey(segment: SharedMemory, line: socket.socket, parent: int) -> int:
    # until anything may act, this process ends at once with its launcher; later the devices are made safe first
    end_with(parent, while_=lambda: segment.phase < at.READY)
    config = next(messages(line), None)
    if config is None:
        return 1
    outbox = Outbox(line)
    _end_without_guardian(segment, outbox)
    return serve(segment, outbox, {**config, "launcher": parent}, told=end_soon)


def serve(
    segment: SharedMemory, outbox: Outbox, config: dict[str, Any], *, told: Callable[[int], None] | None = None
) -> int:
    """Build and run what the launcher asks for, and tell the launcher how it ended; return the exit code.

    ``told`` is called with that code after that, before anything is released that a plugin has left behind.
    """
    error: BaseException | None = None
    report: dict[str, Any] | None = None
    try:
        report, error = _serve(segment, outbox, config)
    except BaseException as raised:
        error = raised
    if isinstance(error, _EndedEarly):  # nothing has run that could be reported
        report = None
    segment.words[at.PHASE] = at.ENDED  # if devices could not be made safe, it is still armed: the guardian acts
    outbox.finish({"report": report, "error": _told(error)})
    code = 1 if error is not None else 0
    if told is not None:
        told(code)
    return code


def _end_without_guardian(segment: SharedMemory, outbox: Outbox) -> None:
    """End this process at once if its guardian dies before anything may act."""

    def look() -> None:
        while segment.phase < at.READY:
            guardian = int(segment.words[at.GUARDIAN])
            if guardian and not lives(guardian):
                said = "the guardian process died while the session began: nothing is enabled without it"
                # nothing is imported here: that would wait for the other thread's imports
                outbox.finish({"report": None, "error": _plain(said)})
                os._exit(1)
            time.sleep(LOOK)

    threading.Thread(target=look, name="itouch-guardian", daemon=True).start()


def _serve(
    segment: SharedMemory, outbox: Outbox, config: dict[str, Any]
) -> tuple[dict[str, Any], BaseException | None]:
    from importlib import import_module

    module, _, name = str(config.get("serves", "itouch.servo.serve:serve")).partition(":")
    found: tuple[dict[str, Any], BaseException | None] = getattr(import_module(module), name)(segment, outbox, config)
    return found


def _plain(message: str) -> dict[str, Any]:
    """Return an error that came before anything was loaded, as plain data."""
    return {"type": "ServoError", "message": message, "traceback": ""}


def _told(error: BaseException | None) -> dict[str, Any] | None:
    if error is None:
        return None
    if isinstance(error, _EndedEarly):
        return _plain(_ENDED_EARLY)
    try:
        from itouch.servo.error_transport import encode
    except ImportError as missing:  # while the program is upgraded in place, parts of it are missing
        return _plain(f"{missing}: the program was changed while it ran; start it again")
    return encode(error)


def _end_on_signals(segment: SharedMemory) -> None:
    """Let SIGTERM end the session safely; signals from a terminal are left to the launcher.

    While the session is being built, which may take long, nothing may act yet: then SIGTERM ends it at once.
    """

    def stop(number: int, frame: object) -> None:
        segment.words[at.STOP] = 1
        if segment.phase < at.READY and not ended:  # once: the way out is not to be interrupted
            ended.append(number)
            raise _EndedEarly(_ENDED_EARLY)

    ended: list[int] = []

    signal.signal(signal.SIGTERM, stop)
    for number in signals("SIGINT", "SIGHUP"):
        with contextlib.suppress(OSError, ValueError):
            signal.signal(number, signal.SIG_IGN)


if __name__ == "__main__":
    keep_collections_rare()
    code = main(sys.argv[1:])
    end_in_order(code)
