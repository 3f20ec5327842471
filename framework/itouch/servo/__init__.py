"""The servo process: the engine on absolute deadlines in a process of its own, and all that watches over it.

``launch`` starts a session and returns a ``Handle``; ``attach`` gives any process a ``Link`` to a running session;
``sessions`` lists the running ones.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from itouch.servo.handle import Handle
    from itouch.servo.launching import launch
    from itouch.servo.link import Link, SessionInfo, attach, sessions
    from itouch.servo.shared_memory import ServoError

#: Public name -> its module; loaded when asked for, so that the guardian and readers stay small.
_HOMES = {
    "Handle": "handle",
    "Link": "link",
    "ServoError": "shared_memory",
    "SessionInfo": "link",
    "attach": "link",
    "launch": "launching",
    "sessions": "link",
}

__all__ = ["Handle", "Link", "ServoError", "SessionInfo", "attach", "launch", "sessions"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'itouch.servo' has no attribute '{name}'")
    found = getattr(import_module(f"itouch.servo.{_HOMES[name]}"), name)
    globals()[name] = found
    return found
